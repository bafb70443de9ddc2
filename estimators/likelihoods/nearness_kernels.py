"""Which taxels lie near taxels of other readings (compiled)."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64
from numpy.typing import NDArray

from tactsim.core.compiling import INTS, REALS, Ints, Reals, compiled


@compiled(boolean[::1](REALS, REALS, INTS, float64))
def near_another_part(x: Reals, y: Reals, part: Ints, near: float) -> NDArray[np.bool_]:
    """Tell which points (n,) lie less than `near` from a point of another part.

    x, y: (n,), in order of x. part: (n,).
    """
    count = len(x)
    found = np.zeros(count, dtype=np.bool_)
    for i in range(count):
        for step in (-1, 1):
            j = i + step
            while not found[i] and 0 <= j < count and abs(x[j] - x[i]) < near:
                found[i] = part[j] != part[i] and (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 < near**2
                j += step
    return found
