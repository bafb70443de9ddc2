"""What touches a hidden solid in a trial: one pad, or the pads of a hand."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.space.draws import draw_hands, draw_starts, outside_of
from tactsim.core.checking import checked
from tactsim.core.documents import parse_toml
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.bench.space.space_config import SpaceConfig
    from tactsim.models import Solid
    from tactsim.press.space import Hand, HandPress, SpacePress

HANDS = ("gripper",)  # those that come along


class Touching(Protocol):
    """What touches a hidden object: one pad, or the pads of a hand."""

    def starts(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw where touches may begin: (count, 7) sensor_in_robot, or hand_in_robot."""

    def touch(
        self, label: str, start: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Touch from one start (7,) in the object frame.

        Returns readings (m, taxels) kPa as sensed, the pads' rest poses (m, 7) in the object frame as the robot states
        them, and which pads met the object (m,).
        """


@dataclass(frozen=True, eq=False)
class OnePad:
    """One pad that comes along its normal. outside: mm before the robot's origin where it starts."""

    press: SpacePress
    outside: float

    def starts(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw where touches begin; see `draws.draw_starts`."""
        return draw_starts(count, self.outside, rng)

    def touch(
        self, label: str, start: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Touch from one start (7,) in the object frame; see `Touching`."""
        touched = self.press.sensed(self.press.touch(label, start[None], rng), rng)
        return touched.readings, touched.stated, touched.met


@dataclass(frozen=True, eq=False)
class SeveralPads:
    """A hand whose pads close at once."""

    press: HandPress

    def starts(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw where the hand closes; see `draws.draw_hands`."""
        return draw_hands(count, rng)

    def touch(
        self, label: str, start: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Close the hand at one pose (7,) in the object frame; see `Touching`."""
        touched = self.press.sensed(self.press.touch(label, start, rng), rng)
        return touched.readings, touched.stated, touched.met


def load_hand(hand: Path) -> Hand:
    """Read a hand that comes along, by its name, or a hand file. Raises InputError if it is none."""
    from tactsim.press.space import Hand

    if str(hand) in HANDS:
        text = (files("tactsim.bench") / "space" / "hands" / f"{hand}.toml").read_bytes()
        return checked(Hand, parse_toml(text, f"hand {hand}"), f"hand {hand}")
    return Hand.load(hand)


def pads(solids: list[Solid], config: SpaceConfig) -> Touching:
    """Make what a run touches with. Raises InputError if pads of its hand overlap."""
    from tactsim.press.space import HandPress, SpacePress

    if config.hand is not None:
        return SeveralPads(HandPress(solids, load_hand(config.hand), config.scan_options))
    outside = outside_of(max(one.radius for one in solids))
    return OnePad(SpacePress(solids, config.scan_options), outside)
