"""Metrics: a table of names, what each is, and how it is computed from the raw trials.

They need only `Trials` and the objects' properties, both of which a run's folder keeps, so a metric
added later applies to every old run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.bench import kinds
from tactsim.bench.placement import Placement
from tactsim.bench.trials import Trials
from tactsim.core import invert, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE

JUMP, RECOVERED = 4.0, 1.0  # mm: a step that is a jump, and the placement error that ends it
LEAST_ERROR = 0.01  # mm, below which no placement of a pad with taxels of 1.8 mm is told from another
# Fewer pairs decide nothing: even if all of them speak for one side, chance does that in more than 1 of 40 cases.
FEWEST_PAIRS = 7
Z_95 = 1.959963984540054  # standard normal quantile of a two-sided 95 % interval


def errors(trials: Trials, objects: Mapping[str, Any], measure: str = "error") -> FloatArray:
    """Compute the placement error (n, r) in mm of every estimate, with the true object's properties.

    measure: the method of the properties that does it.
    """
    result = np.empty(trials.label.shape)
    for letter in np.unique(trials.truth):
        chosen = trials.truth == letter
        measured = getattr(objects[str(letter)], measure)
        result[chosen] = measured(trials.pose[chosen], trials.true_pose[chosen])
    return result


@dataclass(frozen=True, eq=False)
class Scored:
    """Trials with what several metrics need of them, worked out once. objects: measure each object's placement."""

    trials: Trials
    objects: Mapping[str, Any]

    @cached_property
    def error(self) -> FloatArray:
        """The placement error (n, r) in mm of every estimate."""
        return errors(self.trials, self.objects)


def error_limits(errors: Iterable[ArrayLike], bounds: ArrayLike = ()) -> tuple[float, float]:
    """Choose the limits, mm, of a logarithmic axis for placement errors; NaN and None are left out.

    A method that copies a training pose errs by rounding alone, and decades of it would hide all others. So the axis
    ends below at half the least Cramer-Rao bound, or where none is known at LEAST_ERROR, unless all errors lie above.
    """
    flat = np.concatenate([np.ravel(np.asarray(values, dtype=float)) for values in (*errors, bounds)])
    known = flat[np.isfinite(flat) & (flat > 0)]
    if not len(known):
        return 0.1, 10.0
    least = np.asarray(bounds, dtype=float)
    least = least[np.isfinite(least)]
    floor = least.min() / 2 if len(least) else LEAST_ERROR
    low = max(float(known.min()) / 1.3, floor)
    return low, max(1.3 * float(known.max()), 10 * low)


def wilson(successes: ArrayLike, count: int) -> tuple[FloatArray, FloatArray]:
    """Bound a proportion with Wilson's 95 % score interval (Wilson 1927).

    The proportion lies within it: at 0 the interval begins at 0, and at 1 it ends at 1.
    """
    p = np.asarray(successes, dtype=float) / count
    middle = (p + Z_95**2 / (2 * count)) / (1 + Z_95**2 / count)
    half = Z_95 / (1 + Z_95**2 / count) * np.sqrt(p * (1 - p) / count + Z_95**2 / (4 * count**2))
    # By rounding alone an end may lie on the wrong side of p, and an error bar would be negative.
    return np.clip(middle - half, 0, p), np.clip(middle + half, p, 1)


def settled_at(right: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Find for (n, r) the reading, 1..r, from which each trial is and stays right; r + 1 if never."""
    stays = np.logical_and.accumulate(right[:, ::-1], axis=1)
    return right.shape[1] + 1 - stays.sum(axis=1)


def settled_by(right: NDArray[np.bool_], share: float) -> int | None:
    """Find the first reading by which `share` of the trials are and stay right; None if there is none."""
    at = np.sort(settled_at(right))
    reading = int(at[int(np.ceil(share * len(at) - 1e-9)) - 1])
    return reading if reading <= right.shape[1] else None


Curve = FloatArray | list[float | None]


def error_standard_error(scored: Scored) -> Curve:
    """Compute the standard error of the mean placement error (r,) mm of the trials whose letter is known and right."""
    values, right = scored.error, scored.trials.named
    count = right.sum(axis=0)
    squares = np.asarray(mean_where(values**2, right), dtype=float)
    means = np.asarray(mean_where(values, right), dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        return nones(np.sqrt(np.clip(squares - means**2, 0, None) / (count - 1)))


def coverage(trials: Trials, share: float) -> Curve:
    """Count how often the region that holds this share of the belief holds the truth: as often, if all is well."""
    return mean_where((trials.credibility < share).astype(float), trials.sure)


def refused(trials: Trials, among: NDArray[np.bool_]) -> Curve:
    """Give the share (r,) of the trials `among` (n,) whose estimate is 'none'; None without such trials."""
    return mean_where((trials.label == NONE).astype(float), among[:, None] & np.ones_like(trials.right))


def recovered_within(scored: Scored, readings: int) -> float | None:
    """Give the share of the jumps that are recovered in so many readings; None if there is none to judge."""
    if (scored.trials.true_pose == scored.trials.true_pose[:, :1]).all():  # no object moves
        return None
    jumps, found = recoveries(scored, readings)
    return float(found.sum() / jumps.sum()) if jumps.any() else None


def recoveries(scored: Scored, readings: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count the jumps of each trial (n,), and those that are recovered in so many readings (n,).

    A jump is a step of the object's centre of mass of at least JUMP mm between two touches. It is recovered as
    soon as the letter is right and the placement error at most RECOVERED mm; the touch right after the jump
    counts as the first. Jumps with fewer readings left are not counted, nor those of letters that were held out.
    """
    trials = scored.trials
    jumped = np.zeros(trials.label.shape, dtype=bool)
    for letter in np.unique(trials.truth):
        chosen = trials.truth == letter
        middle = transform(invert(trials.true_pose[chosen]), np.array([scored.objects[str(letter)].centre]))
        step = middle[:, 1:, 0] - middle[:, :-1, 0]
        jumped[chosen, 1:] = np.hypot(step[..., 0], step[..., 1]) >= JUMP
    jumped[~trials.known] = False
    jumped[:, max(0, trials.label.shape[1] - readings + 1) :] = False
    near = trials.right & (scored.error <= RECOVERED)
    trial, touch = np.nonzero(jumped)
    again = near[trial[:, None], touch[:, None] + np.arange(readings)].any(axis=1)
    count = len(trials.truth)
    return jumped.sum(axis=1), np.bincount(trial[again], minlength=count)


def confusion(trials: Trials) -> dict[str, dict[str, int]]:
    """Count the estimates after the last reading: {true letter: {estimated letter: trials}}."""
    last = trials.label[:, -1]
    return {
        str(truth): {
            str(label): int(count)
            for label, count in zip(*np.unique(last[trials.truth == truth], return_counts=True), strict=True)
        }
        for truth in dict.fromkeys(trials.truth.tolist())
    }


def recognition_seconds(trials: Trials, readings: int) -> float:
    """Compute what a recognition costs: the median over the trials of the processor time of its readings.

    Updates, estimates (one after each reading) and proposals are counted; pressing, mapping and the
    tables made once are not.
    """
    return float(np.median(trials.seconds[:, :readings].sum(axis=1)))


@dataclass(frozen=True)
class Metric:
    """A figure of a run: what it is, in one line, and how it follows from the trials and their errors."""

    description: str
    compute: Callable[[Scored], Any]


# Metrics over the reading count, arrays (r,) or lists with None where undefined. `bench list` shows them in this order.
CURVES: dict[str, Metric] = {
    "accuracy": Metric(
        "Share of the trials whose letter is right, after each reading.",
        lambda scored: scored.trials.right.mean(axis=0),
    ),
    "accuracy_low": Metric(
        "Lower end of the accuracy's 95 % Wilson interval.",
        lambda scored: wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[0],
    ),
    "accuracy_high": Metric(
        "Upper end of the accuracy's 95 % Wilson interval.",
        lambda scored: wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[1],
    ),
    "error_mm": Metric(
        "Mean placement error of the trials whose letter is known and right (as the paper averages it).",
        lambda scored: mean_where(scored.error, scored.trials.named),
    ),
    "error_standard_error_mm": Metric("Give the standard error of `error_mm`.", error_standard_error),
    "error_all_mm": Metric(
        "Mean placement error over all trials of known letters, the wrong estimates included.",
        lambda scored: mean_where(
            scored.error, scored.trials.known[:, None] & np.ones_like(scored.trials.right)
        ),
    ),
    "negative_log_likelihood": Metric(
        "Mean of -log p(right label), in nats; p is floored at the smallest normal float.",
        lambda scored: -np.log(np.clip(scored.trials.p_truth, np.finfo(float).tiny, None)).mean(axis=0),
    ),
    "calibration_gap": Metric(
        "Mean stated probability of the estimate minus its accuracy: above 0 is overconfident.",
        lambda scored: scored.trials.p_label.mean(axis=0) - scored.trials.right.mean(axis=0),
    ),
    "coverage_50": Metric(
        "Share of the trials whose letter is known and right in which the 50 % region of the place holds the truth.",
        lambda scored: coverage(scored.trials, 0.5),
    ),
    "coverage_90": Metric(
        "Share of the trials whose letter is known and right in which the 90 % region of the place holds the truth.",
        lambda scored: coverage(scored.trials, 0.9),
    ),
    "sharpness_mm": Metric(
        "Mean radius of the 90 % region, in the metric of the error, where the letter is known and right.",
        lambda scored: mean_where(scored.trials.radius_90, scored.trials.sure),
    ),
    "refused_known": Metric(
        "Share of the trials of known letters whose estimate is 'none'; None without such trials.",
        lambda scored: refused(scored.trials, scored.trials.known),
    ),
    "refused_unknown": Metric(
        "Share of the trials of held-out letters whose estimate is 'none'; None without such trials.",
        lambda scored: refused(scored.trials, ~scored.trials.known),
    ),
    "evaluations": Metric(
        "Mean number of likelihood evaluations of the update at each reading.",
        lambda scored: scored.trials.evaluations.mean(axis=0),
    ),
}
# One number or table a run.
HEADLINES: dict[str, Metric] = {
    "all_right_from": Metric(
        "Find the reading from which every trial is and stays right.",
        lambda scored: settled_by(scored.trials.right, 1.0),
    ),
    "settled_95": Metric(
        "Find the reading by which 95 % of the trials are and stay right.",
        lambda scored: settled_by(scored.trials.right, 0.95),
    ),
    "settled_50": Metric(
        "Find the reading by which half of the trials are and stay right.",
        lambda scored: settled_by(scored.trials.right, 0.5),
    ),
    "recovered_within_3": Metric(
        "Share of the jumps (steps of 4 mm or more) after which one of the next three estimates is right to 1 mm.",
        lambda scored: recovered_within(scored, 3),
    ),
    "confusion": Metric(
        "Count the estimates after the last reading: {true letter: {estimated letter: trials}}.",
        lambda scored: confusion(scored.trials),
    ),
}


def summarise(trials: Trials, objects: Mapping[str, Placement]) -> dict[str, Any]:
    """Compute every metric: lists over the reading count 1..r (None where undefined) and headlines."""
    scored = Scored(trials, objects)
    metrics = {**CURVES, **HEADLINES, **kinds.load(trials.kind).metrics}
    summary = {name: metric.compute(scored) for name, metric in metrics.items()}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in summary.items()
    }


def mean_where(values: FloatArray, chosen: NDArray[np.bool_]) -> Curve:
    """Average the chosen entries of each column; None where there is none."""
    count = chosen.sum(axis=0)
    with np.errstate(invalid="ignore"):
        return nones(np.where(chosen, values, 0).sum(axis=0) / np.where(count, count, np.nan))


def nones(values: FloatArray) -> Curve:
    """Replace NaN by None, which JSON can hold."""
    if np.isfinite(values).all():
        return values
    return [float(value) if np.isfinite(value) else None for value in values]
