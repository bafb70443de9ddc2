"""How many particles are enough: KLD-sampling (Fox 2003)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, uint64

from tactsim.core.compiling import INTS, REALS_2D, Ints, Reals, compiled

_EMPTY = -1


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

    mm, rad: the sides of a bin; rad is made smaller so that a whole number of bins closes the circle. most: as many
    particles as will be added at most.
    """

    def __init__(self, mm: float, rad: float, most: int) -> None:
        self._mm, self._around = mm, max(1, math.ceil(2 * math.pi / rad))
        # A table of keys with open addressing, at most half full.
        self._keys = np.full(2 ** math.ceil(math.log2(2 * most + 2)), _EMPTY)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, letter: Ints, state: Reals) -> None:
        """Add particles: letter (n,), state (3, n) T_R^O mm, mm, rad."""
        self._count += add_keys(self._keys, letter, np.ascontiguousarray(state), self._mm, self._around)


@compiled(int64(INTS, INTS, REALS_2D, float64, int64))
def add_keys(keys: Ints, letter: Ints, state: Reals, mm: float, around: int) -> int:
    """Add the bins of states to a table of keys, as many as a power of two; returns how many are new.

    x and y may be up to 2^19 bins from 0, which is more than `reach` allows.
    """
    last, new, half = uint64(len(keys) - 1), 0, int64(2**19)
    for i in range(len(letter)):
        turn = state[2, i] / (2 * math.pi)
        angle = int64((turn - math.floor(turn)) * around)
        x, y = int64(math.floor(state[0, i] / mm)) + half, int64(math.floor(state[1, i] / mm)) + half
        key = ((letter[i] * around + angle) << 40) | (y << 20) | x
        place = ((uint64(key) * uint64(0x9E3779B97F4A7C15)) >> uint64(20)) & last
        while keys[place] != _EMPTY and keys[place] != key:
            place = (place + uint64(1)) & last
        new += keys[place] == _EMPTY
        keys[place] = key
    return new
