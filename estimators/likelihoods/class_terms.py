"""The terms of a classified reading: one for each taxel that counts (compiled)."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, types

from tactsim.core.compiling import FLOATS, INTS, Floats, Ints, Reals, compiled

# Of any array: a scan's readings may not be written to, and a column of them is not contiguous.
_READING = types.Array(float64, 1, "A", readonly=True)


@compiled(types.Tuple((INTS, INTS, FLOATS))(_READING, float64, float64, boolean))
def class_terms(
    reading: Reals, threshold: float, ratio: float, with_unknown: bool
) -> tuple[Ints, Ints, Floats]:
    """Classify the taxels (taxels,) kPa of a reading by eq. 3, and make a term of each: the fields of `Evidence`.

    threshold: T, kPa. ratio: of the largest taxel. A term's table is the number of its class as in `classify`, its
    weight is 1. with_unknown: whether Unknown taxels are terms too.
    """
    share = -np.inf
    for value in reading:
        share = max(share, value)
    share *= ratio
    table, taxel = np.empty(len(reading), dtype=np.int64), np.empty(len(reading), dtype=np.int64)
    found = 0
    for k in range(len(reading)):
        above = (reading[k] > threshold) + (reading[k] > share)
        if above != 1 or with_unknown:
            table[found] = 0 if above == 0 else (1 if above == 2 else 2)
            taxel[found] = k
            found += 1
    return table[:found], taxel[:found], np.ones(found, dtype=np.float32)
