"""The calibrated measurement model: how often each class of eq. 3 goes with a map's value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.class_table import calibrate, quantile_edges
from tactsim.estimators.likelihoods.classifier import UNKNOWN, classify
from tactsim.estimators.likelihoods.folds import folds, touched_elsewhere
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood, covered
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, log_odds_of
from tactsim.estimators.likelihoods.scale import threshold_of

_CLASSES = UNKNOWN + 1


class CalibratedLikelihood(Likelihood):
    """p(No Contact, In Contact or Unknown | interpolated log-odds), counted over the training readings.

    Eq. 7 takes the map's own probabilities and gives Unknown no weight. Here both are learned: the log-odds at
    the training taxels of all letters are divided into quantile bins, and the classes in each bin are counted.
    Unknown taxels lie at edges, so they say much about the pose.

    threshold: T of eq. 3, kPa.
    """

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Count classes at the training taxels, each against a map without the presses at its position."""
        self.maps = maps
        self.threshold = threshold_of(self.options.threshold, scan.where("train").readings)
        odds, kinds = [], []
        for label in maps:
            train = scan.where("train", label)
            known = touched_elsewhere(train, folds(train.poses))
            found = self.left_out(label, scan)
            odds.append(found[0][known] if known.any() else found[0].ravel())
            kinds.append(found[1][known] if known.any() else found[1].ravel())
        seen = np.concatenate(odds)
        edges = quantile_edges(seen, self.options.quantiles)
        self.calibration = calibrate(seen, np.concatenate(kinds), _CLASSES, edges)

    def left_out(self, label: str, scan: Scan) -> tuple[FloatArray, NDArray[np.int8]]:
        """Look the taxels of a letter's training readings up in its map without the presses at their positions.

        Where no other press had a taxel, the map is taken as it is. scan: the one that the maps were learned from.
        Returns log-odds and classes (n, taxels).
        """
        train = scan.where("train", label)
        xy, classes = transform(train.poses, train.taxel_xy), self.classes(train.readings)
        part, odds = folds(train.poses), np.empty(classes.shape)
        for number in range(int(part.max()) + 1):
            mine = part == number
            odds[mine] = self._without(label, xy[mine], classes[mine]).log_odds_at(xy[mine])
        known = touched_elsewhere(train, part)
        odds[~known] = self.maps[label].log_odds_at(xy[~known])
        return odds, classes

    def without(self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str]) -> CalibratedLikelihood:
        """Make a copy whose maps were learned without some training readings."""
        rest = copy(self)
        xy, classes = transform(train.poses, train.taxel_xy), self.classes(train.readings)
        chosen = {label: gone & (train.labels == label) for label in labels}
        rest.maps = {label: self._without(label, xy[mine], classes[mine]) for label, mine in chosen.items()}
        return rest

    def _without(self, label: str, xy: FloatArray, classes: NDArray[np.int8]) -> OccupancyMap:
        """Take what taxels (n, taxels) of classes at xy have added out of a letter's map."""
        chart = self.maps[label]
        own = log_odds_of(chart, xy, classes, self.options.sigma, self.options.peak)
        return replace(chart, log_odds=chart.log_odds - own)

    def classes(self, readings: ArrayLike) -> NDArray[np.int8]:
        """Classify the taxels of readings (..., taxels) kPa, with T and the ratio of the options."""
        return classify(readings, self.threshold, self.options.ratio)

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Give the corners of the maps with their frame of cells at the prior."""
        return covered(self.maps)

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate log p of the three classes at xy: (3, ...)."""
        return np.log(self.calibration(self.maps[label].log_odds_at(xy)))

    def evidence(self, reading: FloatArray) -> Evidence:
        """Classify the taxels; each is a term, an Unknown one too."""
        classes = self.classes(reading).astype(np.int64)
        return Evidence(classes, np.arange(len(classes)), np.ones(len(classes), dtype=np.float32))
