"""Every source of readings by its name: a port, a recording, and what installed packages add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tactsim.core.errors import InputError
from tactsim.core.plug_ins import Registry
from tactsim.core.source import Log, Source
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import Device
from tactsim.hardware.recording import Recorder
from tactsim.hardware.wrappers import Checked, Corrected, Recorded

GROUP = "tactsim.sources"

# name: (where its opener is, what it is). Nothing is imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "port": ("tactsim.hardware.live:LiveSource", "a sensor on a serial port, a pty or a socket"),
    "recording": (
        "tactsim.hardware.recorded:open_source",
        "a recording of this program, a table of text, or lines that a terminal kept",
    ),
}

Opener = Callable[[Sequence[str], Device, "Log | None"], Source]


def _fault(opener: Any) -> str | None:
    return None if callable(opener) else "is no function that opens a source"


_SOURCES = Registry("source", GROUP, BUILT_IN, _fault)
names, listing = _SOURCES.names, _SOURCES.listing


def open_source(
    places: Sequence[str], device: Device, calibration: Calibration | None = None, log: Log | None = None
) -> Source:
    """Open the source at `places`, as many as the device has ports.

    A place is a port (/dev/ttyUSB0, socket://HOST:PORT and whatever else pyserial opens),
    `recording:FILE`, or `NAME:...` for the source NAME of an installed package.

    calibration: corrects the readings. log: is told what the source's links say; if the source has no
    bytes and the log is a `Recorder`, it records the uncorrected readings instead.
    Raises InputError if there is no such source, it cannot be opened, or it is corrected already.
    """
    name, _, rest = places[0].partition(":") if places else ("", "", "")
    known = name in names()
    if known or _looks_like_a_name(name, rest):
        opener: Opener = _SOURCES.load(name)
        places = [rest, *places[1:]]
    else:
        opener = _SOURCES.load("port")
    source = opener(places, device, log)
    if known and name not in BUILT_IN:
        source = Checked(source, name)
    try:
        if isinstance(log, Recorder) and not source.has_bytes:
            source = Recorded(source, log)
        return source if calibration is None else Corrected(source, calibration, places[0])
    except InputError:
        source.close()
        raise


def _looks_like_a_name(name: str, rest: str) -> bool:
    """Tell whether NAME:REST is meant to be a source, and no port such as socket://HOST:PORT or C:port."""
    return bool(rest) and not rest.startswith("//") and name.isidentifier() and len(name) > 1
