"""Drawing from weighted states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray


def systematic(weight: FloatArray, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Draw `count` indices in proportion to weights (n,), each as often as is due, rounded up or down.

    Ascending. Systematic resampling (Kitagawa 1996): one random number, the least variance for its cost.
    """
    reached = np.cumsum(weight)
    ladder = (np.arange(count) + rng.random()) / count * reached[-1]
    return np.minimum(np.searchsorted(reached, ladder, side="right"), len(weight) - 1)
