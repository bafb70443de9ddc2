"""Every source of readings by its name: a port, a recording, and what installed packages add.

Sources around another source, too: its readings corrected, recorded, checked, or given at the speed of their time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.counters import Counters
from tactsim.core.errors import InputError, short
from tactsim.core.pad import Pad
from tactsim.core.plug_ins import Registry
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import Log, Source, SourceError, Wrapper
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.device import Device
from tactsim.hardware.recording import Recorder

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
    known = name in names() and places[0] != "port"  # a port may be called so, too
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
        as_recorded = calibration == getattr(source, "calibration", None)
        return source if calibration is None or as_recorded else Corrected(source, calibration, places[0])
    except InputError:
        source.close()
        raise


def _looks_like_a_name(name: str, rest: str) -> bool:
    """Tell whether NAME:REST is meant to be a source, and no port such as socket://HOST:PORT or C:port."""
    return bool(rest) and not rest.startswith("//") and name.isidentifier() and len(name) > 1


def taxels_of(source: Source) -> NDArray[np.int64]:
    """Find for each value of a source's readings which taxel of its pad it is; some may be left out."""
    apart = np.abs(source.taxel_xy[:, None] - source.pad.taxel_xy[None]).max(axis=-1)
    return apart.argmin(axis=1)


class Corrected(Wrapper):
    """Another source, its readings corrected by a calibration."""

    calibrated = True
    uncorrected: Reading  # the last one

    def __init__(self, inner: Source, calibration: Calibration, name: str) -> None:
        """Correct what `inner`, called `name` in messages, gives.

        Raises InputError if it is corrected already, or has another number of taxels than the calibration.
        """
        super().__init__(inner)
        self._name = name
        self.correct_by(calibration)
        self._check_uncorrected()

    def correct_by(self, calibration: Calibration) -> None:
        """Correct what comes from now on by another calibration."""
        self.calibration, self._correction = calibration, Correction(calibration, self.inner.pad)

    def apply(self, reading: Reading) -> Reading:
        """Correct a reading of the inner source."""
        return self._correction.apply(reading)

    @property
    def taxel_xy(self) -> FloatArray:  # type: ignore[override]
        """Tell where the taxels lie that the calibration keeps, (taxels, 2) mm."""
        return self._correction.taxel_xy

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading, corrected; see `Source.read`.

        Raises SourceError also where a recording begins to be corrected by a calibration of its own.
        """
        self.uncorrected = self.inner.read(timeout)
        self._check_uncorrected()
        return self.apply(self.uncorrected)

    def _check_uncorrected(self) -> None:
        if self.inner.calibrated:
            raise SourceError(f"{self._name} was recorded with a calibration of its own; give none")


class Clocked(Wrapper):
    """Another source whose readings state no times, at a rate that is known otherwise."""

    def __init__(self, inner: Source, rate: float) -> None:
        """Give the readings of `inner` times, `rate` of them a second."""
        super().__init__(inner)
        self._rate, self._given = rate, 0

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading at its time; see `Source.read`. Raises SourceError where the source has a clock."""
        reading = self.inner.read(timeout)
        if reading.device_time is not None or reading.host_time:
            raise SourceError("--rate: the recording states its times itself; leave the rate out")
        self._given += 1
        return replace(reading, host_time=(self._given - 1) / self._rate)


class Recorded(Wrapper):
    """A source without bytes of its own, its readings written to a recording as they come."""

    has_bytes = True  # the recording has all

    def __init__(self, inner: Source, recorder: Recorder) -> None:
        super().__init__(inner)
        self._recorder = recorder

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading after it was recorded; see `Source.read`."""
        reading = self.inner.read(timeout)
        self._recorder.reading(reading)
        return reading


class Checked(Wrapper):
    """A plug-in's source: what it gives is a reading of its pad, or an error names the plug-in."""

    def __init__(self, inner: Any, name: str) -> None:
        """Check that the plug-in `name` has opened a source. Raises SourceError if `inner` is none."""
        if not isinstance(inner, Source):
            raise SourceError(
                f"plug-in {name!r} opened {short(inner)}, which is no tactsim.core.source.Source"
            )
        for attribute, kind in (("pad", Pad), ("taxel_xy", np.ndarray), ("counters", Counters)):
            if not isinstance(getattr(inner, attribute, None), kind):
                raise SourceError(
                    f"plug-in {name!r} opened a source without `{attribute}`, a {kind.__name__}"
                )
        super().__init__(inner)
        self._name = name

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`."""
        reading = self.inner.read(timeout)
        if not isinstance(reading, Reading) or reading.pressures.shape != (len(self.taxel_xy),):
            raise SourceError(
                f"plug-in {self._name!r} gave {short(reading)}, which is no Reading of {len(self.taxel_xy)} taxels"
            )
        return reading


_LONGEST_PAUSE = 1.0  # s: a longer one, as between two segments, is cut short


class Paced(Wrapper):
    """Another source whose readings come when they are due by their host times.

    The host time of a reading is the one at which it is given, so it is like that of a pad that is read now.
    """

    def __init__(
        self,
        inner: Source,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(inner)
        self._clock, self._sleep = clock, sleep
        self._recorded: float | None = None  # host time in the recording, and now, of the reading before
        self._given = 0.0

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading when it is due; see `Source.read`."""
        reading = self.inner.read(timeout)
        if self._recorded is None:
            self._given = self._clock()
        else:
            pause = min(max(reading.host_time - self._recorded, 0.0), _LONGEST_PAUSE)
            self._given += pause
            wait = self._given - self._clock()
            if wait > 0:
                self._sleep(wait)
            elif wait < -_LONGEST_PAUSE:  # who reads it was away: it goes on from here, and does not catch up
                self._given = self._clock()
        self._recorded = reading.host_time
        return replace(reading, host_time=self._given)
