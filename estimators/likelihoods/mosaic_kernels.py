"""The sums from which a mosaic's planes are fitted (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, void

from tactsim.core.compiling import Reals, compiled


@compiled(void(float64[:, :, ::1], float64[:, ::1], float64[::1], float64[::1], float64, float64))
def add_moments(
    moments: Reals, place: Reals, weight: Reals, value: Reals, sigma: float, reach: float
) -> None:
    """Add what taxels give to the normal equations of a plane around every node near them.

    moments: (rows, columns, 9): of the offsets (1, x, y) from the node the sums 11, 1x, 1y, xx, xy, yy, and of
    the value times (1, x, y). place: (n, 2) [x, y]. weight, value: (n,). sigma, reach: all lengths are in
    cells. A taxel at distance d has the weight times exp(-2 d^2 / sigma^2), none beyond `reach` in x or y.
    """
    rows, columns, _ = moments.shape
    along = np.empty(2 * math.ceil(reach) + 2)
    for i in range(len(weight)):
        x, y = place[i]
        left, right = max(0, math.ceil(x - reach)), min(columns - 1, math.floor(x + reach))
        for column in range(left, right + 1):
            along[column - left] = math.exp(-2 * ((x - column) / sigma) ** 2)
        for row in range(max(0, math.ceil(y - reach)), min(rows - 1, math.floor(y + reach)) + 1):
            dy = y - row
            across = weight[i] * math.exp(-2 * (dy / sigma) ** 2)
            for column in range(left, right + 1):
                dx, here = x - column, across * along[column - left]
                sums = moments[row, column]
                sums[0] += here
                sums[1] += here * dx
                sums[2] += here * dy
                sums[3] += here * dx * dx
                sums[4] += here * dx * dy
                sums[5] += here * dy * dy
                sums[6] += here * value[i]
                sums[7] += here * value[i] * dx
                sums[8] += here * value[i] * dy
