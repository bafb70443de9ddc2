"""Densities of mixtures of round normal distributions over placements (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled

# A part is left out where it is below exp(-_REACH) of its height.
_REACH = 14.0


@compiled(void(REALS_2D, REALS_2D, REALS_2D, REALS, REALS, INTS, float64))
def add_densities(
    density: Reals, place: Reals, centre: Reals, weight: Reals, variance: Reals, mixture: Ints, around: float
) -> None:
    """Add the densities of several mixtures of round normal distributions.

    density: (places, mixtures), in mm^-3, is added to. place: (places, 3), centre: (parts, 3) mm, of which the
    third is an angle as a length that closes after `around` mm. weight, variance, mixture: (parts,) of each part its
    weight, its mm^2 along each axis, and of which mixture it is.
    """
    height, rate, reach = np.empty(len(centre)), np.empty(len(centre)), np.empty(len(centre))
    for i in range(len(centre)):
        height[i] = weight[i] / (2 * math.pi * variance[i]) ** 1.5
        rate[i] = 0.5 / variance[i]
        reach[i] = _REACH / rate[i] if weight[i] > 0 else 0.0
    for j in range(len(place)):
        for i in range(len(centre)):
            dx, dy = place[j, 0] - centre[i, 0], place[j, 1] - centre[i, 1]
            away = dx * dx + dy * dy
            if away >= reach[i]:
                continue
            turn = abs(place[j, 2] - centre[i, 2])
            turn = min(turn, abs(around - turn))
            away += turn * turn
            if away < reach[i]:
                density[j, mixture[i]] += height[i] * math.exp(-away * rate[i])
