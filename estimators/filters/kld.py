"""How many particles are enough: KLD-sampling (Fox 2003)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray


def enough(bins: int, error: float, z: float) -> int:
    """Say how many independent draws bring a histogram near what they are drawn from (Fox 2003, eq. 7).

    With so many, the Kullback-Leibler divergence of the histogram from a distribution over so many bins is below
    `error` with the probability whose upper standard normal quantile is z: chi^2 of bins - 1 degrees of freedom over
    2 error, chi^2 by Wilson and Hilferty's approximation. One bin needs one draw.
    """
    if bins < 2:
        return 1
    ninth = 2 / (9 * (bins - 1))
    return math.ceil((bins - 1) / (2 * error) * (1 - ninth + math.sqrt(ninth) * z) ** 3)


class OccupiedBins:
    """Count the bins of letter, x, y and angle in which particles lie, while they are drawn.

    mm, rad: the sides of a bin; rad is made smaller so that a whole number of bins closes the circle.
    """

    def __init__(self, mm: float, rad: float) -> None:
        self._mm, self._around = mm, max(1, math.ceil(2 * math.pi / rad))
        self._keys = np.empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, letter: NDArray[np.int64], state: FloatArray) -> None:
        """Add particles: letter (n,), state (3, n) T_R^O mm, mm, rad.

        x and y may be up to 2^19 bins from 0, which is more than `reach` allows.
        """
        x, y = np.floor(state[:2] / self._mm).astype(np.int64) + 2**19
        angle = (state[2] / (2 * math.pi) % 1 * self._around).astype(np.int64)
        self._keys = np.union1d(self._keys, ((letter * self._around + angle) << 40) | (y << 20) | x)
