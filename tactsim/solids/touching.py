"""How a trial in space touches its hidden solid: where the solid lies, where touches begin, and with what pads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactsim.bench.trials import OneTrial, Touch, generator
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.documents import parse_toml
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.models import Solid
    from tactsim.solids import Hand, HandPress, SpaceOptions, SpacePress
    from tactsim.solids.press import Touched

HALF_BOX = 20.0  # mm: the object's origin, and the point that a touch aims at, lie in this box about the robot's origin
OFFERED = 40  # touches among which an estimator may choose the next
HANDS = ("gripper",)  # those that come along


def draw_pose_in_space(rng: np.random.Generator) -> FloatArray:
    """Draw robot_in_object (7,): the object's origin even in the box about the robot's, all rotations alike."""
    place = rng.uniform(-HALF_BOX, HALF_BOX, size=3)
    return rigid.invert(np.concatenate([place, rigid.random_rotations(1, rng)[0]]))


def draw_starts(count: int, outside: float, rng: np.random.Generator) -> FloatArray:
    """Draw where touches begin, sensor_in_robot (count, 7).

    The direction is even over the sphere, the point aimed at even in the box, the turn about the normal even. The pad
    starts `outside` mm before the robot's origin, measured along its normal.
    """
    rotation = rigid.random_rotations(count, rng)
    aim = rng.uniform(-HALF_BOX, HALF_BOX, size=(count, 3))
    normal = rigid.turned(rotation, np.array([0.0, 0.0, 1.0]))
    back = outside + np.einsum("ij,ij->i", aim, normal)
    return np.concatenate([aim - back[:, None] * normal, rotation], axis=1)


def outside_of(radius: float) -> float:
    """Say how far from the robot's origin no point of an object of that radius about its origin can be, mm."""
    return float(np.sqrt(3) * HALF_BOX + radius)


def draw_hands(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw where a hand closes, hand_in_robot (count, 7): its origin even in the box, its rotation even."""
    place = rng.uniform(-HALF_BOX, HALF_BOX, size=(count, 3))
    return np.concatenate([place, rigid.random_rotations(count, rng)], axis=1)


def load_hand(hand: Path) -> Hand:
    """Read a hand that comes along, by its name, or a hand file. Raises InputError if it is none."""
    from tactsim.solids import Hand

    if str(hand) in HANDS:
        text = (files("tactsim.solids") / "hands" / f"{hand}.toml").read_bytes()
        return checked(Hand, parse_toml(text, f"hand {hand}"), f"hand {hand}")
    return Hand.load(hand)


@dataclass(frozen=True)
class SolidPress:
    """Touch the solids of a scan wherever a trial asks, with one pad, or with the pads of a hand at once.

    hand: see `load_hand`; None: one pad, which comes along its normal.
    """

    options: SpaceOptions
    hand: Path | None = None

    def touches(self, truth: str, trial: int, seed: int) -> SolidTouches:
        """Offer the touches of one trial."""
        task = OneTrial(truth, trial)
        return SolidTouches(self, truth, generator(seed, task, 2), generator(seed, task, 3))

    def starts(self, rng: np.random.Generator) -> FloatArray:
        """Draw where a touch may begin: (OFFERED, 7) sensor_in_robot, or hand_in_robot."""
        if self.hand is not None:
            return draw_hands(OFFERED, rng)
        return draw_starts(OFFERED, outside_of(max(one.radius for one in self._solids)), rng)

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator) -> Touched:
        """Touch from one start (7,) in the object frame: m touches, one of each pad."""
        press = self._press
        return press.sensed(press.touch(label, start[None] if self.hand is None else start, rng), rng)

    @cached_property
    def _solids(self) -> list[Solid]:
        from tactsim.solids import solids_of

        return solids_of(self.options)

    @cached_property
    def _press(self) -> SpacePress | HandPress:
        """Make what touches. Raises InputError if pads of the hand overlap."""
        from tactsim.solids import HandPress, SpacePress

        if self.hand is not None:
            return HandPress(self._solids, load_hand(self.hand), self.options)
        return SpacePress(self._solids, self.options)

    def __getstate__(self) -> Mapping[str, object]:
        """Go to another process without what was built."""
        return {"options": self.options, "hand": self.hand}


class SolidTouches:
    """The touches of a trial: for each, `OFFERED` starts are drawn anew; see `trials.Touches`.

    An estimator that chooses is offered what one that does not is, which takes the first.
    """

    def __init__(
        self, press: SolidPress, truth: str, offer: np.random.Generator, disturb: np.random.Generator
    ) -> None:
        self._press, self._truth, self._offer, self._disturb = press, truth, offer, disturb
        self._taken = 0

    def shuffle(self, rng: np.random.Generator) -> None:
        """Leave them as they are: they are drawn at random."""

    def offer(self, robot_in_object: FloatArray) -> FloatArray:
        """Draw where the next touch may begin; see `SolidPress.starts`."""
        self._starts = self._press.starts(self._offer)
        return self._starts

    def take(self, chosen: int, robot_in_object: FloatArray) -> Touch:
        """Touch from one of the starts just offered."""
        start, number = self._starts[chosen], self._taken
        self._taken += 1
        rng = np.random.default_rng(self._disturb.integers(2**63))
        touched = self._press.touch(self._truth, rigid.compose(robot_in_object, start), rng)
        sensors_in_robot = rigid.compose(rigid.invert(robot_in_object), touched.stated)
        return Touch(
            number,
            touched.readings,
            sensors_in_robot,
            {"start": start, "met": int(np.count_nonzero(touched.met))},
        )
