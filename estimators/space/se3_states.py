"""A belief about where one object is in space: the mean around a mode, and states that move."""

from __future__ import annotations

import numpy as np

from tactsim.core import rigid
from tactsim.core.poses import FloatArray

_NEAR, _GYRATION = 3.0, 15.0  # mm about the mode whose states are averaged; an angle counts at that lever


def mean_around(poses: FloatArray, weights: FloatArray, mode: int) -> FloatArray:
    """Average object_in_robot (n, 7) with weights (n,) over the states near the one of index `mode`: (7,).

    A symmetric object has copies that are as probable, far away: they are left out.
    """
    away = ((poses[:, :3] - poses[mode, :3]) ** 2).sum(axis=1)
    turn = rigid.angle_between(poses[mode, 3:], poses[:, 3:])
    weight = np.where(away + (_GYRATION * turn) ** 2 <= _NEAR**2, weights, 0.0)
    weight[mode] = max(weight[mode], np.finfo(float).tiny)
    weight = weight / weight.sum()
    off = rigid.to_vector(rigid.multiply(poses[:, 3:], rigid.conjugate(poses[mode, 3:])))
    turned = rigid.multiply(rigid.from_vector(weight @ off), poses[mode, 3:])
    return np.concatenate([weight @ poses[:, :3], turned / np.linalg.norm(turned)])
