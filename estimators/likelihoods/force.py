"""The measurement model in the force domain: predicted pressures instead of classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import lehmer_mean
from tactsim.estimators.likelihoods.deviation import Deviation, learn_deviation
from tactsim.estimators.likelihoods.folds import LeftOut, as_one
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum
from tactsim.estimators.likelihoods.mosaic import Grid, Mosaic, learn_mosaic, learn_with_spread
from tactsim.estimators.likelihoods.occupancy import OccupancyMap

# Relative pressures at which log p is tabulated; between two it is linear. Almost all lie in this range.
_LEVELS = np.linspace(-0.25, 1.4, 16)
# Readings that touch are divided by their scale into so many classes with tables of their own: noise differs.
_CLASSES = 3
# The weight of a taxel's log p. Neighbours share the error of the press's place and scale, so that they are not
# independent: with a weight of 1, letters seem certain too early (`calibration_gap`), and errors are larger.
_COUNTS = 0.5
# kPa; a scale is never 0.
_LEAST_SCALE = 1e-6
# A taxel whose predicted relative pressure is below this says nothing about its gain.
_PRESSED = 0.3
# A taxel with a smaller gain than this is left out.
_DEAD = 0.2
# The weight of a reading's own scale when its pressure is found, beside a weight of 1 for a covered taxel.
_DOUBT = 0.01
# How often mosaics are learned from pressures and gains, and these from the mosaics.
_TURNS = 3


class ForceLikelihood(TaxelSum):
    """p(relative pressure | what the mosaic predicts at the taxel's place), taxel by taxel.

    Every press has the same force. So the pressure under the covered taxels differs from pose to pose, and
    a reading is divided by its own scale, which is nearly that pressure. The quotient is learned place by place
    from the training readings, and so is how far readings deviate from it.

    gain: (taxels,) of mean 1. least: kPa, the smallest scale; readings that touch nothing have it. mosaics: by letter.
    """

    of_pressures, of_classes = True, False

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn the taxels' gains, the mosaics, and how far readings deviate from them."""
        super().fit(scan, maps)
        train = scan.where("train")
        predicted, relative, slope, scale, known = self.fit_mosaics(train, maps)
        # Where nothing else was felt, nothing is predicted: that is not how readings deviate where something was.
        self._calibrate(scale, relative, predicted, slope, known)

    def fit_mosaics(
        self, train: Scan, maps: Mapping[str, OccupancyMap]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """Learn gains and mosaics from training readings (n, taxels), and not yet how far readings deviate.

        Returns relative pressures as predicted without the presses at their positions, and as they are, the squared
        slopes of the predictions, (n, taxels) each, scales (n,), and where other presses say something (n, taxels).
        """
        self.maps = maps
        self.gain = np.ones(len(train.taxel_xy))
        self.least = max(float(np.median(lehmer_mean(train.readings))) / 2, _LEAST_SCALE)
        scale, relative = self.relative(train.readings)
        pressure = scale
        # The scale of a reading that covers no taxel wholly is below its pressure. For a training reading the
        # mosaic tells by how much.
        for _ in range(_TURNS):
            predicted = self._foretold(train, pressure)
            self.gain = gains(train.readings / pressure[:, None], predicted, pressure)
            scale, relative = self.relative(train.readings)
            pressure = scale * pressures(relative, predicted, scale > self.least)
        self._pressure = pressure
        self.mosaics = self._mosaics_without(train, np.zeros(len(train), dtype=bool), tuple(maps))
        out, xy = LeftOut.of(train), transform(train.poses, train.taxel_xy)

        def predict(gone: NDArray[np.bool_]) -> FloatArray:
            found = np.empty((2, *train.readings.shape))
            for label, mosaic in self._mosaics_without(train, gone, tuple(self.maps)).items():
                mine = gone & (train.labels == label)
                found[:, mine] = mosaic(xy[mine])
            return found[:, gone]

        predicted, slope = out.predicted(predict)
        return predicted, relative, slope, scale, out.known

    def _foretold(self, train: Scan, pressure: FloatArray) -> FloatArray:
        """Predict training readings under pressures (n,) kPa without any taxel that lay just like it: (n, taxels)."""
        predicted = np.empty(train.readings.shape)
        for label in self.maps:
            mine = train.labels == label
            xy, values, counts = self._taxels(train, pressure, mine)
            learned = learn_with_spread(xy, values, counts, self._grid(label))
            alone = learned.without(*as_one(train.where(label=label), values, counts))
            predicted[mine] = alone.reshape(-1, len(train.taxel_xy))
        return predicted

    def _taxels(
        self, train: Scan, pressure: FloatArray, chosen: NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """List what the taxels of chosen readings felt under pressures (n,) kPa: places, values and weights."""
        readings, felt_under = train.readings[chosen], pressure[chosen][:, None]
        alive = self.gain > _DEAD
        felt = readings / np.maximum(self.gain, _DEAD) / felt_under
        # The smaller the pressure, the more of what is felt is noise: half of it at the median scale.
        counts = felt_under**2 / (felt_under**2 + (2 * self.least) ** 2)
        places = transform(train.poses[chosen], train.taxel_xy)
        return places.reshape(-1, 2), felt.ravel(), np.where(alive, counts, 0.0).ravel()

    def _grid(self, label: str) -> Grid:
        chart = self.maps[label]
        return Grid(chart.origin, chart.cell, chart.log_odds.shape, self.options.sigma)

    def _mosaics_without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str]
    ) -> dict[str, Mosaic]:
        return {
            label: learn_mosaic(
                *self._taxels(train, self._pressure, ~gone & (train.labels == label)), self._grid(label)
            )
            for label in labels
        }

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> ForceLikelihood:
        """Make a copy whose mosaics were learned without some training readings."""
        rest = copy(self)
        rest.mosaics = self._mosaics_without(train, gone, labels)
        rest.maps = {label: self.maps[label] for label in labels}
        return rest

    def _calibrate(
        self,
        scale: FloatArray,
        relative: FloatArray,
        predicted: FloatArray,
        slope: FloatArray,
        counted: NDArray[np.bool_],
    ) -> None:
        """Learn how far relative pressures (n, taxels) deviate, for each class of scales (n,) by itself.

        counted: (n, taxels) which of them to learn from.
        """
        touching = scale[scale > self.least]
        parts = np.arange(1, _CLASSES) / _CLASSES
        between = np.quantile(touching, parts) if len(touching) else np.full(len(parts), self.least)
        self.bounds = np.append(self.least, between)
        of_class = np.searchsorted(self.bounds, scale)
        alive = self.gain > _DEAD
        each = np.broadcast_to(scale[:, None], relative.shape)
        self.typical: list[float] = []
        self.deviations: list[Deviation] = []
        for number in range(len(self.bounds) + 1):
            # A class without training readings deviates as all do.
            mine = of_class == number if number in of_class else np.full(len(scale), True)
            chosen = mine[:, None] & alive & counted
            chosen = chosen if chosen.any() else mine[:, None] & alive
            self.typical.append(float(np.median(scale[mine])))
            self.deviations.append(
                learn_deviation(relative[chosen], predicted[chosen], slope[chosen], each[chosen], _LEVELS)
            )

    def relative(self, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Divide readings (..., taxels) kPa by gains and scale: returns scales (...) kPa and quotients (..., taxels).

        Dead taxels get 0. A scale is at least `least`, half the median of the training readings' scales,
        because a reading that touches nothing has no scale of its own.
        """
        even = np.where(self.gain > _DEAD, readings / np.maximum(self.gain, _DEAD), 0.0)
        scale = np.maximum(lehmer_mean(even), self.least)
        return scale, even / scale[..., None]

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate the log density at every level, class after class of scales: (tables, ...)."""
        predicted, slope = self.mosaics[label](xy)
        return np.concatenate(
            [
                deviation.log_density(predicted, slope, scale)
                for deviation, scale in zip(self.deviations, self.typical, strict=True)
            ]
        )

    def evidence(self, reading: FloatArray) -> Evidence:
        """Make two terms a taxel, for the levels below and above what it felt; dead taxels say nothing."""
        scale, felt = self.relative(reading)
        taxel = np.flatnonzero(self.gain > _DEAD)
        place = np.interp(felt[taxel], _LEVELS, np.arange(len(_LEVELS)))
        below = np.minimum(place.astype(np.int64), len(_LEVELS) - 2)
        above_share = place - below
        table = np.searchsorted(self.bounds, scale) * len(_LEVELS) + below
        share = np.stack([1 - above_share, above_share], axis=1)
        tables = np.stack([table, table + 1], axis=1)
        return Evidence(tables.ravel(), np.repeat(taxel, 2), (_COUNTS * share).astype(np.float32).ravel())


def gains(felt: FloatArray, predicted: FloatArray, pressure: FloatArray) -> FloatArray:
    """Find how much more or less than predicted each taxel feels where it is pressed: (taxels,), of mean 1.

    felt: (n, taxels) readings divided by their pressures (n,) kPa, regressed on `predicted`. Taxels at the pad's
    rim feel less, since no load lies beyond. A taxel that was never pressed gets 1.
    """
    weight = np.where(predicted > _PRESSED, predicted * pressure[:, None] ** 2, 0)
    pressed = weight.any(axis=0)
    own = np.ones(felt.shape[1])
    np.divide((weight * felt).sum(axis=0), (weight * predicted).sum(axis=0), out=own, where=pressed)
    own = np.maximum(own, 0)
    return own / own.mean() if own.any() else np.ones_like(own)


def pressures(relative: FloatArray, predicted: FloatArray, touches: ArrayLike) -> FloatArray:
    """Find the ratio of pressure to scale of each reading (n,); the median is 1.

    Relative pressures (n, taxels) are regressed on the predicted ones. touches: (n,) whether a reading touches
    anything; if not, its ratio is 1.
    """
    ratio = ((relative * predicted).sum(axis=1) + _DOUBT) / ((predicted**2).sum(axis=1) + _DOUBT)
    middle = np.median(ratio[touches]) if np.any(touches) else 1.0
    return np.where(touches, np.maximum(ratio / middle, 0.5), 1.0)
