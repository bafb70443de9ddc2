"""Poses in the plane: arrays [x, y, theta] in mm and rad that stand for rigid transforms, SE(2).

`a_in_b` maps points given in frame a to frame b, the paper's T_a^b. The paper's frames are the sensor S, the object O
and the robot R: sensor_in_object = robot_in_object * sensor_in_robot (T_S^O = T_R^O T_S^R, section III).
"""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
POSE = ("x", "y", "theta")  # the numbers of a pose in the plane; `rigid.POSE` has those of one in space


def algebra(numbers: int) -> ModuleType:
    """Give the module that has `compose`, `invert`, `log` and `exp` of poses of 3 numbers, or of 7: `rigid`."""
    if numbers == len(POSE):
        return sys.modules[__name__]
    from tactsim.core import rigid

    return rigid


def wrap_angle(angle: ArrayLike) -> FloatArray:
    """Fold angles (rad, any shape) into [-pi, pi)."""
    folded = np.mod(np.asarray(angle, dtype=float) + np.pi, 2 * np.pi) - np.pi
    return np.where(folded < np.pi, folded, -np.pi)  # just below -pi, the mod rounds up to 2 pi


def compose(outer: ArrayLike, inner: ArrayLike) -> FloatArray:
    """Multiply transforms, so that `compose(b_in_c, a_in_b)` gives a_in_c.

    Both are (..., 3) [mm, mm, rad] and broadcast; the result's angle lies in [-pi, pi).
    """
    outer, inner = np.asarray(outer, dtype=float), np.asarray(inner, dtype=float)
    cos, sin = np.cos(outer[..., 2]), np.sin(outer[..., 2])
    x = outer[..., 0] + cos * inner[..., 0] - sin * inner[..., 1]
    y = outer[..., 1] + sin * inner[..., 0] + cos * inner[..., 1]
    return np.stack([x, y, wrap_angle(outer[..., 2] + inner[..., 2])], axis=-1)


def invert(pose: ArrayLike) -> FloatArray:
    """Invert transforms of shape (..., 3), so that `invert(a_in_b)` gives b_in_a."""
    pose = np.asarray(pose, dtype=float)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = -cos * pose[..., 0] - sin * pose[..., 1]
    y = sin * pose[..., 0] - cos * pose[..., 1]
    return np.stack([x, y, wrap_angle(-pose[..., 2])], axis=-1)


def log(pose: ArrayLike) -> FloatArray:
    """Write transforms (..., 3) in the Lie algebra se(2): (..., 3) mm, mm, rad, of which `exp` makes the transform."""
    x, y, theta = np.moveaxis(np.asarray(pose, dtype=float), -1, 0)
    half = wrap_angle(theta) / 2
    along = np.cos(half) / np.sinc(half / np.pi)
    return np.stack([along * x + half * y, along * y - half * x, 2 * half], axis=-1)


def exp(vector: ArrayLike) -> FloatArray:
    """Make transforms (..., 3) of vectors (..., 3) of the Lie algebra se(2), mm, mm, rad: a screw along an arc."""
    x, y, turn = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    along = np.sinc(turn / np.pi)
    across = np.sin(turn / 2) * np.sinc(turn / (2 * np.pi))
    return np.stack([along * x - across * y, across * x + along * y, wrap_angle(turn)], axis=-1)


def transform(pose: ArrayLike, points: ArrayLike) -> FloatArray:
    """Map points (n, 2) mm by poses (..., 3): returns (..., n, 2) mm in the outer frame."""
    pose, points = np.asarray(pose, dtype=float), np.asarray(points, dtype=float)
    cos, sin = np.cos(pose[..., 2, None]), np.sin(pose[..., 2, None])
    x = pose[..., 0, None] + cos * points[:, 0] - sin * points[:, 1]
    y = pose[..., 1, None] + sin * points[:, 0] + cos * points[:, 1]
    return np.stack([x, y], axis=-1)
