"""The contact classifier, what one taxel of a reading says, taken alone (paper, eq. 3), and its threshold.

The threshold may follow from the scale of the readings: nearly the pressure of taxels that are wholly covered.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.poses import FloatArray

NO_CONTACT, CONTACT, UNKNOWN = 0, 1, 2

# T as a share of the median scale of the training readings; the paper's 2 kPa in simulated presses with 2 N.
_SHARE = 1 / 18


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


def lehmer_mean(readings: FloatArray) -> FloatArray:
    """Take the Lehmer mean L4, sum z^4 / sum z^3, over the taxels z of readings (..., taxels): (...) kPa.

    It is the scale of a reading: nearly the pressure of taxels that are wholly covered, with less noise
    than the largest taxel has. Taxels below 0 count as 0.
    """
    pressed = np.maximum(readings, 0)
    top = pressed.max(axis=-1)
    share = pressed / np.where(top > 0, top, 1)[..., None]
    return top * (share**4).sum(axis=-1) / np.maximum((share**3).sum(axis=-1), 1)


def threshold_of(threshold: float | Literal["auto"], train: FloatArray) -> float:
    """Give T of eq. 3, kPa: the one asked for, or for "auto" a share of the median scale of training readings.

    train: (n, taxels). Then classes do not depend on the unit of the readings.
    """
    if threshold == "auto":
        return _SHARE * float(np.median(lehmer_mean(train))) if len(train) else 0.0
    return threshold
