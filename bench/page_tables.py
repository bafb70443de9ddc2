"""Fill the tables of a page with what sweeps found: `python -m tactsim.bench.page_tables PAGE...`.

A page says itself which table it wants, between two comments. The first names the sweep and the figures:

    <!-- table: SWEEP; right@5; settled_95; error@20 -->
    <!-- end of table -->

The sweep is a folder in results/sweeps, and its runs are pooled over their seeds, of which there are five at least.
There is a row for each method and, if the sweep has several, for each protocol or condition. `SWEEP by method` makes a
column of each method, and a row of each condition; `SWEEP by method: refined, graded` of these methods only. A figure
after several readings, `coverage_90@3,5,10`, is written without intervals. What stands between the comments is
replaced.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tactsim.bench.bound.efficiency import ENOUGH, determined
from tactsim.bench.console import exit_status
from tactsim.bench.counted import counted
from tactsim.bench.page_blocks import fill_blocks, fill_page, markdown_table
from tactsim.bench.places import SWEEPS
from tactsim.bench.pooled import Figure, Pooled, pool
from tactsim.bench.report.collect import find
from tactsim.bench.report.pareto import recognition_seconds
from tactsim.bench.results import load
from tactsim.bench.run import Run
from tactsim.bench.score import recoveries
from tactsim.bench.trial_plan import source_of_trials
from tactsim.core import InputError
from tactsim.core.errors import unknown
from tactsim.core.source_digest import short_commit

# Of how many scans, of different seeds, a published figure is made at least: those of one scan share its maps.
LEAST_SCANS = 5


def fill(text: str, sweeps: Path) -> str:
    """Replace every table of a page by what the sweeps in the folder `sweeps` found.

    Raises InputError for an unknown figure, a sweep that is not there, has not ended, has too few seeds or is of
    other source code, sweeps of different commits, or a table without an end.
    """
    pools: dict[str, list[Pooled]] = {}

    def table(asked: str) -> str:
        sweep, *figures = (part.strip() for part in asked.split(";"))
        name, _, by = sweep.partition(" by ")
        if name not in pools:
            pools[name] = _pools(sweeps / name)
        by, _, methods = by.partition(":")
        shown = _of_methods(pools[name], [method.strip() for method in methods.split(",")] if methods else [])
        rows = _by_method(shown, figures) if by == "method" else _plain(shown, figures)
        return f"{markdown_table(rows)}\n{_origin(name, shown, figures)}\n"

    filled = fill_blocks(text, "table", table)
    commits = {_commit(run) for of in pools.values() for one in of for run in one.runs}
    if len(commits) > 1:
        raise InputError(
            f"the sweeps are of different commits, {', '.join(sorted(commits))}; do them anew from one"
        )
    return filled


def _of_methods(pools: Sequence[Pooled], methods: Sequence[str]) -> list[Pooled]:
    """Choose the pools of some methods, or all if none is named. Raises InputError for a method that is not there."""
    for method in methods:
        if method not in {one.method for one in pools}:
            raise unknown("method of the sweep", method, sorted({one.method for one in pools}))
    return [one for one in pools if not methods or one.method in methods]


def _origin(sweep: str, pools: Sequence[Pooled], figures: Sequence[str]) -> str:
    """Say beneath a table how it was made."""
    counts = sorted({len(of.trials.truth) for of in pools})
    trials = f"{' or '.join(map(str, counts[:-1]))}{' or ' * (len(counts) > 1)}{counted(counts[-1], 'trial')}"
    intervals = "in brackets 95 % intervals over scans and trials; " * any("," not in one for one in figures)
    return (
        f"*`bench sweep {sweep}`: {counted(len(pools[0].runs), 'scan')}, {trials} for each figure; "
        f"{intervals}commit {_commit(pools[0].runs[0])}.*"
    )


def _commit(run: Run) -> str:
    return short_commit(run.about["commit"])


def _pools(folder: Path) -> list[Pooled]:
    folders, remarks = find([folder])
    if remarks:
        raise InputError(remarks[0])
    runs = [load(one) for one in folders]
    if any(run.about["source"] != source_of_trials(run.estimator) for run in runs):
        raise InputError(f"{folder} was made by other source code than this; remove it and do the sweep anew")
    pools = pool(runs)
    fewest = min(len(of.runs) for of in pools)
    if fewest < LEAST_SCANS:
        raise InputError(
            f"{folder} has {counted(fewest, 'seed')}; a published figure takes {LEAST_SCANS} at least"
        )
    return pools


def _plain(pools: Sequence[Pooled], figures: Sequence[str]) -> list[list[str]]:
    """Write a row for each pool; what all of them share is in no column."""
    marks = [("protocol", [one.protocol for one in pools]), ("condition", [one.task for one in pools])]
    shown = [(name, values) for name, values in marks if len(set(values)) > 1]
    rows = [["method", *(name for name, _ in shown), *(_heading(figure) for figure in figures)]]
    for number, one in enumerate(pools):
        rows.append(
            [one.label, *(values[number] for _, values in shown), *(cell(one, figure) for figure in figures)]
        )
    return rows


def _by_method(pools: Sequence[Pooled], figures: Sequence[str]) -> list[list[str]]:
    """Write a row for each condition and a column for each method."""
    methods = list(dict.fromkeys(one.label for one in pools))
    rows = [["condition", *methods]]
    for condition in dict.fromkeys((one.protocol, one.task) for one in pools):
        cells = {
            one.label: ", ".join(cell(one, figure) for figure in figures)
            for one in pools
            if (one.protocol, one.task) == condition
        }
        rows.append([_name(pools, *condition), *(cells.get(method, "") for method in methods)])
    return rows


def _name(pools: Sequence[Pooled], protocol: str, task: str) -> str:
    """Name a condition by its task, and by its protocol if that is not the first one's."""
    return task if protocol == pools[0].protocol else f"{task} ({protocol})"


def cell(one: Pooled, figure: str) -> str:
    """Write one figure of a pool, such as right@5, with its interval; right@5,10 for two readings, without.

    Raises InputError for an unknown figure or a reading that the runs do not have.
    """
    name, _, at = figure.partition("@")
    if "," in at:
        return " / ".join(cell(one, f"{name}@{reading}").partition(" (")[0] for reading in at.split(","))
    if name in READINGS and not at:
        found = READINGS[name](one)
        value, low, high = (str(part or "later") for part in (found.value, found.low, found.high))
        return value if low == high == value else f"{value} ({low}-{high})"
    if name == "recovered_within_3" and not at:
        found = _recovered(one)
        return "-" if found.value is None else f"{found.value:.3f} ({found.low:.3f}-{found.high:.3f})"
    if name == "ms" and not at:
        return f"{1e3 * recognition_seconds(one.trials, one.runs[0].readings):.3g}"
    if name in CURVES and at.isdigit():
        reading, readings = int(at), one.runs[0].readings
        if not 1 <= reading <= readings:
            raise InputError(f"the figure {figure} asks for reading {reading} of {readings}")
        found = CURVES[name](one, reading - 1)
        if found.value is None:
            return "-"
        digits = 2 if name in ("error", "efficiency", "sharpness") else 3
        return f"{found.value:.{digits}f} ({found.low:.{digits}f}-{found.high:.{digits}f})"
    raise unknown(
        "figure", figure, (*READINGS, "recovered_within_3", "ms", *(f"{curve}@5" for curve in CURVES))
    )


def _error(one: Pooled, k: int) -> Figure:
    return one.mean(one.errors[:, k], of=one.trials.named[:, k])


def _recovered(one: Pooled) -> Figure:
    of_runs = [recoveries(run.trials, run.objects, 3) for run in one.runs]
    jumps, found = (np.concatenate(column) for column in zip(*of_runs, strict=True))
    return one.mean(found / np.maximum(jumps, 1), of=jumps > 0)


def _bound(one: Pooled, k: int) -> Figure:
    if one.bounds is None:
        return Figure(None, None, None)
    return one.mean(one.bounds[:, k], of=determined(one.bounds[:, k], one.trials))


def _efficiency(one: Pooled, k: int) -> Figure:
    if one.bounds is None or determined(one.bounds[:, k], one.trials).mean() < ENOUGH:
        return Figure(None, None, None)
    chosen = one.trials.named[:, k] & determined(one.bounds[:, k], one.trials)
    return one.ratio(one.errors[:, k] * chosen, one.bounds[:, k] * chosen)


def _coverage(one: Pooled, k: int, share: float) -> Figure:
    return one.mean(one.trials.credibility[:, k] < share, of=one.trials.sure[:, k])


def _sharpness(one: Pooled, k: int) -> Figure:
    sure = one.trials.sure[:, k]
    return one.mean(np.where(sure, one.trials.radius_90[:, k], 0), of=sure)


# The figures that a table may ask for, of a pool of runs: after reading k + 1, and readings by which something holds.
CURVES: dict[str, Callable[[Pooled, int], Figure]] = {
    "right": lambda one, k: one.mean(one.trials.right[:, k]),
    "error": _error,
    "bound": _bound,
    "efficiency": _efficiency,
    "coverage_50": lambda one, k: _coverage(one, k, 0.5),
    "coverage_90": lambda one, k: _coverage(one, k, 0.9),
    "sharpness": _sharpness,
    "calibration_gap": lambda one, k: one.mean(one.trials.p_label[:, k] - one.trials.right[:, k]),
    "refused_unknown": lambda one, k: one.mean(one.trials.right[:, k], of=~one.trials.known),
    "refused_known": lambda one, k: one.mean(one.trials.label[:, k] == "none", of=one.trials.known),
}
READINGS: dict[str, Callable[[Pooled], Figure]] = {
    "settled_95": lambda one: one.settled(0.95),
    "settled_50": lambda one: one.settled(0.5),
    "all_right_from": Pooled.all_right_from,
}
HEADINGS = {
    "right": "right after {}",
    "error": "error after {}, mm",
    "bound": "Cramer-Rao bound after {}, mm",
    "efficiency": "error / bound after {}",
    "coverage_50": "50 % regions hold the truth after {}",
    "coverage_90": "90 % regions hold the truth after {}",
    "sharpness": "90 % within, after {}, mm",
    "calibration_gap": "letter's probability less its accuracy after {}",
    "refused_unknown": "refused after {}",
    "refused_known": "others refused after {}",
    "settled_95": "95 % settled by",
    "settled_50": "half settled by",
    "all_right_from": "all right from",
    "recovered_within_3": "jumps found again",
    "ms": "ms a recognition",
}


def _heading(figure: str) -> str:
    name, _, at = figure.partition("@")
    return HEADINGS.get(name, name).format(at.replace(",", ", "))


def main(pages: Sequence[str]) -> int:
    """Fill the tables of these pages; returns the exit status."""

    def work() -> None:
        for page in pages:
            fill_page(Path(page), partial(fill, sweeps=SWEEPS))

    return exit_status("tables", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
