"""The graded measurement model: how often each share of the reading's own pressure goes with a map's value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.calibrated import (
    CalibratedLikelihood,
    Calibration,
    CountedOptions,
    calibrate,
    quantile_edges,
)
from tactsim.estimators.likelihoods.classifier import lehmer_mean, threshold_of
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum
from tactsim.estimators.likelihoods.occupancy import OccupancyMap

# Shares of a reading's scale between which the grades lie. The lowest is about what noise reads in a usual press.
_SHARES = np.array([0.05, 0.15, 0.3, 0.5, 0.7, 0.9])
_GRADES = len(_SHARES) + 1
# Readings are divided by their scale into so many classes, as many in each, with tables of their own.
_CLASSES = 3
# A scale is at least this share of the training readings' median: what touches nothing has no scale of its own.
_LEAST = 0.25
# The weight of a taxel's log p: neighbours share the error of the press's place, tilt and scale.
_COUNTS = 0.5


class GradedLikelihood(TaxelSum):
    """p(grade | interpolated log-odds, class of the reading's scale), counted over the training readings.

    A reading is divided by its own scale, so that its load does not matter, and its taxels are graded by the quotient.
    Grades are finer than the three classes of eq. 3. A curve that bends all pressures alike moves counts from grade to
    grade, and makes no prediction wrong. Light presses are noisier than heavy ones; hence the classes of scales.

    least: kPa, the smallest scale. bounds: (classes - 1,) kPa, between the classes.
    """

    options_type = CountedOptions
    options: CountedOptions

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Count grades at the training taxels, each against a map without the presses at its position."""
        self._classes = CalibratedLikelihood(self.options)
        super().fit(scan, maps)
        self._classes.maps = maps
        train = scan.where("train")
        self._classes.threshold = threshold_of(self.options.threshold, train.readings)
        self.least = _LEAST * float(np.median(lehmer_mean(train.readings)))
        grades, scale = self.graded(train.readings)
        self.bounds = np.quantile(scale, np.arange(1, _CLASSES) / _CLASSES)
        of_class = np.searchsorted(self.bounds, scale)
        odds, _, counted = self._classes.left_out(train)
        self._classes.steeper = self._classes.steepness(train, odds, counted)
        edges = quantile_edges(odds[counted], self.options.quantiles)
        self.calibrations: list[Calibration] = []
        for number in range(_CLASSES):
            mine = counted & (of_class == number)[:, None]
            mine = mine if mine.any() else counted  # a class without training readings is like all of them
            self.calibrations.append(calibrate(odds[mine], grades[mine], _GRADES, edges))

    def graded(self, readings: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Grade the taxels of readings (..., taxels) kPa: returns grades (..., taxels) and scales (...) kPa."""
        scale = np.maximum(lehmer_mean(readings), self.least)
        # Compared with shares of the scale instead of divided by it: the scale of a scan of zeros is 0.
        limits = _SHARES * scale[..., None, None]
        return (readings[..., None] > limits).sum(axis=-1), scale

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> GradedLikelihood:
        """Make a copy whose maps were learned without some training readings."""
        rest = copy(self)
        rest.maps = self._classes.without(train, gone, labels, whole_positions).maps
        return rest

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate log p of every grade, class after class of scales: (tables, ...)."""
        odds = self.maps[label].log_odds_at(xy)
        return np.log(np.concatenate([calibration(odds) for calibration in self.calibrations]))

    def evidence(self, reading: FloatArray) -> Evidence:
        """Grade the taxels; each is a term."""
        grades, scale = self.graded(reading)
        table = np.searchsorted(self.bounds, scale) * _GRADES + grades
        return Evidence(table, np.arange(len(table)), np.full(len(table), _COUNTS, dtype=np.float32))
