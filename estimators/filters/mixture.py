"""Densities of mixtures of round normal distributions over placements (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, void

from tactsim.core.compiling import REALS, REALS_2D, Reals, compiled

# A part is left out where it is below exp(-_REACH) of its height.
_REACH = 14.0


@compiled(void(REALS_2D, REALS_2D, REALS_2D, REALS_2D, REALS, REALS, float64))
def add_densities(
    density: Reals, place: Reals, centre: Reals, weight: Reals, variance: Reals, spread: Reals, around: float
) -> None:
    """Add the densities of several mixtures with common centres, each with a width of its own.

    density: (places, mixtures), in mm^-3, is added to. place: (places, 3), centre: (centres, 3) mm, of which the
    third is an angle as a length that closes after `around` mm. weight: (centres, mixtures). variance: (mixtures,)
    mm^2 along each axis, to which a centre adds its own, spread: (centres,).
    """
    mixtures = len(variance)
    height, rate = np.empty((len(centre), mixtures)), np.empty((len(centre), mixtures))
    reach = np.zeros(len(centre))
    for i in range(len(centre)):
        for k in range(mixtures):
            whole = variance[k] + spread[i]
            height[i, k] = weight[i, k] / (2 * math.pi * whole) ** 1.5
            rate[i, k] = 0.5 / whole
            if weight[i, k] > 0:
                reach[i] = max(reach[i], _REACH / rate[i, k])
    for j in range(len(place)):
        for i in range(len(centre)):
            dx, dy = place[j, 0] - centre[i, 0], place[j, 1] - centre[i, 1]
            away = dx * dx + dy * dy
            if away > reach[i]:
                continue
            turn = abs(place[j, 2] - centre[i, 2])
            turn = min(turn, abs(around - turn))
            away += turn * turn
            for k in range(mixtures):
                exponent = away * rate[i, k]
                if exponent < _REACH and height[i, k] > 0:
                    density[j, k] += height[i, k] * math.exp(-exponent)
