"""What is drawn for a trial in space before anything is touched: the hidden pose, and where touches begin."""

from __future__ import annotations

import numpy as np

from tactsim.core import rigid
from tactsim.core.poses import FloatArray

HALF_BOX = 20.0  # mm: the object's origin, and the point that a touch aims at, lie in this box about the robot's origin


def draw_true_pose(rng: np.random.Generator) -> FloatArray:
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
