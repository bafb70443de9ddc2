"""What a report plots: every curve as tidy CSV, a row a point, and time against error of each run with its frontier."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.columns import csv_text
from tactsim.bench.report.recognition import Replayed
from tactsim.bench.runs.pooled import Group, Pooled
from tactsim.bench.score import BESIDE, CURVES, error_limits, recognition_seconds, settled_by
from tactsim.bench.trials import Trials

_WHO = ("protocol", "task", "run", "folder", "seed", "estimator", "budget")
_ERROR_BAND = ("error_low_mm", "error_high_mm")
_FIGURES = (*CURVES, *_ERROR_BAND, *(name for name, metric in BESIDE.items() if metric.of_readings))


# The columns of NAME.csv.
COLUMNS: dict[str, Sequence[str]] = {
    "readings": (*_WHO, "reading", *_FIGURES),
    "reliability": (*_WHO, "probability", "right", "estimates"),
    "pareto": (
        *_WHO, "method", "budget_option", "readings", "seconds_per_recognition",
        "error_mm", "error_low_mm", "error_high_mm", "settled_95", "error_frontier", "settled_frontier",
    ),
    "confusion": (*_WHO, "reading", "truth", "label", "trials"),
    "recognition": ("run", "truth", "trial", "reading", "letter", "probability", "label", "error_mm"),
}  # fmt: skip


def tables(groups: Sequence[Group], replayed: Sequence[Replayed]) -> dict[str, str]:
    """Write what a report plots: {name: content of NAME.csv}, one for each of COLUMNS."""
    rows = {
        "readings": _readings(groups),
        "reliability": _reliability(groups),
        "pareto": _pareto(groups),
        "confusion": _confusion(groups),
        "recognition": _recognition(replayed),
    }
    return {name: csv_text(columns, rows[name]) for name, columns in COLUMNS.items()}


def curves(entry: Pooled) -> dict[str, Any]:
    """Give every figure of an entry by name, also those of its bound."""
    return {**entry.summary, **entry.against_bound}


def axis_of_errors(group: Group) -> tuple[float, float]:
    """Choose the limits, mm, of a logarithmic axis for the errors of a group's runs, with their intervals."""
    errors: list[Any] = []
    for entry in group.entries:
        error, (low, high) = np.array(entry.summary["error_mm"], dtype=float), entry.error_band
        # Half the error is room enough for an interval that ends near 0.
        errors += [error, high, np.fmax(np.array(low, dtype=float), error / 2)]
    bounds = np.concatenate([np.array(entry.against_bound["bound_mm"], float) for entry in group.entries])
    return error_limits([np.array(curve, dtype=float) for curve in errors], bounds)


def below_bound(group: Group) -> list[str]:
    """Say which runs err less than the Cramer-Rao bound, or where none is known than an axis shows, and why."""
    why = "the bound is of estimators without a bias, which know nothing of the pose beforehand"
    if "test poses same" in group.protocol:
        why = "its test readings were taken at the poses of its training readings, one of which it names"
    notes = []
    for entry in group.entries:
        bounds = np.array(entry.against_bound["bound_mm"], dtype=float)
        known = np.isfinite(bounds).any()
        limits = bounds if known else np.full(len(bounds), axis_of_errors(group)[0])
        below = np.flatnonzero(np.array(entry.error_band[1], dtype=float) < limits)
        if len(below):
            limit = "the Cramer-Rao bound" if known else f"{limits[0]:.2g} mm"
            notes.append(f"{entry.label} errs less than {limit} from reading {below[0] + 1} on: {why}.")
    return notes


def confusion_counts(entry: Pooled) -> tuple[list[str], NDArray[np.int64]]:
    """Count trials by true letter and estimate: returns the labels, and counts (readings, labels, labels).

    The labels are the true letters, then all other labels that are estimated or right.
    """
    trials = entry.trials
    others = np.union1d(trials.label, trials.answer)
    letters = list(dict.fromkeys([*trials.truth.tolist(), *others.tolist()]))
    order = np.argsort(letters)
    truth, label = (order[np.searchsorted(letters, of, sorter=order)] for of in (trials.truth, trials.label))
    counts = np.zeros((entry.readings, len(letters), len(letters)), dtype=np.int64)
    np.add.at(counts, (np.arange(entry.readings), truth[:, None], label), 1)
    return letters, counts


@dataclass(frozen=True)
class Reliability:
    """Estimates that were stated with about the same probability: their mean, the share that is right, how many."""

    probability: float
    right: float
    count: int


def reliability(trials: Trials) -> list[Reliability]:
    """Compare the probability of the estimated letter with how often it is right (Murphy and Winkler 1977).

    All readings of all trials are put into ten bins of equal width; empty ones are left out.
    """
    stated, right = trials.p_label[trials.taken], trials.right[trials.taken]
    place = np.minimum((stated * 10).astype(np.intp), 9)
    return [
        Reliability(float(stated[mine].mean()), float(right[mine].mean()), int(mine.sum()))
        for mine in (place == number for number in np.unique(place))
    ]


def _who(group: Group, entry: Pooled) -> tuple[str, ...]:
    of_runs = entry.label, str(entry.folder), entry.seeds, entry.run.estimator
    return group.protocol, group.task, *of_runs, str(entry.budget.amount) if entry.budget else ""


def _readings(groups: Sequence[Group]) -> Iterator[Sequence[Any]]:
    for group in groups:
        for entry in group.entries:
            values = curves(entry) | dict(zip(_ERROR_BAND, entry.error_band, strict=True))
            for number, row in enumerate(zip(*(values[name] for name in _FIGURES), strict=True), start=1):
                yield *_who(group, entry), number, *row


def _reliability(groups: Sequence[Group]) -> Iterator[Sequence[Any]]:
    for group in groups:
        for entry in group.entries:
            for one in reliability(entry.trials):
                yield *_who(group, entry), one.probability, one.right, one.count


def _pareto(groups: Sequence[Group]) -> Iterator[Sequence[Any]]:
    for group in groups:
        for point in points(group):
            budget = point.entry.budget
            yield (
                *_who(group, point.entry), point.entry.method,
                budget.option if budget else None, group.readings,
                point.seconds, point.error, point.low, point.high, point.settled,
                point.error_frontier, point.settled_frontier,
            )  # fmt: skip


def _confusion(groups: Sequence[Group]) -> Iterator[Sequence[Any]]:
    for group in groups:
        for entry in group.entries:
            letters, counts = confusion_counts(entry)
            for reading, truth, label in np.argwhere(counts):
                count = counts[reading, truth, label]
                yield *_who(group, entry), reading + 1, letters[truth], letters[label], count


def _recognition(replayed: Sequence[Replayed]) -> Iterator[Sequence[Any]]:
    for of_run in replayed:
        for trial in of_run.recognitions:
            for k, row in enumerate(trial.probabilities):
                for letter, p in zip(trial.labels, row, strict=True):
                    yield (
                        trial.entry.label, trial.task.truth, trial.task.trial, k + 1, letter, p,
                        trial.label[k], trial.error[k],
                    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Point:
    """One run in the plane of time and error, after the readings that all runs of its group have.

    seconds: computing time of a recognition. error, low, high: mm, mean placement error where the letter is right, with
    the 95 % interval of the mean; None where no letter is right. settled: the reading by which 95 % of the trials are
    and stay right, None if later. *_frontier: whether no other run is at once as fast and as good.
    """

    entry: Pooled
    seconds: float
    error: float | None
    low: float | None
    high: float | None
    settled: int | None
    error_frontier: bool = False
    settled_frontier: bool = False


def points(group: Group) -> list[Point]:
    """Place every run of a group in the plane of time and error, and mark the frontiers."""
    readings, found = group.readings, list[Point]()
    for entry in group.entries:
        error = entry.summary["error_mm"][readings - 1]
        low, high = (error if end[readings - 1] is None else end[readings - 1] for end in entry.error_band)
        settled = settled_by(entry.trials.right[:, :readings], 0.95)
        found.append(Point(entry, recognition_seconds(entry.trials, readings), error, low, high, settled))
    seconds = [point.seconds for point in found]
    firsts = (frontier(seconds, [getattr(point, by) for point in found]) for by in ("error", "settled"))
    return [
        replace(point, error_frontier=first, settled_frontier=second)
        for point, first, second in zip(found, *firsts, strict=True)
    ]


def frontier(costs: Sequence[float], losses: Sequence[float | None]) -> list[bool]:
    """Tell which points no other point dominates; both axes are better when smaller, None is no result.

    A point dominates another if it is no worse on both axes and better on one.
    """
    known = [(cost, loss) for cost, loss in zip(costs, losses, strict=True) if loss is not None]

    def best(cost: float, loss: float) -> bool:
        return not any(c <= cost and other <= loss and (c, other) != (cost, loss) for c, other in known)

    return [loss is not None and best(cost, loss) for cost, loss in zip(costs, losses, strict=True)]


def has_curves(group: Group) -> bool:
    """Tell whether some method was run at two budgets or more, so that there are curves to draw."""
    return any(
        len({entry.budget.amount for entry in group.entries if entry.method == method and entry.budget}) > 1
        for method in group.methods
    )


def machine_line(entries: Sequence[Pooled]) -> str:
    """Say on which machine, or machines, the times were taken."""
    machines = [entry.run.about["machine"] for entry in entries]
    lines = dict.fromkeys(f"{m['processor']}, {m['cores']} cores, {m['system']}" for m in machines)
    return "; ".join(lines)
