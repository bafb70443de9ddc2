"""Metrics of runs with objects in space: named functions from the raw trials to numbers, as `tactsim.bench.score`'s."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.compare import FEWEST_PAIRS
from tactsim.bench.score import settled_by, wilson
from tactsim.bench.space.space_trials import SpaceTrials
from tactsim.bench.space.surface_distance import Surface, surface_distance, turn_between
from tactsim.core import rigid
from tactsim.core.poses import FloatArray

DRAWS = 1000  # of the bootstrap
Surfaces = Mapping[str, Surface]


class Scored:
    """Trials with the errors of their poses: mean surface distance and angle, worked out once.

    error: (n, r) mm. angle: (n, r) rad. Both are NaN where the label is wrong.
    """

    def __init__(self, trials: SpaceTrials, surfaces: Surfaces) -> None:
        self.trials = trials
        self.error = np.full(trials.label.shape, np.nan)
        self.angle = np.full(trials.label.shape, np.nan)
        for label in dict.fromkeys(trials.truth.tolist()):
            chosen = trials.right & (trials.truth == label)[:, None]
            true = np.broadcast_to(trials.true_pose[:, None], trials.pose.shape)[chosen]
            poses = rigid.invert(trials.pose[chosen]), rigid.invert(true)
            self.error[chosen] = surface_distance(*poses, surfaces[label])
            self.angle[chosen] = turn_between(*poses, surfaces[label])


Curve = list[float | None]


def accuracy(scored: Scored) -> Curve:
    """Share of the trials whose object is right, after each touch."""
    return _listed(scored.trials.right.mean(axis=0))


def accuracy_low(scored: Scored) -> Curve:
    """Lower end of the accuracy's 95 % Wilson interval."""
    return _listed(wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[0])


def accuracy_high(scored: Scored) -> Curve:
    """Upper end of the accuracy's 95 % Wilson interval."""
    return _listed(wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[1])


def error_mm(scored: Scored) -> Curve:
    """Mean surface distance of the trials whose object is right, the least over the object's symmetry."""
    return _listed(_over_right(np.nanmean, scored.error))


def error_low_mm(scored: Scored) -> Curve:
    """Lower end of the 95 % interval of `error_mm`, by a bootstrap over trials."""
    return _listed(_bootstrap(scored.error)[0])


def error_high_mm(scored: Scored) -> Curve:
    """Upper end of the 95 % interval of `error_mm`, by a bootstrap over trials."""
    return _listed(_bootstrap(scored.error)[1])


def error_median_mm(scored: Scored) -> Curve:
    """Median surface distance of the trials whose object is right: a few poses that are far off do not move it."""
    return _listed(_over_right(np.nanmedian, scored.error))


def angle_deg(scored: Scored) -> Curve:
    """Mean angle between estimated and true rotation where the object is right, the least over its symmetry."""
    return _listed(_over_right(np.nanmean, np.degrees(scored.angle)))


def angle_low_deg(scored: Scored) -> Curve:
    """Lower end of the 95 % interval of `angle_deg`, by a bootstrap over trials."""
    return _listed(_bootstrap(np.degrees(scored.angle))[0])


def angle_high_deg(scored: Scored) -> Curve:
    """Upper end of the 95 % interval of `angle_deg`, by a bootstrap over trials."""
    return _listed(_bootstrap(np.degrees(scored.angle))[1])


def angle_median_deg(scored: Scored) -> Curve:
    """Median angle where the object is right."""
    return _listed(_over_right(np.nanmedian, np.degrees(scored.angle)))


def negative_log_likelihood(scored: Scored) -> Curve:
    """Mean of -log p(right label), in nats; p is floored at the smallest normal float."""
    return _listed(-np.log(np.clip(scored.trials.p_truth, np.finfo(float).tiny, None)).mean(axis=0))


def calibration_gap(scored: Scored) -> Curve:
    """Mean stated probability of the estimate minus its accuracy: above 0 is overconfident."""
    return _listed(scored.trials.p_label.mean(axis=0) - scored.trials.right.mean(axis=0))


def coverage_90(scored: Scored) -> Curve:
    """Share of the trials whose object is right in which the 90 % region of the pose holds the truth."""
    within = np.where(np.isnan(scored.trials.credibility), np.nan, scored.trials.credibility < 0.9)
    return _listed(_over_right(np.nanmean, within))


def sharpness_mm(scored: Scored) -> Curve:
    """Mean radius of the 90 % region, in mean surface distance, where the object is right."""
    return _listed(_over_right(np.nanmean, scored.trials.radius_90))


def met(scored: Scored) -> Curve:
    """Share of the touches that met the object with one pad at least."""
    return _listed((scored.trials.met > 0).mean(axis=0))


def evaluations(scored: Scored) -> Curve:
    """Mean number of likelihood evaluations of the update at each touch."""
    return _listed(scored.trials.evaluations.mean(axis=0))


def all_right_from(scored: Scored) -> int | None:
    """Find the touch from which every trial is and stays right."""
    return settled_by(scored.trials.right, 1.0)


def settled_95(scored: Scored) -> int | None:
    """Find the touch by which 95 % of the trials are and stay right."""
    return settled_by(scored.trials.right, 0.95)


def settled_50(scored: Scored) -> int | None:
    """Find the touch by which half of the trials are and stay right."""
    return settled_by(scored.trials.right, 0.5)


def confusion(scored: Scored) -> dict[str, dict[str, int]]:
    """Count the estimates after the last touch: {true object: {estimated object: trials}}."""
    trials, last = scored.trials, scored.trials.label[:, -1]
    return {
        truth: {
            str(label): int(count)
            for label, count in zip(*np.unique(last[trials.truth == truth], return_counts=True), strict=True)
        }
        for truth in dict.fromkeys(trials.truth.tolist())
    }


def by_object(scored: Scored) -> dict[str, dict[str, float | None]]:
    """Give accuracy, mean surface distance and angle of each object after the last touch."""
    rows = {}
    for truth in dict.fromkeys(scored.trials.truth.tolist()):
        chosen = scored.trials.truth == truth
        values = (
            scored.trials.right[chosen][:, -1:].mean(axis=0),
            _over_right(np.nanmean, scored.error[chosen][:, -1:]),
            _over_right(np.nanmean, np.degrees(scored.angle[chosen][:, -1:])),
        )
        names = ("accuracy", "error_mm", "angle_deg")
        rows[truth] = {name: _listed(value)[0] for name, value in zip(names, values, strict=True)}
    return rows


CURVES: dict[str, Callable[[Scored], Curve]] = {
    metric.__name__: metric
    for metric in (
        accuracy, accuracy_low, accuracy_high, error_mm, error_low_mm, error_high_mm, error_median_mm,
        angle_deg, angle_low_deg, angle_high_deg, angle_median_deg, negative_log_likelihood, calibration_gap,
        coverage_90, sharpness_mm, met, evaluations,
    )
}  # fmt: skip
HEADLINES: dict[str, Callable[[Scored], Any]] = {
    metric.__name__: metric for metric in (all_right_from, settled_95, settled_50, confusion, by_object)
}


def summarise(trials: SpaceTrials, surfaces: Surfaces) -> dict[str, Any]:
    """Compute every metric: lists over the touch count 1..r (None where undefined) and headlines."""
    scored = Scored(trials, surfaces)
    return {name: metric(scored) for name, metric in (CURVES | HEADLINES).items()}


def _over_right(reduce: Callable[..., FloatArray], values: FloatArray) -> FloatArray:
    """Reduce the entries of each column (n, r) that are not NaN; NaN where there is none."""
    found = np.full(values.shape[1], np.nan)
    some = ~np.isnan(values).all(axis=0)
    found[some] = reduce(values[:, some], axis=0)
    return found


def _bootstrap(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bound the mean of each column's entries that are not NaN: percentiles of a bootstrap over rows, (r,) each.

    NaN where there are fewer entries than `FEWEST_PAIRS`: draws of so few are too much alike.
    """
    drawn = np.random.default_rng(0).multinomial(len(values), np.full(len(values), 1 / len(values)), DRAWS)
    known = ~np.isnan(values)
    known &= known.sum(axis=0) >= FEWEST_PAIRS
    count = drawn @ known.astype(float)
    with np.errstate(invalid="ignore"):
        means = drawn @ np.where(known, values, 0.0) / np.where(count > 0, count, np.nan)
    low, high = (_over_right(_percentile(share), means) for share in (2.5, 97.5))
    return low, high


def _percentile(share: float) -> Callable[..., FloatArray]:
    return lambda values, axis: np.nanpercentile(values, share, axis=axis)


def _listed(values: NDArray[Any]) -> Curve:
    """Turn NaN into None, which JSON can hold."""
    return [float(value) if np.isfinite(value) else None for value in values]
