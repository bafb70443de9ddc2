"""Show a pad while it is read: pressures, force and counters, and what an estimator makes of each touch.

Lives here: one state that a reader thread keeps up to date, and two ways to show it, the terminal and a page on
localhost. Does not live here: ports and codecs (`tactsim.hardware`), and what an estimator believes
(`tactsim.estimators`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.calibration import LEAST_FRAMES, Calibration, Correction, force, take_tare
from tactsim.hardware.device import Device
from tactsim.hardware.sources import Corrected, taxels_of

State = Literal["waiting", "live", "lost", "ended"]
BIN_S = 0.1  # s of one value of the history
HISTORY_S = 30.0
_BINS = round(HISTORY_S / BIN_S)
_RATE_BINS = 20  # over which the rate is counted
_TARE_FRAMES = 100
_TARE_S = 30.0  # s within which they must come
_SAID_S = 10.0  # s for which it is said what becomes of a tare
_SILENCE_S = 0.3  # s of silence that any pad is allowed

# s: the source is asked so often at least, so that the thread ends soon when it is told to.
_LONGEST_WAIT = 1.0

_LEAST_SCALE = 10.0  # kPa: noise alone does not fill the scale


@dataclass(frozen=True, eq=False)
class PadView:
    """What the pad said last, and whether it still speaks.

    number: grows with every change. state: waiting (nothing came yet), live, lost (nothing comes), ended (a recording).
    trouble: why it is lost, or "". pressures: (taxels,) kPa of all taxels of the pad, NaN where one is left out; None
    unless live, so that nobody takes an old image for the pad. host_time: s, of that reading. readings: how many came.
    rate: readings a second. force: N. scale: kPa, a round number above all pressures of the last seconds. left_out:
    taxels that the calibration leaves out. message: what becomes of a tare, for ten seconds.
    """

    number: int = 0
    state: State = "waiting"
    trouble: str = ""
    pressures: FloatArray | None = None
    host_time: float = 0.0
    readings: int = 0
    rate: float = 0.0
    force: float = 0.0
    scale: float = _LEAST_SCALE
    counters: dict[str, int] = field(default_factory=dict)
    left_out: tuple[int, ...] = ()
    tared: bool = False
    message: str = ""


@dataclass
class _Bin:
    number: int
    readings: int = 0
    force: float = 0.0  # N, their sum
    largest: float = 0.0  # kPa


class History:
    """How many readings came, their mean force and their largest pressure, in bins of `BIN_S` of the last `HISTORY_S`.

    Times are s since the beginning, and do not fall.
    """

    def __init__(self) -> None:
        # Those with a reading; the last may still be filled.
        self._bins: deque[_Bin] = deque(maxlen=_BINS + 1)

    def add(self, time_s: float, force_n: float, largest_kpa: float) -> None:
        """Add a reading."""
        number = int(time_s / BIN_S)
        if not self._bins or self._bins[-1].number != number:
            self._bins.append(_Bin(number))
        last = self._bins[-1]
        last.readings, last.force = last.readings + 1, last.force + force_n
        last.largest = max(last.largest, largest_kpa)

    def forces(self, time_s: float) -> list[float | None]:
        """Give the mean force of the bins that have ended by `time_s`, the oldest first; None: nothing came."""
        means = {one.number: one.force / one.readings for one in self._bins}
        now = int(time_s / BIN_S)
        return [means.get(number) for number in range(max(0, now - _BINS), now)]

    def rate(self, time_s: float) -> float:
        """Count the readings of the last seconds, as readings a second."""
        first = max(0, int(time_s / BIN_S) - _RATE_BINS + 1)
        count = sum(one.readings for one in self._bins if one.number >= first)
        return count / max(time_s - first * BIN_S, BIN_S)

    def largest(self, time_s: float) -> float:
        """Give the largest pressure, kPa; 0 if there was none."""
        first = int(time_s / BIN_S) - _BINS
        return max((one.largest for one in self._bins if one.number >= first), default=0.0)

    def forget_largest(self) -> None:
        """Let the pressures so far count no more, as those before a tare."""
        for one in self._bins:
            one.largest = 0.0


class PadReader:
    """Read a source in a thread, and give a `PadView` of the latest at any time.

    A viewer that is slow misses views and never delays the reading. Use it in a `with`.
    """

    def __init__(
        self,
        source: Source,
        device: Device,
        name: str,
        calibration: Calibration | None = None,
        on_reading: Callable[[Reading], None] | None = None,
        on_tare: Callable[[Calibration], object] | None = None,
    ) -> None:
        """Prepare to read `source`, called `name` in messages.

        calibration: corrects what is shown; None shows the readings as they come. on_reading(reading) is called in
        the thread for each reading, corrected, and on_tare(calibration) when a tare was taken. Raises InputError if
        the calibration is not of this pad, or the readings are corrected already.
        """
        if calibration is not None and source.calibrated:
            raise InputError(f"{name} was recorded with a calibration of its own; give none")
        self.source, self.pad, self.device, self.name = source, source.pad, device, name
        self._calibration = calibration
        self._correction = None if calibration is None else Correction(calibration, source.pad)
        self.on_reading, self.on_tare = on_reading, on_tare
        self._places = taxels_of(source)
        self._kept = np.zeros(self.pad.taxels, dtype=bool)
        self._kept[self._places] = True if calibration is None else calibration.kept
        self._begun = time.monotonic()
        self._changed = Condition()
        self._stop = Event()
        self._history = History()
        self._usual = _SILENCE_S  # s from one reading to the next, as long as it speaks
        self._said_at = 0.0  # when the message was new
        self._taring: list[Reading] | None = None
        self._tare_until = 0.0
        self._view = PadView(tared=calibration is not None or source.calibrated)
        self.error: Exception | None = None  # what ended the reading, if something did
        self._thread = Thread(target=self._run, name=f"read {name}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(2 * _LONGEST_WAIT)

    @property
    def closed(self) -> bool:
        """Tell whether the `with` has ended."""
        return self._stop.is_set()

    def view(self) -> PadView:
        """Give the latest view. A pad that has not spoken for longer than it should is lost."""
        with self._changed:
            return self._aged(self._view)

    def wait(self, after: int, timeout: float) -> PadView:
        """Give the latest view as soon as its number is above `after`; the latest there is after `timeout`, s."""
        with self._changed:
            self._changed.wait_for(lambda: self._view.number > after or self._stop.is_set(), timeout)
            return self._aged(self._view)

    def history(self) -> list[float | None]:
        """Give the forces (N) of the last `HISTORY_S` in bins of `BIN_S`, the oldest first; None: nothing came."""
        with self._changed:
            ended = self._view.state == "ended"
            return self._history.forces((self._view.host_time if ended else time.monotonic()) - self._begun)

    def check(self) -> None:
        """Raise what ended the reading before its time, and NoReading if it was told to end before anything came."""
        if self.error is not None:
            raise self.error
        view = self.view()
        if not view.readings and view.trouble:
            raise NoReading(view.trouble)

    def tare(self) -> None:
        """Begin to take a tare of the next readings; the view's message tells what becomes of it."""
        with self._changed:
            if self.source.calibrated and not isinstance(self.source, Corrected):
                self._set(message="no tare: these readings are corrected already")
            elif self._taring is None:
                self._taring, self._tare_until = [], time.monotonic() + _TARE_S
                self._set(message="taking a tare: leave the pad alone")

    def _run(self) -> None:
        wait = min(self.device.deadline, _LONGEST_WAIT)
        try:
            while not self._stop.is_set():
                try:
                    reading = self.source.read(wait)
                except NoReading as error:
                    self._lost(str(error))
                    continue
                corrected = self._came(reading)
                if self.on_reading is not None:
                    self.on_reading(replace(reading, pressures=corrected))
        except SourceEnded:
            self._end("ended", "")
        except Exception as error:  # the caller raises it again, in the main thread
            self.error = error
            self._end("lost", str(error))

    def _came(self, reading: Reading) -> FloatArray:
        """Take in a reading; returns its pressures, corrected by the calibration there is."""
        now = time.monotonic()
        with self._changed:
            if self._taring is not None:
                reading = self._take_tare(reading, now)
            corrected = reading.pressures
            if self._correction is not None:
                corrected = self._correction.whole(corrected)
            pressures = np.full(self.pad.taxels, np.nan)
            pressures[self._places] = corrected
            pressures[~self._kept] = np.nan
            load = float(force(pressures[self._kept], self.pad))
            since = now - self._begun
            self._history.add(since, load, float(np.nanmax(pressures)))
            self._usual = 1 / self._history.rate(since)
            self._set(
                state="live", trouble="", pressures=pressures, host_time=now, readings=self._view.readings + 1,
                force=load, counters=self.source.counters.as_dict(),
            )  # fmt: skip
            return corrected

    def _lost(self, why: str) -> None:
        with self._changed:
            last = self._view.host_time or self._begun
            if time.monotonic() - last >= self._patience():
                if self._taring is not None:
                    self._taring = None
                    self._set(message="no tare: the pad was lost")
                self._set(state="lost", trouble=why, pressures=None, counters=self.source.counters.as_dict())

    def _end(self, state: State, trouble: str) -> None:
        with self._changed:
            self._set(state=state, trouble=trouble, pressures=None)

    def _patience(self) -> float:
        """Say for how long the pad may be silent before it is lost, s."""
        return min(max(_SILENCE_S, 5 * self._usual), max(self.device.deadline, _SILENCE_S))

    def _aged(self, view: PadView) -> PadView:
        """Say of a view what only the clock tells."""
        now = time.monotonic()
        silence = now - view.host_time
        if view.state == "live" and silence > self._patience():
            view = replace(view, state="lost", trouble=f"nothing came for {silence:.1f} s", pressures=None)
        since = now - self._begun
        return replace(
            view,
            rate=self._history.rate(since),
            scale=round_up(max(_LEAST_SCALE, self._history.largest(since))),
            message=view.message if now - self._said_at < _SAID_S else "",
            left_out=tuple(np.flatnonzero(~self._kept).tolist()),
        )

    def _take_tare(self, reading: Reading, now: float) -> Reading:
        """Add a reading to the tare, which the last one ends; returns the reading, corrected by that."""
        assert self._taring is not None
        corrected = self.source if isinstance(self.source, Corrected) else None
        self._taring.append(reading if corrected is None else corrected.uncorrected)
        if len(self._taring) < _TARE_FRAMES and now < self._tare_until:
            return reading
        readings, self._taring = self._taring, None
        try:
            if len(readings) < LEAST_FRAMES:
                raise InputError(f"only {len(readings)} readings came in {_TARE_S:g} s")
            taken = take_tare(readings, self.device, self.name)
            before = self._calibration if corrected is None else corrected.calibration
            if before is not None:
                taken = taken.model_copy(update={"gain": before.gain, "dead": before.dead})
            if self.on_reading is not None:  # who takes the readings cannot do without another taxel now
                wrong = [taxel for taxel in np.flatnonzero(~taken.kept).tolist() if self._kept[taxel]]
                if wrong:
                    raise InputError(
                        f"stuck or always loaded is {self.device.called(*wrong)}; `bench tare` and --calibration leave "
                        "such taxels out"
                    )
                if before is not None:
                    taken = taken.model_copy(update={"stuck": before.stuck, "loaded": before.loaded})
        except InputError as error:
            self._set(message=f"no tare: {error}")
            return reading
        if corrected is None:
            self._calibration, self._correction = taken, Correction(taken, self.pad)
        else:
            corrected.correct_by(taken)
            reading = corrected.apply(corrected.uncorrected)
        self._kept = taken.kept
        self._history.forget_largest()
        self._set(tared=True, message=f"tared, from {len(readings)} readings")
        if self.on_tare is not None:
            self.on_tare(taken)
        return reading

    def _set(self, **changes: Any) -> None:
        if "message" in changes:
            self._said_at = time.monotonic()
        self._view = replace(self._view, number=self._view.number + 1, **changes)
        self._changed.notify_all()


def round_up(value: float) -> float:
    """Give the next of 1, 2, 5, 10, 20 ... that is not below a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))
