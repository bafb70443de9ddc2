"""What would tell "none of these" from the best letter: places of it where an unknown object may differ.

An unknown object is taken for one of many: the best letter, changed around one place b, where what is felt in contact
and what is not are exchanged. With the classes of a reading's taxels at places x on the object,

    p(c | x, b) = (1 - w) p(c | x) + w p(exchanged c | x),   w = exp(-|x - b|^2 / 2 r^2).

Readings so far say which of these objects it may still be. What another one would say of them is bounded by

    sum over b of p(b) min(KL_b, -log p(b)),   KL_b from p(. | letter) to p(. | b), summed over its taxels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core import compose, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood

# mm: places where an object may differ are as far apart, and reach as far.
_APART, _REACH = 4.0, 2.5
# The classes after contact and no contact are exchanged: No Contact, In Contact, Unknown.
_EXCHANGED = [1, 0, 2]


class Doubts:
    """The places where an unknown object may differ from a letter.

    places: (b, 2) mm, in a square grid, all that lie on some known letter.
    """

    def __init__(self, model: CalibratedLikelihood, taxel_xy: FloatArray) -> None:
        self._model, self._taxel_xy = model, taxel_xy
        low, high = model.extent
        ends = np.minimum(-low, high)
        x, y = (np.arange(-(end // _APART), end // _APART + 1) * _APART for end in ends)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        occupied = np.max([chart.log_odds_at(grid) for chart in model.maps.values()], axis=0) > 0
        self.places: FloatArray = grid[occupied]

    def weights(
        self, label: str, pose: FloatArray, readings: FloatArray, sensor_in_robot: FloatArray, unknown: float
    ) -> FloatArray:
        """Give p(b | readings) for an object that is a letter at T_R^O, or with the prior `unknown` none: (places,).

        readings: (n, taxels) kPa at sensor_in_robot (n, 3). What is left to 1 is the letter's.
        """
        log_weight = np.zeros(len(self.places))
        if len(readings):
            p, share = self._seen(label, pose, sensor_in_robot)
            classes = self._model.classes(readings)[None]
            own = np.take_along_axis(p, classes, axis=0)[0]
            other = np.take_along_axis(p[_EXCHANGED], classes, axis=0)[0]
            log_weight = np.log1p(share * (other / own - 1)).sum(axis=(1, 2))
        log_weight += np.log(unknown / max(len(self.places), 1)) - np.log1p(-unknown)
        top = max(0.0, log_weight.max(initial=0.0))
        weight = np.exp(log_weight - top)
        return np.asarray(weight / (weight.sum() + np.exp(-top)), dtype=float)

    def information(
        self, label: str, pose: FloatArray, weights: FloatArray, candidates: FloatArray
    ) -> FloatArray:
        """Bound what a reading at each candidate (n, 3) would say of the places with `weights`: (n,) nats."""
        p, share = self._seen(label, pose, candidates)
        change = share * (p[_EXCHANGED] - p)[:, None]
        divergence = ((p[:, None] + change) * np.log1p(change / p[:, None])).sum(axis=(0, 3))
        most = -np.log(np.maximum(weights, np.finfo(float).tiny))
        return np.asarray(weights @ np.minimum(divergence, most[:, None]), dtype=float)

    def _seen(
        self, label: str, pose: FloatArray, sensor_in_robot: FloatArray
    ) -> tuple[FloatArray, NDArray[np.float64]]:
        """Give p of the classes (3, n, taxels), and w of every place (places, n, taxels), for poses (n, 3)."""
        xy = transform(compose(pose, sensor_in_robot), self._taxel_xy)
        away = ((xy[None] - self.places[:, None, None]) ** 2).sum(axis=-1)
        return np.exp(self._model.log_tables(label, xy)), np.exp(-away / (2 * _REACH**2))
