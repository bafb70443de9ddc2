"""Every source of readings by its name: a port, a recording, and what installed packages add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from tactsim.core import plug_ins
from tactsim.core.errors import InputError, unknown
from tactsim.core.plug_ins import Listed
from tactsim.core.source import Log, Source
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import Device
from tactsim.hardware.recording import Recorder
from tactsim.hardware.wrappers import Checked, Corrected, Recorded

GROUP = "tactsim.sources"

# name: (where its opener is, what it is). Nothing is imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "port": ("tactsim.hardware.live:open_source", "a sensor on a serial port, a pty or a socket"),
    "recording": (
        "tactsim.hardware.recorded:open_source",
        "a recording of this program, or of the PPS tool (.csv)",
    ),
}

Opener = Callable[[Sequence[str], Device, "Log | None"], Source]


def open_source(
    places: Sequence[str],
    device: Device,
    calibration: Calibration | None = None,
    log: Log | None = None,
) -> Source:
    """Open the source at `places`, as many as the device has ports.

    A place is a port (/dev/ttyUSB0, socket://HOST:PORT and whatever else pyserial opens),
    `recording:FILE`, or `NAME:...` for the source NAME of an installed package.

    calibration: corrects the readings. log: is told what the source's links say; if the source has no
    bytes and the log is a `Recorder`, it records the uncorrected readings instead.
    Raises InputError if there is no such source, it cannot be opened, or it is corrected already.
    """
    name, _, rest = places[0].partition(":") if places else ("", "", "")
    added = {point.name: point for point in plug_ins.plug_ins(GROUP)}
    if name in BUILT_IN:
        opener: Opener = _load(BUILT_IN[name][0])
        places = [rest, *places[1:]]
    elif name in added:
        opener = plug_ins.load_plug_in(added[name], _fault)
        places = [rest, *places[1:]]
    elif rest and not rest.startswith("//") and name.isidentifier() and len(name) > 1:
        raise unknown("source", name, names())
    else:
        opener = _load(BUILT_IN["port"][0])
    source = opener(places, device, log)
    if name in added and name not in BUILT_IN:
        source = Checked(source, name)
    try:
        if isinstance(log, Recorder) and not source.has_bytes:
            source = Recorded(source, log)
        return source if calibration is None else Corrected(source, calibration, places[0])
    except InputError:
        source.close()
        raise


def names() -> tuple[str, ...]:
    """List every source that `open_source` knows."""
    return (*BUILT_IN, *(point.name for point in plug_ins.plug_ins(GROUP) if point.name not in BUILT_IN))


def listing() -> list[Listed]:
    """Describe every source; a plug-in that cannot be loaded is a status, not a crash."""
    return plug_ins.listing(GROUP, BUILT_IN, _fault)


def _load(where: str) -> Any:
    module, attribute = where.split(":")
    return getattr(import_module(module), attribute)


def _fault(opener: Any) -> str | None:
    return None if callable(opener) else "is no function that opens a source"
