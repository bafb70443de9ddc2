"""Least squares with a few unknowns, none of which may be negative."""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np

from tactsim.core.poses import FloatArray

# Errors are equal if they differ by less than this share of what is fitted, squared: that may be rounding.
_ROUNDING = 1e-12


def non_negative(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Find the factors (n,) from 0 of columns (m, n) whose sum is nearest to `wanted` (m,); n is a few.

    Those that are not 0 solve least squares by themselves (Lawson and Hanson 1974), so all 2^n choices of columns are
    tried. Of equally good ones, as of columns that are alike, the one whose factors have the smallest sum is taken.
    `scipy.optimize.nnls` is made for many unknowns; to import it takes 0.17 s and 38 MB, to try 16 choices 0.3 ms.
    """
    # The same least squares with n + 1 rows at most, however many there are.
    triangle = np.asarray(np.linalg.qr(np.column_stack([columns, wanted]), mode="r"))
    columns, wanted = triangle[:, :-1], triangle[:, -1]
    count = columns.shape[1]
    factors, least = np.zeros(count), float(wanted @ wanted)
    rounding = _ROUNDING * least
    # Columns of very different size are of one: what is small beside another is not nothing.
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    even = columns / size
    for chosen in chain.from_iterable(combinations(range(count), some) for some in range(1, count + 1)):
        some = list(chosen)
        solved = np.linalg.lstsq(even[:, some], wanted, rcond=None)[0]
        error, found = float(np.square(even[:, some] @ solved - wanted).sum()), solved / size[some]
        better = error < least - rounding
        smaller = error <= least + rounding and found.sum() < factors.sum()
        if (found >= 0).all() and (better or smaller):
            factors, least = np.zeros(count), error
            factors[some] = found
    return factors
