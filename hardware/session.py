"""A guided recording of one object, press by press: a state machine without a terminal or a port.

The recording is the session's journal. Each press that was taken or skipped is a mark in it, and the
mark names the press's readings by their numbers. So a stopped session can go on where it ended, and its
scan can be worked out again from the raw bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from threading import RLock
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, Field, field_validator, model_validator

from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.scan import is_label
from tactsim.hardware.calibration import Calibration, force
from tactsim.hardware.codecs.codec import STRICT

_LIFTED = 5  # readings without touch after which a press is over

_STILL_TOUCHED = 3.0  # s after which a person is told that something still touches the pad

_STEADY = 0.03  # sd over mean that a steady hand may give force and image, in addition to the sensor's noise
# At most, for 4 readings or more: n var(total - noise variance) / sum of the noise variances squared.
_SPREAD = 4.0

_ZERO_MOVED = "its zero has moved; take a tare while nothing touches it"

_GIVE_UP = 30.0  # s beyond its patience after which a machine's press is given up


class Plan(BaseModel):
    """What a session is to record; every segment of its recording holds it.

    poses: sensor_in_object [mm, mm, rad] of each press, in order.
    """

    model_config = STRICT

    label: str = Field(min_length=1, max_length=100)
    split: Literal["train", "test"] = "train"
    poses: tuple[tuple[float, float, float], ...] = Field(min_length=1, max_length=100_000)
    enough: int | None = Field(None, ge=1, description="presses that end the session; None: all are wanted")
    frames: int = Field(20, ge=1, le=10_000, description="readings whose mean is a press")
    window: int = Field(10, ge=4, le=1000, description="readings over which a press must be steady")
    touch_kpa: float = Field(2.0, gt=0, description="kPa above which a taxel is touched")
    least_force: float = Field(0.3, ge=0, description="N that a press must have on the taxels that are read")
    most_force: float = Field(20.0, gt=0, description="N")
    patience: float | None = Field(
        None, gt=0, description="s after which a press is taken as it is; None: wait for a person to say so"
    )

    @field_validator("label")
    @classmethod
    def _can_be_a_label(cls, label: str) -> str:
        if not is_label(label):
            raise ValueError("a label has 1 to 100 printable characters")
        return label

    @model_validator(mode="after")
    def _ordered(self) -> Plan:
        if self.least_force >= self.most_force:
            raise ValueError(
                f"least_force {self.least_force:g} N must be below most_force {self.most_force:g} N"
            )
        if self.enough is not None and self.enough > len(self.poses):
            raise ValueError(f"{self.enough} presses of {len(self.poses)} cannot be enough")
        return self


class Press(BaseModel):
    """A mark of a recording: what was done about press `number` of the plan.

    taken: its reading is the mean of `count` readings of the recording, from number `first` on. skipped:
    it is left out. redo: it is to be pressed again, and earlier marks of it are void. A later mark of a
    press replaces earlier ones.
    """

    model_config = STRICT

    number: int = Field(ge=0)
    what: Literal["taken", "skipped", "redo"]
    first: int = Field(0, ge=0)
    count: int = Field(0, ge=0, le=10_000)


class Tare(BaseModel):
    """A mark of a recording: a tare that was taken in the session, which corrects from reading `first` on."""

    model_config = STRICT

    first: int = Field(ge=0)
    calibration: Calibration


class Phase(Enum):
    """What a session waits for."""

    LIFT = "lift it off the pad"
    TOUCH = "press it on the pad"
    STEADY = "hold it still"
    TAKING = "hold it: reading"
    DONE = "all presses are recorded"


@dataclass
class Session:
    """Lead through the presses of a plan.

    presses: those already recorded or skipped, by number. current: the press that is asked for.
    message: what is wrong with the press so far, or "". image: (taxels,) kPa, the last press taken. called(k): names
    the taxel that value k of a reading is.
    """

    plan: Plan
    pad: Pad
    presses: dict[int, Press] = field(default_factory=dict)
    current: int = 0
    phase: Phase = Phase.LIFT
    message: str = ""
    image: FloatArray | None = None
    called: Callable[[int], str] = str

    def __post_init__(self) -> None:
        self._recent: deque[FloatArray] = deque(maxlen=self.plan.window)  # images, kPa
        self._taken: list[Reading] = []
        self._untouched = 0
        self._below = ""  # says that an untouched pad reads less than nothing
        self._since: float | None = None  # host time from which the press has been waited for
        self._before: list[int] = []  # presses in the order in which they were recorded, for `redo`
        self.current = next_press(self.presses, self.plan)
        self._begin(Phase.LIFT)

    @property
    def progress(self) -> float:
        """Give the share of the current press's readings that have come, 0 to 1."""
        return len(self._taken) / self.plan.frames

    def take(self, reading: Reading, number: int) -> Press | None:
        """Take in reading `number` of the recording; returns the press that it completes, or None.

        The caller writes the press into the recording as a mark. A lost link, or a device that began anew, voids
        the press that is open. Raises InputError if a machine's press does not come to an end.
        """
        if self.phase is Phase.DONE:
            return None
        if self._since is None:
            self._since = reading.host_time
        if reading.after_loss:
            self._since = reading.host_time
            self._begin(Phase.LIFT if self.phase is Phase.LIFT else Phase.TOUCH)
            self.message = "the pad was lost for a moment; hold the press again"
        touched = bool(reading.pressures.max(initial=-np.inf) > self.plan.touch_kpa)
        self._give_up(reading.host_time)
        if self.phase is Phase.LIFT:
            self._untouched = 0 if touched else self._untouched + 1
            if touched and reading.host_time - self._since > _STILL_TOUCHED:
                most = int(np.argmax(reading.pressures))
                self.message = (
                    f"taxel {self.called(most)} still reads {reading.pressures[most]:.1f} kPa; lift everything off; "
                    f"if nothing lies on the pad, {_ZERO_MOVED}"
                )
            if self._untouched >= _LIFTED:
                self.message = ""
                self._begin(Phase.TOUCH)
                self._since = reading.host_time
        elif self.phase is Phase.TOUCH:
            if touched:
                self._begin(Phase.STEADY)
            else:
                self._watch_zero(reading.pressures)
        elif self.phase is Phase.STEADY:
            self._settle(reading.pressures, touched)
        elif self.phase is Phase.TAKING:
            return self._read(reading, number)
        patience = self.plan.patience
        waits = self.phase in (Phase.TOUCH, Phase.STEADY)
        if waits and patience is not None and reading.host_time - self._since > patience:
            self.take_anyway()
        return None

    def tared(self) -> None:
        """Begin the open press anew, since what readings are measured from has changed."""
        if self.phase is not Phase.DONE:
            self._begin(Phase.LIFT)
            self.message, self._below, self._since = "", "", None

    def take_anyway(self) -> None:
        """Take the press from now on, touched or not: a hole of the object may lie over the pad."""
        if self.phase is not Phase.DONE:
            self._begin(Phase.TAKING)
            self.message = ""

    def skip(self) -> Press | None:
        """Leave out the current press; returns the mark to write, or None when all are done."""
        if self.phase is Phase.DONE:
            return None
        return self._finish(Press(number=self.current, what="skipped"))

    def redo(self) -> Press | None:
        """Go back to the press before, to record it again; returns the mark to write, or None if there is none."""
        number = self._before.pop() if self._before else max(self.presses, default=-1)
        if number < 0:
            return None
        return self._finish(Press(number=number, what="redo"), f"again press {number + 1}")

    def _begin(self, phase: Phase) -> None:
        done = self.current >= len(self.plan.poses)
        self.phase = Phase.DONE if done else phase
        self._recent.clear()
        self._taken = []
        self._untouched = 0

    def _watch_zero(self, pressures: FloatArray) -> None:
        """Say so where a pad that nothing touches reads the force of a press, or a taxel far less than nothing.

        What reads too much may be at rest again in a moment, as a sheet that was pressed is; what reads too little is a
        zero that has moved, and a person's presses wait for a tare.
        """
        self._recent.append(pressures)
        if len(self._recent) < self.plan.window:
            return
        level = np.mean(self._recent, axis=0)
        least, felt = int(level.argmin()), float(force(level, self.pad))
        low = level[least] < -self.plan.touch_kpa or -felt > self.plan.least_force > 0
        self._below = ""
        if low or felt > self.plan.least_force > 0:
            self.message = (
                f"untouched, the pad reads {felt:.2f} N, taxel {self.called(least)} {level[least]:.1f} kPa: "
                f"{_ZERO_MOVED}"
            )
            self._below = self.message if low and self.plan.patience is None else ""
        elif _ZERO_MOVED in self.message:
            self.message = ""

    def _give_up(self, now: float) -> None:
        """End a session that nobody watches and that gets nowhere: its recording would grow without end."""
        patience = self.plan.patience
        if patience is None or self._since is None or now - self._since <= patience + _GIVE_UP:
            return
        missing = "it does not come to rest"
        if self.phase is Phase.LIFT:
            missing = "the pad is never free; lift before each press, or take a tare"
        raise InputError(f"press {self.current + 1} was given up after {now - self._since:.0f} s: {missing}")

    def _settle(self, pressures: FloatArray, touched: bool) -> None:
        if not touched:
            self._begin(Phase.TOUCH)
            return
        self._recent.append(pressures)
        if len(self._recent) < self.plan.window:
            return
        images = np.array(self._recent)
        mean = float(force(images, self.pad).mean())
        if self._moves(images) or self._below:
            self.message = self._below
        elif mean < self.plan.least_force:
            self.message = f"{mean:.2f} N is too little; press with {self.plan.least_force:g} N or more"
        elif mean > self.plan.most_force:
            self.message = f"{mean:.1f} N is too much; press with {self.plan.most_force:g} N or less"
        else:
            self.message = ""
            self._begin(Phase.TAKING)

    def _read(self, reading: Reading, number: int) -> Press | None:
        self._taken.append(reading)
        if len(self._taken) < self.plan.frames:
            return None
        pressures = np.array([each.pressures for each in self._taken])
        if self._moves(pressures):
            self._begin(Phase.STEADY)
            self.message = "it moved; hold it still"
            return None
        self.image = pressures.mean(axis=0)
        first = number - len(self._taken) + 1
        return self._finish(Press(number=self.current, what="taken", first=first, count=len(self._taken)))

    def _moves(self, images: FloatArray) -> bool:
        """Tell whether force or image (n, taxels) kPa change by more than noise and a steady hand explain.

        A slide at constant force changes the image alone.
        """
        forces = force(images, self.pad)
        held = max(float(forces.mean()), self.plan.least_force)
        image = max(float(np.linalg.norm(images.mean(axis=0))), self.plan.touch_kpa)
        return wanders(forces[:, None], _STEADY * held) or wanders(images, _STEADY * image)

    def _finish(self, press: Press, message: str = "") -> Press:
        note(self.presses, press)
        if press.what != "redo":
            self._before.append(press.number)
        self.current = next_press(self.presses, self.plan)
        self.message = message
        self._begin(Phase.LIFT)
        self._since = None
        return press


def wanders(values: FloatArray, allowed: float) -> bool:
    """Tell whether values (n, k) move by more than `allowed`, an sd of all k together, and their noise.

    The noise is taken from second differences (von Neumann): slow movement, which is looked for, hardly adds to them.
    """
    count = len(values)
    if count < 4:
        return False
    total = values.var(axis=0, ddof=1)
    noise = (np.diff(values, 2, axis=0) ** 2).mean(axis=0) / 6
    chance = 3 * np.sqrt(_SPREAD / count * np.square(noise).sum())
    return bool((total - noise).sum() > allowed**2 + chance)


def note(presses: dict[int, Press], mark: Press | Tare) -> None:
    """Enter a mark into `presses`, those that are done, by number; a tare is none."""
    if isinstance(mark, Tare):
        return
    if mark.what == "redo":
        presses.pop(mark.number, None)
    else:
        presses[mark.number] = mark


def next_press(presses: Mapping[int, Press], plan: Plan) -> int:
    """Find the first press that is neither recorded nor skipped; the number of poses if no more are wanted."""
    total = len(plan.poses)
    if plan.enough is not None and count_taken(presses) >= plan.enough:
        return total
    return next((number for number in range(total) if number not in presses), total)


def count_taken(presses: Mapping[int, Press]) -> int:
    """Count the presses that were taken; the others were skipped."""
    return sum(press.what == "taken" for press in presses.values())


def parse_mark(content: Mapping[str, Any], total: int) -> Press | Tare:
    """Read a mark of a recording. Raises InputError if it is neither a tare nor a press of a plan with `total`."""
    if "calibration" in content:
        return checked(Tare, content, "mark")
    press = checked(Press, content, "mark")
    if press.number >= total:
        raise InputError(f"mark: press {press.number} of a session with {total}")
    return press


KEYS = {" ": "take", "r": "redo", "s": "skip", "n": "begin"}  # on a terminal, of the commands that there are


class Leader:
    """Take readings of the pad and commands of a person, one at a time, and pass on each press that is done.

    session: what is asked for. choosing: whether nothing is asked for until it is known what.
    """

    def __init__(
        self, session: Session, first: int = 0, done: Callable[[Press], None] = lambda press: None
    ) -> None:
        """Prepare to lead. first: number of the next reading. done(press): is told what became of each press."""
        self.session, self.choosing = session, False
        self.changed = RLock()
        self._count, self._done = first, done

    def take(self, reading: Reading) -> None:
        """Take in a reading of the pad; called in the thread that reads. Raises InputError as `Session.take` does."""
        with self.changed:
            number, self._count = self._count, self._count + 1
            if not self.choosing:
                self.after(self.session.take(reading, number), reading.host_time)

    def after(self, press: Press | None, came: float) -> None:
        """Pass on what became of a press, if something did, with the reading that came at `came`, s."""
        if press is not None:
            self._done(press)

    def tared(self, calibration: Calibration) -> int:
        """Begin the open press anew, from another zero; returns the number of the first reading that it corrects."""
        with self.changed:
            self.session.tared()
            return self._count

    def asked(self) -> int | None:
        """Give the number of the press that should be on the pad now; None while the pad should be free."""
        with self.changed:
            waits = self.choosing or self.session.phase in (Phase.LIFT, Phase.DONE)
            return None if waits else self.session.current

    def commands(self) -> dict[str, Callable[[], None]]:
        """Name what a person may ask for."""
        return {"take": self.take_anyway, "redo": self.redo, "skip": self.skip}

    def obey(self, key: str) -> None:
        """Do what a key of the terminal asks for, if it asks for something."""
        if command := self.commands().get(KEYS.get(key, "")):
            command()

    def take_anyway(self) -> None:
        """Take the press that is asked for as it is from now on."""
        with self.changed:
            if not self.choosing:
                self.session.take_anyway()

    def skip(self) -> None:
        """Leave out the press that is asked for."""
        with self.changed:
            if not self.choosing:
                self.after(self.session.skip(), 0.0)

    def redo(self) -> None:
        """Ask for the last press again."""
        with self.changed:
            self.after(self.session.redo(), 0.0)
