"""A belief about where one object is in space: the mean around a mode, and states that move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.poses import FloatArray

_TRIED = 50  # states, chosen evenly by weight, of which one is the middle of the mode
_NEAR, _GYRATION = 3.0, 15.0  # mm about the mode whose states are averaged; an angle counts at that lever


def mean_around(poses: FloatArray, weights: FloatArray) -> FloatArray:
    """Average object_in_robot (n, 7) with weights (n,) over the states of the mode that holds the most: (7,).

    A symmetric object has copies that are as probable, far away, and others may look alike: they are left out.
    """
    reached = np.cumsum(weights)
    chosen = np.unique(np.searchsorted(reached, (np.arange(_TRIED) + 0.5) / _TRIED * reached[-1]))
    near = _near(poses, chosen)
    best = int((near @ weights).argmax())
    mode, weight = int(chosen[best]), np.where(near[best], weights, 0.0)
    weight = weight / weight.sum()
    off = rigid.to_vector(rigid.multiply(poses[:, 3:], rigid.conjugate(poses[mode, 3:])))
    turned = rigid.multiply(rigid.from_vector(weight @ off), poses[mode, 3:])
    return np.concatenate([weight @ poses[:, :3], turned / np.linalg.norm(turned)])


def _near(poses: FloatArray, chosen: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which poses (n, 7) are near those of the indices (k,): (k, n)."""
    away = ((poses[chosen, None, :3] - poses[:, :3]) ** 2).sum(axis=2)
    turn = 2 * np.arccos(np.minimum(np.abs(poses[chosen, 3:] @ poses[:, 3:].T), 1.0))
    return np.asarray(away + (_GYRATION * turn) ** 2 <= _NEAR**2)
