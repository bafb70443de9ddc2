"""Check that numbers from outside are finite and no larger than any pad can measure."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

# kPa, mm or rad: no reading, pad or pose is larger, and sums of squares stay far from overflow.
LARGEST = 1e9


def finite(values: ArrayLike, name: str) -> FloatArray:
    """Return numbers of any shape as float64.

    name: what the numbers are, for the message. Raises InputError that names the first number that is NaN,
    infinite or larger in size than LARGEST.
    """
    array = np.asarray(values, dtype=np.float64)
    allowed = np.abs(array) <= LARGEST
    if not allowed.all():
        first = tuple(np.argwhere(~allowed)[0].tolist())
        place = ", ".join(map(str, first))
        raise InputError(
            f"{name}[{place}] is {array[first]}; only finite numbers up to {LARGEST:g} are allowed"
        )
    return array
