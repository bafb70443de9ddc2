"""Press an emulated pad as a hand would: one press after another, by the clock or as a session asks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.recording import Kind, Tail
from tactsim.hardware.session import Plan, Press, next_press, note, parse_press

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


def by_the_clock(table: FloatArray, hold: float, lift: float) -> Wanted:
    """Press the rows of `table` (n, taxels) kPa in turn for ever: `lift` s of nothing, then `hold` s of a row."""
    rows = list(table)

    def wanted(now: float) -> FloatArray | None:
        turn, since = divmod(now, hold + lift)
        return rows[int(turn) % len(rows)] if since >= lift else None

    return wanted


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
                    note(self._presses, parse_press(record.json(), len(self._rows)))
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
