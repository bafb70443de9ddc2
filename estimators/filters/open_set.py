"""None of the known letters: how well the best letter explains what was felt, and how well it should.

Open-set recognition: a filter over the known letters always names one of them. Whether the object is that
letter at all is told by the misfit of the readings: by how much their log-likelihood at the estimated pose
differs from what the letter's map expects,

    m = sum over taxels of [ log p(class) - sum_k p(k) log p(k) ],

compared with the misfit of the letter's own training readings, each looked up in a map without itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError, Scan, compose, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import NONE, Estimate
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.moving import Moving
from tactsim.estimators.filters.wrapper import Wrapper
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood

_HALF_LOG_2PI = math.log(2 * math.pi) / 2
_LEAST_VARIANCE = 1e-6  # nats^2: a map without information expects everything alike


@dataclass(frozen=True)
class Misfit:
    """How the misfit of one reading is spread for a letter's own readings, and where chance begins.

    mean, deviation: nats, of the letter's training readings, each against a map without itself.
    chance: nats, the mean of readings that are looked up where they were not taken.
    """

    mean: float
    deviation: float
    chance: float

    def log_odds(self, total: float, readings: int) -> float:
        """Weigh "none" against the letter by the summed misfit (nats) of its readings: log p(m | none) / p(m | letter).

        The letter's own sum is taken as normal. For another object the mean misfit of a reading is anything
        between the letter's own and chance, all alike, and the sum is spread about it as widely as the letter's own.
        """
        spread = self.deviation * math.sqrt(readings)
        z = (total - self.mean * readings) / spread if readings else 0.0
        width = (self.mean - self.chance) * readings / spread if readings else 0.0
        return _log_smeared(z, width) + z**2 / 2


class OpenSet(Wrapper):
    """A filter over the known letters, and beside it how probable it is that the object is none of them.

    The filter's pose must be as exact as its readings allow: in the middle of a bin of a millimetre, a letter
    fits as badly as another object would.
    """

    def __init__(self, filter: MapFilter | Moving, unknown: float) -> None:
        super().__init__(filter)
        self._unknown = unknown

    @property
    def calibrated(self) -> CalibratedLikelihood:
        """Give the calibrated model of the training readings, with which misfits are computed."""
        return self._model

    def fit(self, scan: Scan) -> None:
        """Learn the maps, and how well each letter's own training readings fit its map."""
        self.filter.fit(scan)
        if NONE in self.labels:
            raise InputError(f"a letter is called {NONE!r}: with unknown above 0 that means no known letter")
        self._model = self.filter.calibrated or CalibratedLikelihood(self.options)
        if self._model is not self.filter.calibrated:
            self._model.fit(scan, self.maps)
        self._misfit = {label: learn_misfit(self._model, label, scan) for label in self.labels}

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        self.filter.reset(rng)
        self._felt: list[tuple[FloatArray, FloatArray]] = []

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading, and keep it for the comparison with what the best letter's map expects."""
        self.filter.update(reading, sensor_in_robot)
        self._felt.append((np.array(reading, dtype=float), np.array(sensor_in_robot, dtype=float)))

    def estimate(self) -> Estimate:
        """Give "none" its share: the prior odds, times those of the misfit of the best letter."""
        from scipy.special import expit  # imported here: every filter imports this file, few need it

        known, total = self.filter.estimate(), 0.0
        if self._felt:
            readings, poses = (np.array(part) for part in zip(*self._felt, strict=True))
            xy = transform(compose(self.filter.path(known), poses), self.taxel_xy)
            total = float(misfits(self._model, known.label, xy, self._model.classes(readings)).sum())
        odds = self._misfit[known.label].log_odds(total, len(self._felt))
        none = float(expit(odds + math.log(self._unknown) - math.log1p(-self._unknown)))
        probabilities = {label: (1 - none) * p for label, p in known.probabilities.items()} | {NONE: none}
        best = max(probabilities, key=probabilities.__getitem__)
        return replace(known, label=best, probabilities=probabilities)


def misfits(model: CalibratedLikelihood, label: str, xy: FloatArray, classes: NDArray[np.int8]) -> FloatArray:
    """Compute the misfit (nats) of readings (n, taxels) at taxels (n, taxels, 2) mm on the object: (n,)."""
    return _misfits(model.log_tables(label, xy), classes)


def learn_misfit(model: CalibratedLikelihood, label: str, scan: Scan) -> Misfit:
    """Learn how the misfit of a letter's training readings in a scan is spread."""
    odds, classes = model.left_out(label, scan)
    log_p = np.log(model.calibration(odds))
    own = _misfits(log_p, classes)
    # At least what independent taxels would give, however few the training readings are.
    least = ((np.exp(log_p) * log_p**2).sum(axis=0) - (np.exp(log_p) * log_p).sum(axis=0) ** 2).sum(axis=1)
    # Every reading is looked up where another one was taken, as far away in the list as can be.
    elsewhere = np.roll(log_p, len(classes) // 2, axis=1)
    return Misfit(
        mean=float(own.mean()),
        deviation=math.sqrt(max(float(own.var()), float(least.mean()), _LEAST_VARIANCE)),
        chance=float(_misfits(elsewhere, classes).mean()),
    )


def _misfits(log_p: FloatArray, classes: NDArray[np.int8]) -> FloatArray:
    """Compare the log-likelihood of classes (n, taxels) with what log_p (classes, n, taxels) expects: (n,)."""
    found = np.take_along_axis(log_p, classes[None].astype(np.intp), axis=0)[0]
    return (found - (np.exp(log_p) * log_p).sum(axis=0)).sum(axis=-1)


def _log_smeared(z: float, width: float) -> float:
    """Compute log of the mean of the normal density over [z, z + width], relative to that at z, less z^2 / 2."""
    from scipy.special import log_ndtr

    if width < 1e-6:
        return -(z**2) / 2
    # The tail that is not rounded to 1.
    more, less = (z + width, z) if z < 0 else (-z, -z - width)
    top = float(log_ndtr(more))
    return top + math.log(-math.expm1(float(log_ndtr(less)) - top)) - math.log(width) + _HALF_LOG_2PI
