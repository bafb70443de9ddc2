"""Figures: one table of what each is called, how tables show it, and how it is computed from the raw trials.

They need only `Trials` and the objects' properties, both of which a run's folder keeps, so a metric
added later applies to every old run.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.bench import kinds
from tactsim.bench.intervals import LEVEL, NOTHING, Figure, counts_of, mean, ratio, share, wilson
from tactsim.bench.trials import Trials
from tactsim.core import invert, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE

JUMP, RECOVERED = 4.0, 1.0  # mm: a step that is a jump, and the placement error that ends it
LEAST_ERROR = 0.01  # mm, below which no placement of a pad with taxels of 1.8 mm is told from another
QUARTERS = 4  # of the trials, by the radius of their regions
# Which the distance of 95 in 100 samples stays below (Smirnov 1948), times `_stephens`.
KOLMOGOROV_95 = 1.3581


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
    """Trials with what several figures need of them, worked out once.

    objects: measure each object's placement. bounds: (n, r) mm, the Cramer-Rao bounds; None if not known. parts: of
    trials of several runs, one run after the other, those of each.
    """

    trials: Trials
    objects: Mapping[str, Any]
    bounds: FloatArray | None = None
    parts: tuple[Scored, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[Scored]) -> Scored:
        """Put the trials of runs of the same objects one after the other."""
        if len(parts) == 1:
            return parts[0]
        known = [part.bounds for part in parts if part.bounds is not None]
        return cls(
            Trials.joined(part.trials for part in parts),
            parts[0].objects,
            np.concatenate(known) if len(known) == len(parts) else None,
            tuple(parts),
        )

    @cached_property
    def error(self) -> FloatArray:
        """The placement error (n, r) in mm of every estimate; NaN of a method that places nothing."""
        if self.parts:
            return np.concatenate([part.error for part in self.parts])
        found = errors(self.trials, self.objects)
        return found if self.trials.places else np.full_like(found, np.nan)

    @cached_property
    def worst(self) -> list[Figure]:
        """The coverage of the worst quarter after each reading, which takes a bootstrap each."""
        return [worst_quarter(self, k) for k in range(self.trials.label.shape[1])]

    @property
    def runs(self) -> tuple[Scored, ...]:
        """Give the trials of each run."""
        return self.parts or (self,)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Count the trials of each run."""
        return tuple(len(part.trials.truth) for part in self.runs)


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
    """A figure of a run: what it is, in one line, and how it follows from the trials and their errors.

    compute: over the reading count, (r,) or a list with None where undefined, or one number or table a run. pooled: the
    figure and its interval over the trials of several runs, after reading k + 1 where it has one; None if no table
    shows it. heading: of a column of a table; {} stands for the reading. digits: decimals at least; 0 of a count of
    readings, None for whole numbers or three digits, without an interval. better: +1 if more is better, -1 if less is,
    0 if neither. section: of a report's page whose table at a chosen reading shows it, "curves" or "certainty". table:
    whether it is one itself. values: (n, r) of a figure that is the mean over trials.
    """

    description: str
    compute: Callable[[Scored], Any]
    pooled: Callable[[Scored, int], Figure] | None = None
    heading: str = ""
    digits: int | None = 3
    better: int = 0
    section: str = ""
    table: bool = False
    values: Callable[[Scored], NDArray[Any]] | None = None

    @property
    def of_readings(self) -> bool:
        """Tell whether it is of each reading, and not of whole trials."""
        return not self.table and (not self.heading or "{}" in self.heading)

    @property
    def column(self) -> str:
        """Give the heading where the reading is said elsewhere."""
        return re.sub(r",? (after|of reading) {}", "", self.heading)


def _all(scored: Scored) -> NDArray[np.bool_]:
    return np.ones_like(scored.trials.right)


def _known(scored: Scored) -> NDArray[np.bool_]:
    return scored.trials.known[:, None] & _all(scored)


def _named(scored: Scored) -> NDArray[np.bool_]:
    return scored.trials.named


def _sure(scored: Scored) -> NDArray[np.bool_]:
    return scored.trials.sure


def averaged(
    description: str,
    values: Callable[[Scored], NDArray[Any]],
    heading: str,
    among: Callable[[Scored], NDArray[np.bool_]] = _all,
    digits: int | None = 3,
    better: int = 0,
    section: str = "",
) -> Metric:
    """Describe the mean of `values` (n, r), or the share where they are booleans, of the trials `among` (n, r)."""

    def pooled(scored: Scored, k: int) -> Figure:
        of = values(scored)[:, k]
        return (share if of.dtype == bool else mean)(of, scored.sizes, among(scored)[:, k])

    def compute(scored: Scored) -> Curve:
        return mean_where(np.asarray(values(scored), dtype=float), among(scored))

    return Metric(description, compute, pooled, heading, digits, better, section, values=values)


def _settled(description: str, part: float, heading: str) -> Metric:
    """Describe the reading by which this part of the trials are and stay right."""

    def pooled(scored: Scored, _: int) -> Figure:
        right = scored.trials.right
        at, readings, counts = settled_at(right), right.shape[1], counts_of(scored.sizes)
        # (draws, readings) trials settled by then
        settled = counts @ (at[:, None] <= np.arange(1, readings + 1))
        enough = settled >= part * counts.sum(axis=1, keepdims=True) - 1e-9
        drawn = np.where(enough.any(axis=1), enough.argmax(axis=1) + 1, readings + 1)
        ends = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], method="inverted_cdf")
        return Figure(settled_by(right, part), *(int(end) if end <= readings else None for end in ends))

    def compute(scored: Scored) -> int | None:
        return settled_by(scored.trials.right, part)

    return Metric(description, compute, pooled, heading, digits=0, better=-1)


def _all_right_from(scored: Scored, _: int) -> Figure:
    """Find the reading from which every trial is and stays right; least and most are those of a single run."""
    each = [settled_by(run.trials.right, 1.0) for run in scored.runs]
    known = [reading for reading in each if reading is not None]
    return Figure(
        settled_by(scored.trials.right, 1.0),
        min(known) if known else None,
        max(known) if len(known) == len(each) else None,
    )


def _recovered(scored: Scored, _: int) -> Figure:
    of_runs = zip(*(recoveries(run, 3) for run in scored.runs), strict=True)
    jumps, found = map(np.concatenate, of_runs)
    return ratio(found, jumps, scored.sizes)


def worst_quarter(scored: Scored, k: int) -> Figure:
    """Find the least coverage of the 90 % regions among quarters of the stated radius, after reading k + 1.

    The trials whose letter is known and right are sorted by the radius of their region and cut in four. The interval
    is of the least of four: its ends are the least of the four intervals' ends, each of which has a quarter of the 5 %
    (Bonferroni), so that all four hold at once. None of fewer than four trials.
    """
    trials = scored.trials
    sure = np.flatnonzero(trials.sure[:, k])
    if len(sure) < QUARTERS:
        return NOTHING
    held = trials.credibility[:, k] < 0.9
    order = sure[np.argsort(trials.radius_90[sure, k], kind="stable")]
    quarters = [
        share(held, scored.sizes, np.isin(np.arange(len(held)), part), 1 - (1 - LEVEL) / QUARTERS)
        for part in np.array_split(order, QUARTERS)
    ]
    ends = zip(*((one.value, one.low, one.high) for one in quarters), strict=True)
    return Figure(*(min(end for end in of if end is not None) for of in ends))


def ranks(scored: Scored, k: int) -> FloatArray:
    """Give the ranks of the truth after reading k + 1, sorted: the belief that lies nearer to the estimate, 0 to 1.

    Of the trials whose letter is known and right. If the belief is right they are spread evenly (simulation-based
    calibration: Talts et al. 2018).
    """
    return np.sort(scored.trials.credibility[scored.trials.sure[:, k], k])


def rank_band(count: int) -> float:
    """Give how far, at most, the distribution of so many even ranks lies from the diagonal in 95 of 100 cases.

    The band holds everywhere at once: a run leaves it just where `rank_p` is below .05.
    """
    return KOLMOGOROV_95 / _stephens(count)


def rank_p(scored: Scored, k: int) -> float | None:
    """Test whether the ranks of the truth are even (Kolmogorov and Smirnov); None without any.

    With Stephens's (1970) correction for few ranks.
    """
    found = ranks(scored, k)
    count = len(found)
    if not count:
        return None
    steps = np.arange(count + 1) / count
    away = max(float((steps[1:] - found).max()), float((found - steps[:-1]).max())) * _stephens(count)
    if away < 0.2:  # the series needs ever more terms, and the sum is 1 to twelve digits
        return 1.0
    terms = np.arange(1, 101)
    return float(np.clip(2 * ((-1.0) ** (terms - 1) * np.exp(-2 * (terms * away) ** 2)).sum(), 0, 1))


def _stephens(count: int) -> float:
    return float(np.sqrt(count) + 0.12 + 0.11 / np.sqrt(count))


# Over the reading count. `bench list metrics` shows them in this order.
CURVES: dict[str, Metric] = {
    "accuracy": averaged(
        "Share of the trials whose letter is right, after each reading.",
        lambda scored: scored.trials.right,
        "right after {}",
        better=1,
        section="curves",
    ),
    "accuracy_low": Metric(
        "Lower end of the accuracy's 95 % Wilson interval.",
        lambda scored: wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[0],
    ),
    "accuracy_high": Metric(
        "Upper end of the accuracy's 95 % Wilson interval.",
        lambda scored: wilson(scored.trials.right.sum(axis=0), len(scored.trials.truth))[1],
    ),
    "error_mm": averaged(
        "Mean placement error of the trials whose letter is known and right (as the paper averages it).",
        lambda scored: scored.error,
        "error after {}, mm",
        _named,
        digits=2,
        better=-1,
        section="curves",
    ),
    "error_standard_error_mm": Metric("Give the standard error of `error_mm`.", error_standard_error),
    "error_all_mm": averaged(
        "Mean placement error over all trials of known letters, the wrong estimates included.",
        lambda scored: scored.error,
        "error over all trials after {}, mm",
        _known,
        digits=2,
        better=-1,
        section="curves",
    ),
    "negative_log_likelihood": averaged(
        "Mean of -log p(right label), in nats; p is floored at the smallest normal float.",
        lambda scored: -np.log(np.clip(scored.trials.p_truth, np.finfo(float).tiny, None)),
        "-log p of the right letter after {}",
        better=-1,
    ),
    "brier": averaged(
        "Mean squared difference between the estimate's stated probability and 1 where it is right, 0 where it is not.",
        lambda scored: (scored.trials.p_label - scored.trials.right) ** 2,
        "Brier score after {}",
        better=-1,
    ),
    "calibration_gap": averaged(
        "Mean stated probability of the estimate minus its accuracy: above 0 is overconfident.",
        lambda scored: scored.trials.p_label - scored.trials.right,
        "letter's probability less its accuracy after {}",
    ),
    "coverage_50": averaged(
        "Share of the trials whose letter is known and right in which the 50 % region of the place holds the truth.",
        lambda scored: scored.trials.credibility < 0.5,
        "50 % regions hold the truth after {}",
        _sure,
        section="certainty",
    ),
    "coverage_90": averaged(
        "Share of the trials whose letter is known and right in which the 90 % region of the place holds the truth.",
        lambda scored: scored.trials.credibility < 0.9,
        "90 % regions hold the truth after {}",
        _sure,
        section="certainty",
    ),
    "coverage_90_worst": Metric(
        "`coverage_90` of the worst quarter: trials are cut in four by the radius of their region.",
        lambda scored: [one.value for one in scored.worst],
        worst_quarter,
        "90 % regions of the worst quarter hold the truth after {}",
        better=1,
        section="certainty",
    ),
    "coverage_90_worst_low": Metric(
        "Lower end of the 95 % interval of `coverage_90_worst`, corrected for four quarters.",
        lambda scored: [one.low for one in scored.worst],
    ),
    "coverage_90_worst_high": Metric(
        "Upper end of the 95 % interval of `coverage_90_worst`, corrected for four quarters.",
        lambda scored: [one.high for one in scored.worst],
    ),
    "rank_p": Metric(
        "Chance of ranks of the truth as uneven as these, if beliefs are right (Kolmogorov and Smirnov).",
        lambda scored: [rank_p(scored, k) for k in range(scored.trials.label.shape[1])],
        lambda scored, k: Figure(rank_p(scored, k), None, None),
        "p of even ranks after {}",
        better=1,
        section="certainty",
    ),
    "sharpness_mm": averaged(
        "Mean radius of the 90 % region, in the metric of the error, where the letter is known and right.",
        lambda scored: scored.trials.radius_90,
        "90 % within, after {}, mm",
        _sure,
        digits=2,
        better=-1,
        section="certainty",
    ),
    "nees": averaged(
        "Mean squared error of the belief's mean over its covariance, a number of the pose, where the letter is right.",
        lambda scored: scored.trials.nees,
        "error squared over covariance after {}",
        lambda scored: _sure(scored) & ~np.isnan(scored.trials.nees),
        digits=2,
        section="certainty",
    ),
    "refused_known": averaged(
        "Share of the trials of known letters whose estimate is 'none'; None without such trials.",
        lambda scored: scored.trials.label == NONE,
        "others refused after {}",
        _known,
        better=-1,
    ),
    "refused_unknown": averaged(
        "Share of the trials of held-out letters whose estimate is 'none'; None without such trials.",
        lambda scored: scored.trials.label == NONE,
        "refused after {}",
        lambda scored: ~_known(scored),
        better=1,
    ),
    "evaluations": averaged(
        "Mean number of likelihood evaluations of the update at each reading.",
        lambda scored: scored.trials.evaluations,
        "likelihood evaluations of reading {}",
        lambda scored: scored.trials.taken,
        digits=None,
        better=-1,
    ),
}
# One number or table a run.
HEADLINES: dict[str, Metric] = {
    "touches": Metric(
        "Mean number of touches that a trial took: fewer than it may where it ends as soon as it is sure (`stop_at`).",
        lambda scored: float(scored.trials.touches.mean()),
        lambda scored, _: mean(scored.trials.touches, scored.sizes),
        "touches taken",
        digits=1,
        better=-1,
    ),
    "all_right_from": Metric(
        "Find the reading from which every trial is and stays right.",
        lambda scored: settled_by(scored.trials.right, 1.0),
        _all_right_from,
        "all right from",
        digits=0,
        better=-1,
    ),
    "settled_95": _settled(
        "Find the reading by which 95 % of the trials are and stay right.", 0.95, "95 % settled by"
    ),
    "settled_50": _settled(
        "Find the reading by which half of the trials are and stay right.", 0.5, "half settled by"
    ),
    "recovered_within_3": Metric(
        "Share of the jumps (steps of 4 mm or more) after which one of the next three estimates is right to 1 mm.",
        lambda scored: recovered_within(scored, 3),
        _recovered,
        "jumps found again",
        better=1,
    ),
    "confusion": Metric(
        "Count the estimates after the last reading: {true letter: {estimated letter: trials}}.",
        lambda scored: confusion(scored.trials),
        table=True,
    ),
}


def _bounded(scored: Scored, name: str) -> Curve:
    from tactsim.bench.cramer_rao import bound_curves  # most runs do without that room

    nothing: list[float | None] = [None] * scored.trials.label.shape[1]
    return nothing if scored.bounds is None else bound_curves(scored.bounds, scored)[name]


def _bound(scored: Scored, k: int) -> Figure:
    from tactsim.bench.cramer_rao import stated

    if scored.bounds is None:
        return NOTHING
    return mean(scored.bounds[:, k], scored.sizes, stated(scored.bounds[:, k], scored.trials))


def _efficiency(scored: Scored, k: int) -> Figure:
    from tactsim.bench.cramer_rao import stated

    if scored.bounds is None:
        return NOTHING
    error, bounds = scored.error[:, k], scored.bounds[:, k]
    chosen = stated(bounds, scored.trials) & scored.trials.named[:, k] & ~np.isnan(error)
    return ratio(np.where(chosen, error, 0), np.where(chosen, bounds, 0), scored.sizes)


# What only tables show, since it needs more than the trials: the bounds of their errors, or the time that they took.
BESIDE: dict[str, Metric] = {
    "bound_mm": Metric(
        "Mean Cramer-Rao bound of the trials whose readings determine the place.",
        lambda scored: _bounded(scored, "bound_mm"),
        _bound,
        "Cramer-Rao bound after {}, mm",
    ),
    "efficiency": Metric(
        "Mean error over mean bound of the same trials.",
        lambda scored: _bounded(scored, "efficiency"),
        _efficiency,
        "error / bound after {}",
        digits=2,
        better=-1,
        section="curves",
    ),
    "ms": Metric(
        "Processor time of a recognition, ms: the median over the trials.",
        lambda scored: 1e3 * recognition_seconds(scored.trials, scored.trials.label.shape[1]),
        heading="ms a recognition",
        digits=None,
        better=-1,
    ),
}


def figures(kind: str) -> dict[str, Metric]:
    """Give the figures of runs of a kind by name, in the order in which they are listed."""
    return {**CURVES, **HEADLINES, **BESIDE, **kinds.load(kind).metrics}


def summarise(scored: Scored) -> dict[str, Any]:
    """Compute every metric: lists over the reading count 1..r (None where undefined) and headlines."""
    metrics = {**CURVES, **HEADLINES, **kinds.load(scored.trials.kind).metrics}
    summary = ((name, metric.compute(scored)) for name, metric in metrics.items())
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in summary}


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
