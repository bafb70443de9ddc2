"""Where the object is, from weighted states: the posterior mean around a mode."""

from __future__ import annotations

import numpy as np

from tactsim import invert, wrap_angle
from tactsim.poses import FloatArray

# The mean is over what lies this near the mode, mm in the metric of the placement error for a radius of
# gyration of 8 mm; only the choice of the neighbourhood depends on it.
_NEAR, _GYRATION = 1.0, 8.0


def mean_around(state: FloatArray, log_weight: FloatArray, mode: int) -> FloatArray:
    """Average the object's placement over the states near the one of index `mode`: robot_in_object (3,).

    state: (3, n) T_R^O mm, mm, rad of one letter. log_weight: (n,). Placements, not states, are averaged,
    because a turn moves the state of the same placement; and only near ones, because a symmetric letter has
    others, turned, that are as probable.
    """
    placed = invert(state.T)
    best = placed[mode]
    turn = wrap_angle(placed[:, 2] - best[2])
    away = ((placed[:, :2] - best[:2]) ** 2).sum(axis=1) + (_GYRATION * turn) ** 2
    weight = np.where(away <= _NEAR**2, np.exp(log_weight - log_weight.max()), 0.0)
    # The mode's own weight may underflow beside a heavier state elsewhere.
    weight[mode] += np.finfo(float).tiny
    weight /= weight.sum()
    return invert(np.append(weight @ placed[:, :2], best[2] + weight @ turn))
