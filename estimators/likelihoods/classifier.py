"""The contact classifier: what one taxel of a reading says, taken alone (paper, eq. 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

NO_CONTACT, CONTACT, UNKNOWN = 0, 1, 2


def classify(readings: ArrayLike, threshold: float = 2.0, ratio: float = 0.3) -> NDArray[np.int8]:
    """Classify taxels as NO_CONTACT, CONTACT or UNKNOWN (paper, eq. 3).

    readings: (..., taxels) kPa; `threshold` is the paper's T in kPa, `ratio` its 0.3 of the largest
    taxel of the same reading. A taxel is in contact above both and without contact below both.
    The paper prints "<" for the second; "<=" is used, so that a reading of zeros is evidence of
    emptiness and a taxel equal to T is not lost. Returns (..., taxels).
    """
    values = np.asarray(readings, dtype=float)
    share = ratio * values.max(axis=-1, keepdims=True, initial=-np.inf)
    above = (values > threshold).view(np.int8) + (values > share).view(np.int8)
    return _BY_COUNT[above]


# How many of the two limits a taxel exceeds: none, one, both.
_BY_COUNT = np.array([NO_CONTACT, UNKNOWN, CONTACT], dtype=np.int8)
