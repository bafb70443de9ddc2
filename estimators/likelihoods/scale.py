"""The scale of a reading: nearly the pressure of the taxels that are wholly covered; and the threshold that follows."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tactsim.core.poses import FloatArray

# T as a share of the median scale of the training readings; the paper's 2 kPa in simulated presses with 2 N.
_SHARE = 1 / 18


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
