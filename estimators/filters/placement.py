"""Where the object is, from weighted states: the posterior mean around a mode."""

from __future__ import annotations

import numpy as np

from tactsim.core import invert, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.weights import Weights

# The mean is over states whose placement is at most this far from the mode's: mm, in the metric of the placement
# error for a radius of gyration of 8 mm. Only the choice of the neighbourhood depends on that radius.
_NEAR, _GYRATION = 1.0, 8.0


def mean_around(state: FloatArray, weights: Weights, mode: int) -> FloatArray:
    """Average the object's placement over the states near the one of index `mode`: robot_in_object (3,).

    state: (3, n) T_R^O mm, mm, rad of one letter, with n weights. Placements, not states, are averaged,
    because a turn moves the state of the same placement. The angle's mean leaves out what is turned away,
    because a symmetric letter has copies that are as probable; the position's mean does not, because they
    say as much about where the letter is, and for an O all angles do.
    """
    placed = invert(state.T)
    best = placed[mode]
    turn = wrap_angle(placed[:, 2] - best[2])
    away = ((placed[:, :2] - best[:2]) ** 2).sum(axis=1)
    # The mode's own weight may underflow beside a heavier state elsewhere.
    weight = np.maximum(weights.relative, np.finfo(float).tiny)
    here = np.where(away <= _NEAR**2, weight, 0.0)
    alike = np.where(away + (_GYRATION * turn) ** 2 <= _NEAR**2, weight, 0.0)
    return invert(np.append(here @ placed[:, :2] / here.sum(), best[2] + alike @ turn / alike.sum()))
