"""A guided recording of one letter, press by press: a state machine without a terminal or a port.

A session's journal is the recording itself: each press that was taken or skipped is a mark in it,
which names the readings by their number. So a session goes on where it was stopped, whatever
stopped it, and its scan is computed from the raw bytes again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from pydantic import BaseModel, Field, model_validator

from hardware.calibration import force
from hardware.codecs.base import STRICT
from hardware.device import checked
from models.errors import InputError
from tactsim.pad import Pad
from tactsim.poses import FloatArray
from tactsim.reading import Reading

_LIFTED = 5  # readings without touch after which a press is over
_STEADY = 0.05  # relative change of the force within the window of a steady press, beyond its noise
_HELD = 0.15  # relative change of the force during a press beyond which it is taken anew


class Plan(BaseModel):
    """What a session is to record; it stands in the recording's first segment.

    poses: sensor_in_object [mm, mm, rad] of each press, in order.
    """

    model_config = STRICT

    label: str = Field(min_length=1, max_length=100)
    split: str = Field("train", pattern="^(train|test)$")
    poses: tuple[tuple[float, float, float], ...] = Field(min_length=1, max_length=100_000)
    frames: int = Field(20, ge=1, le=10_000, description="readings whose mean is a press")
    window: int = Field(10, ge=2, le=1000, description="readings over which a press must be steady")
    touch_kpa: float = Field(2.0, gt=0, description="kPa above which an element is touched")
    least_force: float = Field(
        0.3, ge=0, description="N that a press must have on the elements that are read"
    )
    most_force: float = Field(20.0, gt=0, description="N")
    patience: float | None = Field(
        None, gt=0, description="s after which a press is taken as it is; None: wait for a person to say so"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Plan:
        if self.least_force >= self.most_force:
            raise ValueError(
                f"least_force {self.least_force:g} N must be below most_force {self.most_force:g} N"
            )
        return self


class Press(BaseModel):
    """A mark of a recording: press `number` of the plan is the mean of `count` readings from `first` on.

    count is 0 for a press that was skipped. A later mark of the same press replaces an earlier one.
    """

    model_config = STRICT

    number: int = Field(ge=0)
    first: int = Field(ge=0)
    count: int = Field(ge=0, le=10_000)


class Phase(Enum):
    """What a session waits for."""

    LIFT = "lift the letter off the pad"
    TOUCH = "press the letter on the pad"
    STEADY = "hold it still"
    TAKING = "hold it: reading"
    DONE = "all presses are recorded"


@dataclass
class Session:
    """Lead through the presses of a plan.

    presses: those already recorded or skipped, by number. current: the press that is asked for.
    message: what is wrong with the press so far, or "". image: (taxels,) kPa, the last press taken.
    """

    plan: Plan
    pad: Pad
    presses: dict[int, Press] = field(default_factory=dict)
    current: int = 0
    phase: Phase = Phase.LIFT
    message: str = ""
    image: FloatArray | None = None

    def __post_init__(self) -> None:
        self._recent: deque[float] = deque(maxlen=self.plan.window)  # forces, N
        self._taken: list[Reading] = []
        self._untouched = 0
        self._forced = False
        self._held = 0.0  # N, when the reading of the press began
        self._since: float | None = None  # host time from which the press has been waited for
        self._before: list[int] = []  # presses in the order in which they were recorded, for `redo`
        self.current = next_press(self.presses, len(self.plan.poses))
        self._begin(Phase.LIFT)

    @property
    def progress(self) -> float:
        """Give the share of the current press that has been read."""
        return len(self._taken) / self.plan.frames

    def take(self, reading: Reading, number: int) -> Press | None:
        """Take in reading `number` of the recording; returns the press if that completes one.

        The caller marks the press in the recording.
        """
        if self.phase is Phase.DONE:
            return None
        if self._since is None:
            self._since = reading.host_time
        touched = bool(reading.pressures.max(initial=-np.inf) > self.plan.touch_kpa)
        now = float(force(reading.pressures, self.pad))
        if self.phase is Phase.LIFT:
            self._untouched = 0 if touched else self._untouched + 1
            if self._untouched >= _LIFTED:
                self._begin(Phase.TOUCH)
                self._since = reading.host_time
        elif self.phase is Phase.TOUCH:
            if touched:
                self._begin(Phase.STEADY)
                self.message = ""
        elif self.phase is Phase.STEADY:
            self._settle(now, touched)
        elif self.phase is Phase.TAKING:
            return self._read(reading, number, now)
        patience = self.plan.patience
        waits = self.phase in (Phase.TOUCH, Phase.STEADY)
        if waits and patience is not None and reading.host_time - self._since > patience:
            self.take_anyway()
        return None

    def take_anyway(self) -> None:
        """Start reading now, touched or not: a hole of the letter may lie over the pad."""
        if self.phase is not Phase.DONE:
            self._begin(Phase.TAKING)
            self.message = ""
            self._forced = True

    def skip(self, number: int) -> Press | None:
        """Leave out the current press; returns what to mark. `number`: of the next reading."""
        if self.phase is Phase.DONE:
            return None
        return self._finish(Press(number=self.current, first=number, count=0), Phase.TOUCH)

    def redo(self) -> None:
        """Go back to the press before, to record it anew."""
        if self._before:
            self.current = self._before.pop()
        elif self.current > 0:
            self.current -= 1
        self.message = f"again press {self.current + 1}"
        self._begin(Phase.LIFT)

    def _begin(self, phase: Phase) -> None:
        done = self.current >= len(self.plan.poses)
        self.phase = Phase.DONE if done else phase
        self._recent.clear()
        self._taken = []
        self._untouched = 0
        self._forced = False

    def _settle(self, now: float, touched: bool) -> None:
        if not touched:
            self._begin(Phase.TOUCH)
            return
        self._recent.append(now)
        if len(self._recent) < self.plan.window:
            return
        forces = np.array(self._recent)
        half = len(forces) // 2
        mean = float(forces.mean())
        noise = float(np.sqrt(np.mean(np.diff(forces) ** 2) / 2))  # of one reading; a slow rise is not in it
        change = abs(float(forces[:half].mean() - forces[-half:].mean()))
        if change > _STEADY * mean + 3 * noise * np.sqrt(2 / half):
            self.message = ""
        elif mean < self.plan.least_force:
            self.message = f"{mean:.2f} N is too little; press with {self.plan.least_force:g} N or more"
        elif mean > self.plan.most_force:
            self.message = f"{mean:.1f} N is too much; press with {self.plan.most_force:g} N or less"
        else:
            self.message = ""
            self._begin(Phase.TAKING)

    def _read(self, reading: Reading, number: int, now: float) -> Press | None:
        self._taken.append(reading)
        self._recent.append(now)
        first = number - len(self._taken) + 1
        if not self._forced and len(self._recent) == self.plan.window:
            # Windows, not single readings: noise on all elements adds up in the force.
            mean = float(np.mean(self._recent))
            if len(self._taken) == self.plan.window:
                self._held = mean
            elif abs(mean - self._held) > _HELD * max(self._held, self.plan.least_force):
                self._begin(Phase.STEADY)
                self.message = "it moved; hold it still"
                return None
        if len(self._taken) < self.plan.frames:
            return None
        self.image = np.mean([each.pressures for each in self._taken], axis=0)
        press = Press(number=self.current, first=first, count=len(self._taken))
        return self._finish(press, Phase.TOUCH if self._forced else Phase.LIFT)

    def _finish(self, press: Press, phase: Phase) -> Press:
        self.presses[press.number] = press
        self._before.append(press.number)
        self.current = next_press(self.presses, len(self.plan.poses))
        self.message = ""
        self._begin(phase)
        self._since = None
        return press


def next_press(presses: Mapping[int, Press], total: int) -> int:
    """Find the first press that is neither recorded nor skipped; `total` if there is none."""
    return next((number for number in range(total) if number not in presses), total)


def parse_press(content: Mapping[str, Any], total: int) -> Press:
    """Read a mark of a recording. Raises InputError if it is no press of a plan with `total`."""
    press = checked(Press, content, "mark")
    if press.number >= total:
        raise InputError(f"mark: press {press.number} of a session with {total}")
    return press
