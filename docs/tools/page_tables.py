"""Fill the tables of a page with what sweeps found: `python docs/tools/page_tables.py PAGE...`.

A page says itself which table it wants, between two comments. The first names the sweep and the figures:

    <!-- table: SWEEP; accuracy@5; settled_95; error_mm@20 -->
    <!-- end of table -->

The sweep is a folder in results/sweeps, and its runs are pooled over their seeds, of which there are five at least.
There is a row for each method and, if the sweep has several, for each protocol or condition. `SWEEP by method` makes
a column of each method, and a row of each condition; `SWEEP by method: refined, graded` of these methods only. `SWEEP
by condition` makes a column of each condition, and a row of each method. A figure after several readings,
`coverage_90@3,5,10`, is written without intervals. What stands between the comments is replaced.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from page_blocks import exit_status, fill_blocks, fill_page

from tactsim.bench.places import SWEEPS
from tactsim.bench.report.write import find
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import Pooled, cell, pool
from tactsim.bench.runs.saved import load
from tactsim.bench.runs.tables import markdown_table, plain_rows, scans_and_trials
from tactsim.bench.trials import source_of_trials
from tactsim.core import InputError
from tactsim.core.errors import counted, unknown
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
        if by == "condition":
            rows = _by_condition(shown, figures)
        else:
            rows = _by_method(shown, figures) if by == "method" else plain_rows(shown, figures)
        return f"{markdown_table(rows)}\n{_origin(name, shown)}\n"

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


def _origin(sweep: str, pools: Sequence[Pooled]) -> str:
    """Say beneath a table how it was made; what brackets hold, and of how many bins filters are, the page says once."""
    return f"*`bench sweep {sweep}`: {scans_and_trials(pools)}; commit {_commit(pools[0].runs[0])}.*"


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


def _by_condition(pools: Sequence[Pooled], figures: Sequence[str]) -> list[list[str]]:
    """Write a row for each method and a column for each condition."""
    head, *rows = zip(*_by_method(pools, figures), strict=True)
    return [["method", *head[1:]], *map(list, rows)]


def _name(pools: Sequence[Pooled], protocol: str, task: str) -> str:
    """Name a condition by its task, and by its protocol if that is not the first one's."""
    return task if protocol == pools[0].protocol else f"{task} ({protocol})"


def main(pages: Sequence[str]) -> int:
    """Fill the tables of these pages; returns the exit status."""

    def work() -> None:
        for page in pages:
            fill_page(Path(page), partial(fill, sweeps=SWEEPS))

    return exit_status("tables", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
