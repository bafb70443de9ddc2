"""Where a scan presses: the paper's grid of 16 positions with 12 angles each (section II), or poses drawn off it.

A pad or a shape of another size has a stage of its own, made alike: what is scaled together is pressed alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.pad import Pad, relative_size
from tactsim.core.poses import FloatArray
from tactsim.models import Letter

POSITIONS = (-10.2, -3.4, 3.4, 10.2)  # mm along x and along y: 4 x 4 positions, 6.8 mm apart
ANGLES = 12
# mm; test poses off the grid have x and y in [-REACH, REACH], which is wider than what is trained on.
REACH = 12.0
_OUTERMOST, _GAP = POSITIONS[-1], POSITIONS[1] - POSITIONS[0]
_HALF = 5.8  # mm, half the paper's pad
_LARGEST = _OUTERMOST + _HALF  # mm from its middle that the rim of a letter of the catalogue lies at most
# A position's distance from the object's middle is at most this share of the distance at which the pad touches nothing
# any more. The paper's positions lie within it for all letters of the catalogue.
_TOUCHING = 0.56
_MOST_POSITIONS = 20  # along x or y: 4,800 presses


@dataclass(frozen=True)
class Stage:
    """Where an object is pressed: positions, mm along x and along y, and how far, mm, poses off the grid reach."""

    positions: tuple[float, ...] = POSITIONS
    reach: float = REACH

    @property
    def poses(self) -> int:
        """Count the poses of the grid."""
        return len(self.positions) ** 2 * ANGLES


PAPER = Stage()


def stage_for(pad: Pad, letter: Letter | None = None) -> Stage:
    """Lay out positions that cover a letter or shape with a pad: the paper's for its pad and its letters.

    A pad of another size moves them apart or together as much. A shape so large that the outermost would not reach its
    rim has more of them, no farther apart. Without a letter the pad alone says. Raises InputError for a shape that
    needs more than 20 along x.
    """
    ratio = relative_size(pad.taxel_xy)
    rim = _LARGEST * ratio if letter is None else float(np.abs(np.concatenate(letter.contours)).max())
    within = min(_OUTERMOST * ratio, _TOUCHING * (rim + _HALF * ratio))
    outermost = max(within, rim - _HALF * ratio)
    if math.isclose(outermost, _OUTERMOST):
        return PAPER
    count = max(len(POSITIONS), 1 + math.ceil(2 * outermost / (_GAP * ratio) - 1e-6))
    if letter is not None and count > _MOST_POSITIONS:
        most = (_MOST_POSITIONS - 1) * _GAP / 2 * ratio + _HALF * ratio
        raise InputError(
            f"{letter.name!r} reaches {rim:.4g} mm from its middle; with this pad a scan covers {most:.4g} mm: scale "
            "it down, or press it against a larger pad"
        )
    positions = np.linspace(-outermost, outermost, count)
    return Stage(tuple(positions.tolist()), REACH / _OUTERMOST * outermost)


def grid_poses(stage: Stage = PAPER) -> FloatArray:
    """List the poses of a stage's grid, (192, 3) sensor_in_object for the paper's.

    x varies slowest, then y, then the angle, k * 2 pi / 12 for k = 0 .. 11.
    """
    turns = 2 * np.pi * np.arange(ANGLES) / ANGLES
    x, y, angle = np.meshgrid(stage.positions, stage.positions, turns, indexing="ij")
    return np.stack([x, y, angle], axis=-1).reshape(-1, 3)


def random_poses(rng: np.random.Generator, count: int = PAPER.poses, reach: float = REACH) -> FloatArray:
    """Draw poses off the grid, (count, 3): x and y uniform in [-reach, reach] mm, theta on the circle."""
    return rng.uniform((-reach, -reach, 0.0), (reach, reach, 2 * np.pi), size=(count, 3))
