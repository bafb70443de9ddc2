"""Time against error: what a recognition costs with each method and budget, and how exact it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactsim.bench.runs.pooled import Group, Pooled
from tactsim.bench.score import recognition_seconds, settled_by


@dataclass(frozen=True, eq=False)
class Point:
    """One run in the plane of time and error, after the readings that all runs of its group have.

    seconds: computing time of a recognition. error, low, high: mm, mean placement error where the
    letter is right, with the 95 % interval of the mean; None where no letter is right. settled: the
    reading by which 95 % of the trials are and stay right, None if later. *_frontier: whether no
    other run is at once as fast and as good.
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
    readings = group.readings
    found = []
    for entry in group.entries:
        trials = entry.trials
        error = entry.summary["error_mm"][readings - 1]
        low, high = (end[readings - 1] for end in entry.error_band)
        found.append(
            (
                entry,
                recognition_seconds(trials, readings),
                error,
                error if low is None else low,
                error if high is None else high,
                settled_by(trials.right[:, :readings], 0.95),
            )
        )
    seconds = [point[1] for point in found]
    by_error = frontier(seconds, [point[2] for point in found])
    by_settled = frontier(seconds, [point[5] for point in found])
    return [
        Point(*point, error_frontier=first, settled_frontier=second)
        for point, first, second in zip(found, by_error, by_settled, strict=True)
    ]


def frontier(costs: Sequence[float], losses: Sequence[float | None]) -> list[bool]:
    """Tell which points no other point dominates; both axes are better when smaller, None is no result.

    A point dominates another if it is no worse on both axes and better on one.
    """
    pairs = list(zip(costs, losses, strict=True))
    return [
        loss is not None
        and not any(
            other is not None and c <= cost and other <= loss and (c < cost or other < loss)
            for c, other in pairs
        )
        for cost, loss in pairs
    ]


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
