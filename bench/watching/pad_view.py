"""What a pad says now: read in a thread of its own, and looked at by any number of viewers without waiting for them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.calibration import LEAST_FRAMES, Calibration, Correction, force, take_tare
from tactsim.hardware.device import Device

State = Literal["waiting", "live", "lost", "ended"]

BIN_S = 0.1  # s of one value of the history of force
HISTORY_S = 30.0
_BINS = round(HISTORY_S / BIN_S)
_RATE_S = 2.0  # s over which the rate is counted
_TARE_FRAMES = 100
_TARE_S = 30.0  # s within which they must come
_STUCK_FRAMES = 200  # readings in which a taxel must say the same to be called stuck
_SILENCE_S = 0.3  # s of silence that any pad is allowed
_LONGEST_WAIT = (
    1.0  # s: the source is asked so often at least, so that the thread ends soon when it is told to
)
_LEAST_SCALE = 10.0  # kPa: noise alone does not fill the scale


@dataclass(frozen=True, eq=False)
class PadView:
    """What the pad said last, and whether it still speaks.

    number: grows with every change. state: waiting (nothing came yet), live, lost (nothing comes), ended (a recording).
    trouble: why it is lost, or "". pressures: (taxels,) kPa of all taxels of the pad, NaN where one is left out; None
    unless live, so that nobody takes an old image for the pad. host_time: s, of that reading. since: s, how long ago
    the last reading came, None before the first. readings: how many came. rate: readings a second. force: N.
    scale: kPa, a round number above all pressures of the last seconds. left_out: taxels that the calibration leaves
    out. stuck: taxels that have not changed yet, while most did. message: what became of a tare.
    """

    number: int
    state: State
    trouble: str
    pressures: FloatArray | None
    host_time: float
    since: float | None
    readings: int
    rate: float
    force: float
    scale: float
    counters: dict[str, int]
    left_out: tuple[int, ...]
    stuck: tuple[int, ...]
    tared: bool
    message: str


class History:
    """The mean force in bins of `BIN_S`, of the last `HISTORY_S`."""

    def __init__(self) -> None:
        # Of each bin with a reading: its number, the sum of its forces, and how many. The last may still be filled.
        self._bins: deque[tuple[int, float, int]] = deque(maxlen=_BINS + 1)

    def add(self, time_s: float, force_n: float) -> None:
        """Add a force at `time_s`, s since the beginning; times do not fall."""
        number, total, count = int(time_s / BIN_S), 0.0, 0
        if self._bins and self._bins[-1][0] == number:
            _, total, count = self._bins.pop()
        self._bins.append((number, total + force_n, count + 1))

    def until(self, time_s: float) -> list[float | None]:
        """Give the bins that have ended by `time_s`, the oldest first; None is one without a reading."""
        means = {number: total / count for number, total, count in self._bins}
        now = int(time_s / BIN_S)
        return [means.get(number) for number in range(max(0, now - _BINS), now)]


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
        on_tare: Callable[[Calibration], None] | None = None,
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
        self._times: deque[float] = deque(maxlen=100_000)  # host times of the last seconds
        self._recent: deque[tuple[float, float]] = deque(maxlen=_BINS)  # (time, largest kPa)
        self._usual = _SILENCE_S  # s from one reading to the next, as long as it speaks
        self._taring: list[Reading] | None = None
        self._tare_until = 0.0
        self._first: FloatArray | None = None
        self._moved = np.zeros(
            len(self._places), dtype=bool
        )  # taxels that have said something else than at first
        self._view = PadView(
            number=0, state="waiting", trouble="", pressures=None, host_time=0.0, since=None, readings=0, rate=0.0,
            force=0.0, scale=_LEAST_SCALE, counters={}, left_out=self._left_out(), stuck=(),
            tared=calibration is not None or source.calibrated, message="",
        )  # fmt: skip
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
            return self._history.until((self._view.host_time if ended else time.monotonic()) - self._begun)

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
            if self.source.calibrated:
                self._say("no tare: these readings are corrected already")
            elif self._taring is None:
                self._taring, self._tare_until = [], time.monotonic() + _TARE_S
                self._say("taking a tare: leave the pad alone")

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
            self._first = reading.pressures if self._first is None else self._first
            self._moved |= reading.pressures != self._first
            if self._taring is not None:
                self._take_tare(reading, now)
            corrected = (
                reading.pressures if self._correction is None else self._correction.whole(reading.pressures)
            )
            pressures = np.full(self.pad.taxels, np.nan)
            pressures[self._places] = corrected
            pressures[~self._kept] = np.nan
            self._times.append(now)
            while self._times[0] < now - _RATE_S:
                self._times.popleft()
            largest = float(np.nanmax(pressures))
            if not self._recent or now - self._recent[-1][0] >= BIN_S:
                self._recent.append((now, largest))
            elif largest > self._recent[-1][1]:
                self._recent[-1] = (self._recent[-1][0], largest)
            load = float(force(pressures[self._kept], self.pad))
            self._history.add(now - self._begun, load)
            self._usual = min(_RATE_S, now - self._times[0]) / max(len(self._times) - 1, 1)
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
                    self._say("no tare: the pad was lost")
                self._set(state="lost", trouble=why, pressures=None, counters=self.source.counters.as_dict())

    def _end(self, state: State, trouble: str) -> None:
        with self._changed:
            self._set(state=state, trouble=trouble, pressures=None)

    def _patience(self) -> float:
        """Say for how long the pad may be silent before it is lost, s."""
        return min(max(_SILENCE_S, 5 * self._usual), max(self.device.deadline, _SILENCE_S))

    def _aged(self, view: PadView) -> PadView:
        now = time.monotonic()
        since = now - view.host_time if view.readings else None
        silent = view.state == "live" and since is not None and since > self._patience()
        recent = [largest for then, largest in self._recent if then > now - HISTORY_S]
        while self._times and self._times[0] < now - _RATE_S:
            self._times.popleft()
        return replace(
            view,
            state="lost" if silent else view.state,
            trouble=f"nothing came for {since:.1f} s" if silent else view.trouble,
            pressures=None if silent else view.pressures,
            since=since,
            rate=len(self._times) / min(_RATE_S, max(now - self._begun, BIN_S)),
            scale=round_up(max([_LEAST_SCALE, *recent])),
            left_out=self._left_out(),
            stuck=self._stuck() if view.readings >= _STUCK_FRAMES else (),
        )

    def _left_out(self) -> tuple[int, ...]:
        return tuple(np.flatnonzero(~self._kept).tolist())

    def _stuck(self) -> tuple[int, ...]:
        still = self._places[~self._moved]
        return tuple(still.tolist()) if 2 * len(still) < len(self._places) else ()

    def _take_tare(self, reading: Reading, now: float) -> None:
        assert self._taring is not None
        self._taring.append(reading)
        if len(self._taring) < _TARE_FRAMES and now < self._tare_until:
            return
        readings, self._taring = self._taring, None
        try:
            if len(readings) < LEAST_FRAMES:
                raise InputError(f"only {len(readings)} readings came in {_TARE_S:g} s")
            taken = take_tare(readings, self.device, self.name)
        except InputError as error:
            self._say(f"no tare: {error}")
            return
        if (
            taken.stuck or taken.loaded
        ) and self.on_reading is not None:  # who takes the readings cannot do without a taxel now
            wrong = ", ".join(map(str, taken.stuck + taken.loaded))
            self._say(
                f"no tare: stuck or always loaded is {wrong}; `bench tare` and --calibration leave such taxels out"
            )
            return
        if self._calibration is not None:
            taken = taken.model_copy(update={"gain": self._calibration.gain, "dead": self._calibration.dead})
        self._calibration, self._correction = taken, Correction(taken, self.pad)
        self._kept = taken.kept
        self._recent.clear()
        self._set(tared=True, message=f"tared, from {len(readings)} readings")
        if self.on_tare is not None:
            self.on_tare(taken)

    def _say(self, message: str) -> None:
        self._set(message=message)

    def _set(self, **changes: Any) -> None:
        self._view = replace(self._view, number=self._view.number + 1, **changes)
        self._changed.notify_all()


def taxels_of(source: Source) -> NDArray[np.int64]:
    """Find for each value of a source's readings which taxel of its pad it is; some may be left out."""
    apart = np.abs(source.taxel_xy[:, None] - source.pad.taxel_xy[None]).max(axis=-1)
    return apart.argmin(axis=1)


def round_up(value: float) -> float:
    """Give the next of 1, 2, 5, 10, 20 ... that is not below a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))
