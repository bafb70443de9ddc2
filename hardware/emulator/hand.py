"""The hand that presses an emulated pad: as a session asks, or by a timetable, as a robot does.

What a robot presses by a plan is recorded to a file, faster than it would take in truth.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.files import replacing
from tactsim.core.poses import FloatArray
from tactsim.hardware.emulator.emulated import Emulated, Faults, Pressures
from tactsim.hardware.recording import Kind, Tail
from tactsim.hardware.scans import Interval, PlacedPress, named_rows
from tactsim.hardware.session import Plan, Press, next_press, note, parse_mark

Wanted = Callable[[float], "FloatArray | None"]

_RETRY = 2.0  # s that a hand waits before it tries a press again
_LOOK = 0.05  # s between looks at a recording that is followed


class Pressing:
    """Pressures on a pad that rise and fall as under a hand.

    wanted(now): the pressures (taxels,) kPa that should be on the pad at `now`, or None for nothing.
    A press grows and fades within `ramp` s. Times must not decrease.
    """

    def __init__(self, taxels: int, wanted: Wanted, ramp: float = 0.1) -> None:
        self._wanted, self._ramp = wanted, ramp
        self._nothing = np.zeros(taxels)
        self._press: FloatArray | None = None
        self._level, self._then = 0.0, 0.0

    def __call__(self, now: float) -> FloatArray:
        """Give the pressures at `now` (s): (taxels,) kPa."""
        step = (now - self._then) / self._ramp
        self._then = now
        wanted = self._wanted(now)
        if self._press is not None and wanted is not self._press:
            self._level -= step
            if self._level <= 0:
                self._press, self._level = None, 0.0
        elif self._press is None:
            self._press = wanted
        else:
            self._level = min(self._level + step, 1.0)
        return self._nothing if self._press is None else self._level * self._press


class Follower:
    """Press what a guided session waits for, as its growing recording tells.

    press(plan): the pressures (n, taxels) kPa of the plan's presses. The pad is free for `lift` s before
    each press. A press that the session does not take within `hold` s is lifted and tried again. The pause
    before that is so long that a session that lags behind cannot mistake it for the next press.
    """

    def __init__(
        self, path: str | Path, press: Callable[[Plan], FloatArray], hold: float, lift: float
    ) -> None:
        self._tail, self._press, self._hold, self._lift = Tail(path), press, hold, lift
        self._plan: Plan | None = None
        self._rows: list[FloatArray] = []
        self._presses: dict[int, Press] = {}
        self._looked = self._since = -np.inf
        self._current = -1

    def __call__(self, now: float) -> FloatArray | None:
        """Give the press that is waited for at `now` (s), or None."""
        if now - self._looked >= _LOOK:
            self._looked = now
            for record in self._tail.poll():
                if record.kind is Kind.SEGMENT:
                    self._begin(record.json().get("plan"))
                elif record.kind is Kind.MARK:
                    note(self._presses, parse_mark(record.json(), len(self._rows)))
            current = len(self._rows) if self._plan is None else next_press(self._presses, self._plan)
            if current != self._current:
                self._current, self._since = current, now
        if self._current >= len(self._rows) or now - self._since < self._lift:
            return None
        held = (now - self._since - self._lift) % (self._hold + max(self._lift, _RETRY))
        return self._rows[self._current] if held < self._hold else None

    def _begin(self, content: object) -> None:
        if content is None:
            raise InputError("the recording that is followed is no guided session: it has no plan")
        plan = checked(Plan, content, "plan")
        self._current = -1  # a session that is resumed finds the pad free
        if plan != self._plan:
            self._plan, self._rows = plan, list(self._press(plan))


def read_plan(path: str | Path) -> list[PlacedPress]:
    """Read a plan: CSV with the columns label, split, x_mm, y_mm, theta_rad or theta_deg.

    Raises InputError with the wrong line.
    """
    return [checked(PlacedPress, row, place) for place, row in named_rows(path, "presses", PlacedPress)]


# Shares of its load at which it is known what a press feels on its way; in between it is interpolated.
SHARES = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Timing:
    """How long a robot takes, s: it lifts, presses harder for `ramp`, holds, and lets go for `ramp`.

    The load rises and falls evenly.
    """

    hold: float = 2.0
    lift: float = 0.5
    ramp: float = 0.1

    @property
    def period(self) -> float:
        """Give the time from one press to the next."""
        return self.lift + 2 * self.ramp + self.hold

    def intervals(self, plan: Sequence[PlacedPress]) -> list[Interval]:
        """Say when each press of the plan holds its full load."""
        begins = self.period * np.arange(len(plan)) + self.lift + self.ramp
        return [
            Interval(
                **press.model_dump(),
                first_s=round(float(begin), 6),
                last_s=round(float(begin) + self.hold, 6),
            )
            for press, begin in zip(plan, begins, strict=True)
        ]

    def pressing(self, table: FloatArray, again: bool = False) -> Pressures:
        """Press in turn, once or for ever. table: (n, shares, taxels) kPa, what is felt at the SHARES of the load."""
        nothing, at = np.zeros(table.shape[2]), (0.0, *SHARES)

        def pressures(now: float) -> FloatArray:
            turn, since = divmod(now, self.period)
            if since <= self.lift or (turn >= len(table) and not again):
                return nothing
            level = min((since - self.lift) / self.ramp, (self.period - since) / self.ramp, 1.0)
            above = int(np.searchsorted(SHARES, level)) + 1
            felt = [nothing, *table[int(turn) % len(table)]]
            part = (level - at[above - 1]) / (at[above] - at[above - 1])
            return (1 - part) * felt[above - 1] + part * felt[above]

        return pressures


def write_marks(intervals: Sequence[Interval], path: str | Path) -> None:
    """Write a marks file, which `read_intervals` reads. Whole or not at all."""
    text = StringIO()
    writer = csv.DictWriter(text, list(Interval.model_fields), lineterminator="\n")
    writer.writeheader()
    writer.writerows(interval.model_dump() for interval in intervals)
    with replacing(path) as stream:
        stream.write(text.getvalue().encode())


def record(
    device: Emulated,
    seconds: float,
    received: Callable[[bytes, float], object],
    faults: Faults | None = None,
    rng: np.random.Generator | None = None,
) -> None:
    """Give `received` all bytes that the device sends in `seconds`, with the time of each, without waiting for them.

    A device that waits for its start or for requests says nothing. faults: spoil the bytes, with `rng`.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    for now in np.arange(0.0, seconds, 1 / device.rate).tolist():
        for message in device.say(now):
            received(message if faults is None else faults.spoil(message, rng), now)
