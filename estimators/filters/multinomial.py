"""Independent draws with replacement, in proportion to weights (compiled)."""

from __future__ import annotations

import numpy as np
from numba import void

from tactsim.core.compiling import INTS, REALS, Ints, Reals, compiled


@compiled(void(INTS, REALS, REALS))
def draw(chosen: Ints, weight: Reals, spacing: Reals) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. spacing: (draws + 1,) or more, exponential random numbers: their running sums, as
    shares of the sum of draws + 1, are uniform numbers in ascending order, so that nothing needs to be sorted
    (Devroye 1986, section V.3.1).
    """
    whole, total = 0.0, 0.0
    for i in range(len(chosen) + 1):
        whole += spacing[i]
    for one in weight:
        total += one
    scale, reached, last = total / whole, 0.0, len(weight) - 1
    index, filled = np.int64(0), weight[0]
    for i in range(len(chosen)):
        reached += spacing[i]
        while filled <= reached * scale and index < last:
            index += 1
            filled += weight[index]
        chosen[i] = index
