"""Independent draws with replacement, in proportion to weights (compiled)."""

from __future__ import annotations

import numpy as np
from numba import int64, uint64, void

from tactsim.core.compiling import INTS, REALS, Ints, Reals, compiled

_PARTS = 16  # of the merge, done in turns
_LARGEST = float(np.finfo(np.float64).max)


@compiled(int64(int64, REALS, REALS), called_from_python=False)
def _draws_within(steps: int, filled: Reals, reached: Reals) -> int:
    """Count the draws among the first steps of the merge, by bisection."""
    low, high = max(0, steps - len(filled) + 1), min(steps, len(reached) - 1)
    while low < high:
        middle = (low + high) // 2
        if filled[steps - middle - 1] > reached[middle]:
            low = middle + 1
        else:
            high = middle
    return low


@compiled(void(INTS, REALS, REALS))
def draw(chosen: Ints, weight: Reals, spacing: Reals) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. spacing: (draws + 1,) or more, exponential random numbers: their running sums, as
    shares of the sum of draws + 1, are uniform numbers in ascending order, so that nothing needs to be sorted
    (Devroye 1986, section V.3.1).

    They are merged with the running sums of the weights: a step passes one draw or one weight. Which of them cannot be
    foreseen, so there is no branch on it; equal parts of the steps are done in turns, since a step waits for the one
    before it.
    """
    draws, last = len(chosen), len(weight) - 1
    filled, reached, found = np.empty(last + 1), np.empty(draws + 1), np.empty(draws + 1, dtype=np.int64)
    both, total, whole = min(last, draws) + 1, 0.0, 0.0
    for i in range(uint64(both)):
        total += weight[i]
        whole += spacing[i]
        filled[i], reached[i] = total, whole
    for i in range(uint64(both), uint64(last + 1)):
        total += weight[i]
        filled[i] = total
    for i in range(uint64(both), uint64(draws + 1)):
        whole += spacing[i]
        reached[i] = whole
    scale = total / whole
    for i in range(uint64(draws)):
        reached[i] *= scale
    # No draw passes the last weight; all other weights are passed after the last draw.
    filled[last], reached[draws] = np.inf, _LARGEST
    steps = (draws + last) // _PARTS
    first_draw, first_weight = np.empty(_PARTS + 1, dtype=np.int64), np.empty(_PARTS + 1, dtype=np.int64)
    for part in range(_PARTS + 1):
        first_draw[part] = _draws_within(part * steps, filled, reached)
        first_weight[part] = part * steps - first_draw[part]
    at, beside = first_draw.astype(np.uint64), first_weight.astype(np.uint64)
    for _ in range(steps):
        for part in range(uint64(_PARTS)):
            i, index = at[part], beside[part]
            found[i] = index  # again, if it passes a weight
            passes = uint64(filled[index] <= reached[i])
            beside[part], at[part] = index + passes, i + (uint64(1) - passes)
    # What is left after equal parts; then each part's first draw, on which the part before may have ended.
    i, index = uint64(first_draw[_PARTS]), uint64(first_weight[_PARTS])
    while i < draws:
        found[i] = index
        passes = uint64(filled[index] <= reached[i])
        index, i = index + passes, i + (uint64(1) - passes)
    for part in range(_PARTS):
        index = uint64(first_weight[part])
        while filled[index] <= reached[first_draw[part]]:
            index += uint64(1)
        found[first_draw[part]] = index
    chosen[:] = found[:draws]
