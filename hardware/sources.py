"""Sources of readings behind one face: a port, a recording, and what installed packages add."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from tactsim.core import plug_ins
from tactsim.core.errors import InputError, short, unknown
from tactsim.core.pad import Pad
from tactsim.core.plug_ins import Listed
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.counters import Counters
from tactsim.hardware.device import Device
from tactsim.hardware.errors import SourceEnded, SourceError
from tactsim.hardware.recording import Recorder

GROUP = "tactsim.sources"

# name: (where its opener is, what it is). Nothing is imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "port": ("tactsim.hardware.live:open_source", "a sensor on a serial port, a pty or a socket"),
    "recording": (
        "tactsim.hardware.recorded:open_source",
        "a recording of this program, or of the PPS tool (.csv)",
    ),
}


class Log(Protocol):
    """What is told of everything that a link says and is told; a `Recorder` is one."""

    def received(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that came at `time`, s."""

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that were sent."""

    def lost(self, link: int, time: float) -> None:
        """Note that the link was lost."""


class Source(ABC):
    """A stream of readings of one pad. Close it, or use it in a `with`; iterate to read till its end.

    pad: the geometry. taxel_xy: (taxels, 2) mm, where the taxels lie that its readings hold.
    counters: what happened so far. calibrated: whether its readings are corrected already. has_bytes:
    whether it tells the `Log` it was given what its links say.
    """

    pad: Pad
    taxel_xy: FloatArray
    counters: Counters
    calibrated: bool = False
    has_bytes: bool = False

    @abstractmethod
    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading.

        timeout: s, None for the device's own deadline. Raises NoReading if none came in that time
        (the next call may succeed), SourceEnded at the end of a recording, SourceError if the source
        is broken. It never makes a reading up.
        """

    @abstractmethod
    def close(self) -> None:
        """Give the device back; a closed source cannot be read."""

    def __iter__(self) -> Iterator[Reading]:
        try:
            while True:
                yield self.read()
        except SourceEnded:
            return

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


Opener = Callable[[Sequence[str], Device, "Log | None"], Source]


class Corrected(Source):
    """Another source, its readings corrected by a calibration."""

    def __init__(self, inner: Source, calibration: Calibration) -> None:
        self._inner, self._correction = inner, Correction(calibration, inner.pad)
        self.pad, self.counters = inner.pad, inner.counters
        self.taxel_xy = self._correction.taxel_xy
        self.calibrated, self.has_bytes = True, inner.has_bytes

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading, corrected; see `Source.read`."""
        return self._correction.apply(self._inner.read(timeout))

    def close(self) -> None:
        """Close the other source."""
        self._inner.close()


class Recorded(Source):
    """A source without bytes of its own, its readings written to a recording as they come."""

    def __init__(self, inner: Source, recorder: Recorder) -> None:
        self._inner, self._recorder = inner, recorder
        self.pad, self.taxel_xy, self.counters = inner.pad, inner.taxel_xy, inner.counters
        self.calibrated, self.has_bytes = inner.calibrated, True

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading after it was recorded; see `Source.read`."""
        reading = self._inner.read(timeout)
        self._recorder.reading(reading)
        return reading

    def close(self) -> None:
        """Close the other source; the recording stays open."""
        self._inner.close()


def open_source(
    places: Sequence[str],
    device: Device,
    calibration: Calibration | None = None,
    log: Log | None = None,
) -> Source:
    """Open the source at `places`, as many as the device has ports.

    A `log` that is a `Recorder` gets the readings of a source that has no bytes.

    A place is a port (/dev/ttyUSB0, COM3, socket://HOST:PORT and whatever else pyserial opens),
    `recording:FILE`, or `NAME:...` for the source NAME of an installed package. Raises InputError if
    there is none or it cannot be opened.
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
        _check_source(source, name)
        source = _Checked(source, name)
    try:
        if isinstance(log, Recorder) and not source.has_bytes:
            source = Recorded(source, log)
        if calibration is not None and source.calibrated:
            raise SourceError(f"{places[0]} was recorded with a calibration of its own; give none")
        return source if calibration is None else Corrected(source, calibration)
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


def _check_source(source: Any, name: str) -> None:
    """Raise SourceError unless a plug-in has opened what a source must be."""
    if not isinstance(source, Source):
        raise SourceError(
            f"plug-in {name!r} opened {short(source)}, which is no tactsim.hardware.sources.Source"
        )
    for attribute, kind in (("pad", Pad), ("taxel_xy", np.ndarray), ("counters", Counters)):
        if not isinstance(getattr(source, attribute, None), kind):
            raise SourceError(f"plug-in {name!r} opened a source without `{attribute}`, a {kind.__name__}")


class _Checked(Source):
    """A plug-in's source; what it gives out is a reading of its pad, or the plug-in is named."""

    def __init__(self, inner: Source, name: str) -> None:
        self._inner, self._name = inner, name
        self.pad, self.taxel_xy, self.counters = inner.pad, inner.taxel_xy, inner.counters
        self.calibrated, self.has_bytes = inner.calibrated, inner.has_bytes

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`."""
        reading = self._inner.read(timeout)
        if not isinstance(reading, Reading) or reading.pressures.shape != (len(self.taxel_xy),):
            raise SourceError(
                f"plug-in {self._name!r} gave {short(reading)}, which is no Reading of {len(self.taxel_xy)} taxels"
            )
        return reading

    def close(self) -> None:
        """Close the plug-in's source."""
        self._inner.close()
