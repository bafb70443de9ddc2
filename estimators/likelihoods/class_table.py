"""What a map predicts against what was felt: probabilities counted from training readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

# Added to each count, so that what was never seen is improbable and not impossible.
_UNSEEN = 1.0


@dataclass(frozen=True, eq=False)
class Calibration:
    """p(class | feature) of one taxel, linear between the bins in which it was counted.

    feature: (bins,) ascending, the mean of each bin. probability: (classes, bins), columns summing to 1.
    """

    feature: FloatArray
    probability: FloatArray

    def __call__(self, feature: FloatArray) -> FloatArray:
        """Give p(class | feature), (classes, ...) for features (...); beyond the bins it is constant."""
        return np.stack([np.interp(feature, self.feature, row) for row in self.probability])


def calibrate(
    feature: FloatArray, kinds: NDArray[np.integer], classes: int, edges: FloatArray
) -> Calibration:
    """Count how often each class goes with each feature.

    feature, kinds: (n,), n from 1, what was predicted for a taxel and which of 0..classes - 1 it
    was. edges: (bins - 1,) ascending, between the bins of the feature; empty bins are left out. One
    more of each class than was seen is counted in each bin (Laplace's rule).
    """
    edges = np.unique(edges)
    place = np.searchsorted(edges, feature, side="right")
    total = np.bincount(place, minlength=len(edges) + 1)
    sums = np.bincount(place, feature, minlength=len(edges) + 1)
    # Classes come in 8 bits, which do not hold that many pairs.
    pairs = np.bincount(kinds.astype(np.int64) * len(total) + place, minlength=classes * len(total))
    used = total > 0
    count = pairs.reshape(classes, -1)[:, used] + _UNSEEN
    return Calibration(sums[used] / total[used], count / count.sum(axis=0))


def quantile_edges(feature: FloatArray, bins: int) -> FloatArray:
    """Divide features (n,) into bins that hold equally many: the (bins - 1,) edges between them."""
    return np.quantile(feature, np.arange(1, bins) / bins)
