"""What maps say of readings that they were not made from, in nats: by it options are chosen for a pad.

The criterion is the mutual information between what is predicted at a taxel from presses elsewhere, and what that
taxel felt. It depends neither on the unit of the readings, nor on that of the prediction: a monotone change of either
leaves it as it is. So thresholds, point spreads and response curves can be compared by it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.likelihoods.class_table import quantile_edges
from tactsim.estimators.likelihoods.classifier import threshold_of
from tactsim.estimators.likelihoods.folds import by_letter, folds, touched_elsewhere
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps_by
from tactsim.estimators.options import LikelihoodOptions

# Bins of equally many taxels in which predictions and pressures are counted.
_PREDICTED, _FELT = 16, 8
# One number is learned from all letters: more than these are not needed for it.
_LETTERS = 6


def some_letters(scan: Scan) -> Scan:
    """Keep the training readings of at most six letters, the same ones in whatever order they come."""
    train = scan.where("train")
    return train.of_letters(sorted(train.letters)[:: math.ceil(len(train.letters) / _LETTERS) or 1])


def class_information(scan: Scan, options: LikelihoodOptions) -> float:
    """Measure what the log-odds of maps say of the class (eq. 3) of a taxel whose position was left out: nats.

    scan: of which the training readings count, one at least.
    """
    maps = learn_maps_by(options, scan)
    model = CalibratedLikelihood(options)
    model.maps = maps
    model.threshold = threshold_of(options.threshold, scan.where("train").readings)
    odds, classes, known = zip(*(model.left_out(label, scan) for label in maps), strict=True)
    counted = _counted(list(known))
    return mutual_information(
        _binned(np.concatenate(odds)[counted], _PREDICTED), np.concatenate(classes)[counted].astype(np.intp)
    )


def pressure_information(scan: Scan, options: LikelihoodOptions) -> float:
    """Measure what mosaics say of the relative pressure of a taxel whose position was left out: nats.

    scan: of which the training readings count, one at least.
    """
    train = scan.where("train")
    maps = learn_maps_by(options, scan)
    model = ForceLikelihood(options)
    predicted, relative, _, _ = model.fit_mosaics(train, maps)
    counted = _counted([touched_elsewhere(train, by_letter(folds, train))])
    return mutual_information(_binned(predicted[counted], _PREDICTED), _binned(relative[counted], _FELT))


def mutual_information(first: NDArray[np.intp], second: NDArray[np.intp]) -> float:
    """Compute the mutual information of two variables from n pairs of bins (n,) each, in nats.

    What chance alone makes of independent variables, (a - 1) (b - 1) / 2n for a and b bins that hold something, is
    taken off (Miller 1955).
    """
    if not len(first):
        return 0.0
    rows, columns = int(first.max()) + 1, int(second.max()) + 1
    count = np.bincount(first * columns + second, minlength=rows * columns).reshape(rows, columns)
    joint = count / len(first)
    alone = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    held = joint > 0
    used = [int((joint.sum(axis=axis) > 0).sum()) for axis in (0, 1)]
    chance = (used[0] - 1) * (used[1] - 1) / (2 * len(first))
    return float((joint[held] * np.log(joint[held] / alone[held])).sum()) - chance


def _binned(values: FloatArray, bins: int) -> NDArray[np.intp]:
    """Say in which of so many bins that hold equally many each value lies; equal values share a bin."""
    return np.searchsorted(np.unique(quantile_edges(values, bins)), values, side="right")


def _counted(known: list[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Join what taxels were touched elsewhere, letter after letter; all of them if none was."""
    joined = np.concatenate(known)
    return joined if joined.any() else ~joined
