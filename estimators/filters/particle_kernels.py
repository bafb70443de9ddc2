"""The inner loops of the particle filter: independent draws in proportion to weights, and the command update."""

from __future__ import annotations

import math

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, compiled


@compiled()
def draw(chosen: Ints1D, weight: Reals1D, spacing: Reals1D) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. weight: (n,). spacing: (draws + 1,) exponential random numbers: their running sums,
    as shares of the sum of all, are uniform numbers in ascending order, so that nothing needs to be sorted (Devroye
    1986, section V.3.1).
    """
    share, last = weight.sum() / spacing.sum(), len(weight) - 1
    index, filled, reached = 0, weight[0], 0.0
    for i in range(len(chosen)):
        reached += spacing[i] * share
        while reached >= filled and index < last:
            index += 1
            filled += weight[index]
        chosen[i] = index


@compiled()
def move(
    state: Reals2D, before: Reals2D, chosen: Ints1D, normal: Reals2D, noise: Reals1D, reach: float
) -> None:
    """Copy the chosen states and corrupt them with noise (command update); x and y stay within reach.

    state: (3, draws) T_R^O is overwritten. before: (3, n). chosen: (draws,) indices into it. normal: (3, draws) normal
    random numbers of deviation 1. noise: (3,) standard deviations, mm, mm, rad. reach: mm.
    """
    for axis in range(3):
        limit = reach if axis < 2 else math.inf
        for i in range(len(chosen)):
            moved = before[axis, chosen[i]] + noise[axis] * normal[axis, i]
            state[axis, i] = min(max(moved, -limit), limit)
