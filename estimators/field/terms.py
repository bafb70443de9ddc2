"""The readings of a sequence as terms, in arrays that compiled code reads."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types

from tactsim.core.compiling import FLOATS, INTS, REALS, REALS_2D, Floats, Ints, Reals, compiled

# How far one operation in float32 may be off, relative to its result.
ROUNDING = 2.0**-23


class Terms(NamedTuple):
    """The terms of all readings so far; arrays may be longer than what is filled.

    start: (readings + 1,) where each reading's terms begin. kind, xy, weight: (terms,) the terms' table,
    place in the robot frame (mm) and factor. constant: (readings, letters) what a state far off the map
    gets. upper: (readings + 1,) cumulated, an upper bound of what any state gets. slack: (readings,) by
    how much rounding may move a sum.
    """

    start: Ints
    kind: Ints
    xy: Reals
    weight: Floats
    constant: Reals
    upper: Reals
    slack: Reals


TERMS = types.NamedTuple((INTS, INTS, REALS_2D, FLOATS, REALS_2D, REALS, REALS), Terms)


@compiled(int64(TERMS, int64, int64), called_from_python=False)
def of_one_place(terms: Terms, first: int, last: int) -> int:
    """Count the terms from number `first` on, `last` excluded, that follow each other at one place: a taxel's."""
    xy, count = terms.xy, 1
    while (
        first + count < last and xy[first + count, 0] == xy[first, 0] and xy[first + count, 1] == xy[first, 1]
    ):
        count += 1
    return count


@compiled(types.boolean(TERMS, int64, INTS, INTS, FLOATS, REALS_2D, REALS, REALS_2D, REALS, REALS))
def record(
    terms: Terms, reading: int, table: Ints, taxel: Ints, weight: Floats, taxel_xy: Reals, pose: Reals,
    outside: Reals, lowest: Reals, highest: Reals,
) -> bool:  # fmt: skip
    """Append a reading's evidence, taken at the pose sensor_in_robot; the arrays must have room.

    outside, lowest, highest: as in `field.tables.Tables`. Returns False, and appends nothing, if a table or taxel
    does not exist or a weight is negative or not finite.
    """
    begin = terms.start[reading]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    terms.constant[reading] = 0
    most = slack = 0.0
    for i in range(len(table)):
        kind, factor = table[i], float64(weight[i])
        if not (0 <= kind < len(highest) and 0 <= taxel[i] < len(taxel_xy) and 0 <= factor < np.inf):
            return False
        x, y = taxel_xy[taxel[i], 0], taxel_xy[taxel[i], 1]
        terms.kind[begin + i], terms.weight[begin + i] = kind, factor
        terms.xy[begin + i, 0] = pose[0] + cos * x - sin * y
        terms.xy[begin + i, 1] = pose[1] + sin * x + cos * y
        most += factor * highest[kind]
        slack += factor * max(abs(lowest[kind]), abs(highest[kind]))
        for letter in range(outside.shape[1]):
            terms.constant[reading, letter] += factor * outside[kind, letter]
    # Each of the additions may be off by that share of what the sum can have reached.
    terms.slack[reading] = slack * ROUNDING * (len(table) + 4)
    terms.upper[reading + 1] = terms.upper[reading] + most + terms.slack[reading]
    terms.start[reading + 1] = begin + len(table)
    return True
