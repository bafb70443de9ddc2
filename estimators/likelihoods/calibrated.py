"""The calibrated measurement model: how often each class of eq. 3 goes with a map's value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import UNKNOWN, classify, threshold_of
from tactsim.estimators.likelihoods.folds import LeftOut
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, log_odds, log_odds_of
from tactsim.estimators.options import MapOptions

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


_CLASSES = UNKNOWN + 1
# mm; log-odds are averaged so far around a place, for the presses' lattice is finer than that.
_AROUND = 1.5


class CountedOptions(MapOptions):
    """How probabilities are counted over the training readings."""

    quantiles: int = Field(
        16, ge=1, le=1000, description="bins of the map's value in which classes are counted"
    )


class CalibratedLikelihood(TaxelSum):
    """p(No Contact, In Contact or Unknown | interpolated log-odds), counted over the training readings.

    Eq. 7 takes the map's own probabilities and gives Unknown no weight. Here both are learned: the log-odds at
    the training taxels of all letters are divided into quantile bins, and the classes in each bin are counted.
    Unknown taxels lie at edges, so they say much about the pose.

    threshold: T of eq. 3, kPa. steeper: see `steepness`.
    """

    options_type = CountedOptions
    options: CountedOptions

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Count classes at the training taxels, each against a map without the presses at its position."""
        super().fit(scan, maps)
        self.threshold = threshold_of(self.options.threshold, scan.where("train").readings)
        train = scan.where("train")
        odds, classes, counted = self.left_out(train)
        self.steeper = self.steepness(train, odds, counted)
        edges = quantile_edges(odds[counted], self.options.quantiles)
        self.calibration = calibrate(odds[counted], classes[counted], _CLASSES, edges)

    def left_out(self, train: Scan) -> tuple[FloatArray, NDArray[np.int8], NDArray[np.bool_]]:
        """Look the taxels of training readings up in maps without the presses at their positions.

        Where no other press had a taxel, the map is taken as it is. train: what the maps were learned from. Returns
        log-odds, classes, and which to count: those where another press had a taxel, or of a letter that has none all;
        (n, taxels) each.
        """
        xy, classes = transform(train.poses, train.taxel_xy), self.classes(train.readings)
        out = LeftOut.of(train)
        odds, counted = np.empty(classes.shape), out.known.copy()
        for label in self.maps:
            own = train.labels == label
            for gone in out:
                mine = gone & own
                odds[mine] = self._without(label, xy[mine], classes[mine]).log_odds_at(xy[mine])
            unknown = own[:, None] & ~out.known
            odds[unknown] = self.maps[label].log_odds_at(xy[unknown])
            if not out.known[own].any():
                counted[own] = True
        return odds, classes, counted

    def steepness(self, train: Scan, left_out: FloatArray, counted: NDArray[np.bool_]) -> float:
        """Find how much farther from the prior's the maps' log-odds are than those without a press's position.

        Log-odds are sums over the presses around a place, so a press at a new place meets larger ones than a press that
        is left out. left_out, counted: as `left_out` gives them.
        """
        whole = part = 0.0
        places = transform(train.poses, train.taxel_xy)
        for label, chart in self.maps.items():
            those = counted & (train.labels == label)[:, None]
            prior = log_odds(chart.prior)
            size = _blurred(np.abs(chart.log_odds - prior), _AROUND / chart.cell)
            whole += float(replace(chart, log_odds=size, prior=0.5).log_odds_at(places[those]).sum())
            part += float(np.abs(left_out[those] - prior).sum())
        return whole / part if part else 1.0

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> CalibratedLikelihood:
        """Make a copy whose maps were learned without some training readings, and made as steep as those with all."""
        steeper = self.steeper if whole_positions else 1.0
        rest = copy(self)
        xy, classes = transform(train.poses, train.taxel_xy), self.classes(train.readings)
        rest.maps = {}
        for label in labels:
            mine = gone & (train.labels == label)
            chart = self._without(label, xy[mine], classes[mine])
            prior = log_odds(chart.prior)
            rest.maps[label] = replace(chart, log_odds=prior + steeper * (chart.log_odds - prior))
        return rest

    def _without(self, label: str, xy: FloatArray, classes: NDArray[np.int8]) -> OccupancyMap:
        """Take what taxels (n, taxels) of classes at xy have added out of a letter's map."""
        chart = self.maps[label]
        own = log_odds_of(chart, xy, classes, self.options.sigma, self.options.peak)
        return replace(chart, log_odds=chart.log_odds - own)

    def classes(self, readings: ArrayLike) -> NDArray[np.int8]:
        """Classify the taxels of readings (..., taxels) kPa, with T and the ratio of the options."""
        return classify(readings, self.threshold, self.options.ratio)

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate log p of the three classes at xy: (3, ...)."""
        return np.log(self.calibration(self.maps[label].log_odds_at(xy)))

    def evidence(self, reading: FloatArray) -> Evidence:
        """Classify the taxels; each is a term, an Unknown one too."""
        return Evidence.of_classes(classify(reading, self.threshold, self.options.ratio), with_unknown=True)


def _blurred(values: FloatArray, width: float) -> FloatArray:
    """Average (rows, columns) around each cell, with weights of a normal distribution; outside lie zeros.

    width: cells, its standard deviation. It ends at four of them. As `scipy.ndimage.gaussian_filter`, which takes
    longer to import than all fits of a run.
    """
    reach = round(4 * width)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    weight /= weight.sum()
    for _ in range(2):
        count = len(values)
        framed = np.pad(values, ((reach, reach), (0, 0)))
        values = sum(weight[k] * framed[k : k + count] for k in range(2 * reach + 1)).T
    return values
