"""Independent draws with replacement, in proportion to weights (compiled)."""

from __future__ import annotations

import numpy as np
from numba import int64, void

from tactsim.core.compiling import INTS, REALS, Ints, Reals, compiled


@compiled(void(REALS))
def sort_uniform(values: Reals) -> None:
    """Sort numbers that are uniform in [0, 1), in place: into as many buckets, which are then put in order."""
    count = len(values)
    place, unsorted = np.zeros(count + 1, dtype=np.int64), values.copy()
    for value in unsorted:
        place[int64(value * count) + 1] += 1
    for bucket in range(count):
        place[bucket + 1] += place[bucket]
    for value in unsorted:
        bucket = int64(value * count)
        values[place[bucket]] = value
        place[bucket] += 1
    for i in range(1, count):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@compiled(void(INTS, REALS, REALS))
def draw(chosen: Ints, weight: Reals, uniform: Reals) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. uniform: (draws,) in [0, 1), is sorted.
    """
    sort_uniform(uniform)
    total = weight.sum()
    index, reached = 0, weight[0]
    for i in range(len(chosen)):
        while reached <= uniform[i] * total and index < len(weight) - 1:
            index += 1
            reached += weight[index]
        chosen[i] = index
