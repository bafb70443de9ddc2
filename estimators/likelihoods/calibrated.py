"""The calibrated measurement model: how often each class of eq. 3 goes with a map's value."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.class_table import calibrate, quantile_edges
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, UNKNOWN, classify
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood, covered
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, point_spread, taxel_log_odds

_CLASSES = UNKNOWN + 1


class CalibratedLikelihood(Likelihood):
    """p(No Contact, In Contact or Unknown | interpolated log-odds), counted over the training readings.

    Eq. 7 takes the map's own probabilities and gives Unknown no weight. Here both are learned: the log-odds at
    the training taxels of all letters are divided into quantile bins, and the classes in each bin are counted.
    Unknown taxels lie at edges, so they say much about the pose.
    """

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Count classes at the training taxels, each against the map without itself."""
        self.maps = maps
        odds, kinds = zip(*(self.left_out(label, scan) for label in maps), strict=True)
        seen = np.concatenate(odds).ravel()
        edges = quantile_edges(seen, self.options.quantiles)
        self.calibration = calibrate(seen, np.concatenate(kinds).ravel(), _CLASSES, edges)

    def left_out(self, label: str, scan: Scan) -> tuple[FloatArray, NDArray[np.int8]]:
        """Look the taxels of a letter's training readings up in its map without themselves.

        scan: the one that the maps were learned from. Returns log-odds and classes (n, taxels).
        """
        train, chart = scan.where("train", label), self.maps[label]
        xy, classes = transform(train.poses, train.taxel_xy), self.classes(train.readings)
        own = own_log_odds(chart, xy, classes, self.options.sigma, self.options.peak)
        return chart.log_odds_at(xy) - own, classes

    def classes(self, readings: ArrayLike) -> NDArray[np.int8]:
        """Classify the taxels of readings (..., taxels) kPa, with the T and ratio of the options."""
        return classify(readings, self.options.threshold, self.options.ratio)

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


def own_log_odds(
    chart: OccupancyMap, xy: FloatArray, classes: NDArray[np.int8], sigma: float, peak: float
) -> FloatArray:
    """Find what taxels have themselves added to a map where they are looked up: (...) log-odds.

    xy: (..., 2) mm. classes: (...). What a taxel has added to the four cells around it is weighted bilinearly.
    What the other taxels of its reading have added there stays: they are too far away to matter.
    """
    place = (xy - chart.origin) / chart.cell
    corner = np.floor(place)
    share = place - corner
    total = np.zeros(classes.shape)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.abs(1 - dx - share[..., 0]) * np.abs(1 - dy - share[..., 1])
        away = ((corner + (dx, dy) - place) ** 2).sum(axis=-1) * chart.cell**2
        g = point_spread(away, sigma, peak)
        for kind in (CONTACT, NO_CONTACT):
            here = classes == kind
            total[here] += weight[here] * taxel_log_odds(kind, g[here], chart.prior)
    return total
