"""What taxels add to the cells of an occupancy map around them (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, void

from tactsim.core.compiling import REALS_2D, Reals, compiled

# Where both ratios times G' are at most this, the logarithm is summed as a series of so many terms, to 1e-17.
_SMALL, _TERMS = 0.01, 7


@compiled(void(REALS_2D, REALS_2D, float64, float64, float64, float64, float64))
def stamp(
    evidence: Reals, centres: Reals, sigma: float, peak: float, reach: float, above: float, below: float
) -> None:
    """Add log (1 + above G') / (1 + below G') of eq. 4 to the cells (rows, columns) around taxels.

    centres: (n, 2) [x, y] of the taxels. sigma: the point spread. All lengths are in cells. peak: G' at a taxel's
    centre. Cells farther than `reach` from a taxel are left out.
    """
    rows, columns = evidence.shape
    series = np.empty(_TERMS)
    for k in range(_TERMS):
        series[k] = (-1.0) ** k * (above ** (k + 1) - below ** (k + 1)) / (k + 1)
    small = _SMALL / max(abs(above), abs(below))
    along = np.empty(2 * math.ceil(reach) + 2)
    for i in range(len(centres)):
        x, y = centres[i]
        left, right = max(0, math.ceil(x - reach)), min(columns - 1, math.floor(x + reach))
        for column in range(left, right + 1):
            along[column - left] = math.exp(-2 * ((x - column) / sigma) ** 2)
        for row in range(max(0, math.ceil(y - reach)), min(rows - 1, math.floor(y + reach)) + 1):
            wide = math.sqrt(max(reach**2 - (y - row) ** 2, 0.0))
            across = peak * math.exp(-2 * ((y - row) / sigma) ** 2)
            for column in range(max(left, math.ceil(x - wide)), min(right, math.floor(x + wide)) + 1):
                g = across * along[column - left]
                if g > small:
                    evidence[row, column] += math.log((1 + above * g) / (1 + below * g))
                else:
                    added = 0.0
                    for k in range(_TERMS - 1, -1, -1):
                        added = g * (added + series[k])
                    evidence[row, column] += added
