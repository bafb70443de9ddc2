"""Fill the tables of the default beside the settings that it chooses from: `page_default.py FOLDER PAGE...`.

A page says between two comments which tasks it wants, and of how many trials of each object if not of the task's own:

    <!-- default: letters-offgrid-v1; tekscan22-v2 1 -->
    <!-- end of default -->

What a task asks is done with other seeds than its own, which nobody has looked at while the default was made; runs that
FOLDER has already are not done again. Each row is a figure that the task scores, with the paired difference of the
default to the best of the settings, and its 95 % interval over scans and trials.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from page_blocks import asked_for, exit_status, fill_blocks, fill_page, read_page

import tactsim
from tactsim.bench.config import RunConfig
from tactsim.bench.intervals import Figure, mean
from tactsim.bench.results import Run
from tactsim.bench.runs.saved import load
from tactsim.bench.runs.tables import heading, markdown_table
from tactsim.bench.score import CURVES, Scored
from tactsim.bench.tasks import task
from tactsim.core import InputError
from tactsim.core.source_digest import short_commit
from tactsim.estimators import create

SEEDS = range(119, 124)
DEFAULT, BASELINE = RunConfig.model_fields["estimator"].default, "nearest"
CHOICE = ("refined", "graded", "force-mosaic")
FIGURES = ("accuracy", "error_all_mm", "negative_log_likelihood")  # that every trial has


def do(folder: Path, name: str, trials: int | None, method: str, seed: int) -> None:
    """Do what the task `name` asks of a method with another seed, unless it is there, and keep the run."""
    place = folder / f"{name}--{method}--{seed}"
    if place.exists():
        return
    asked = task(name)
    words = {**asked.words, "trials": trials or asked.trials, "readings": asked.readings}
    if words.get("explore") == "information" and not create(method).proposes:
        words["explore"] = "blind"
    # The default finds out by itself whether anything moves.
    settings = {"motion": "auto"} if "slip" in words and method in CHOICE else {}
    tactsim.run(estimator=method, seed=seed, set=settings, **words).save(place)
    print(place.name, file=sys.stderr, flush=True)


def _asked(words: str) -> list[tuple[str, int | None]]:
    """Read the tasks that a block wants, and of each its number of trials or None."""
    parts = [part.split() for part in words.split(";")]
    return [(name, int(of[0]) if of else None) for name, *of in parts]


def table(words: str, folder: Path) -> str:
    """Lay out the tasks that a block wants as a table, from the runs in a folder."""
    rows = [["task", "figure", BASELINE, *CHOICE, DEFAULT, "less the best of the three"]]
    commits: set[str] = set()
    for name, _ in _asked(words):
        runs = {
            method: [load(folder / f"{name}--{method}--{seed}") for seed in SEEDS]
            for method in (BASELINE, *CHOICE, DEFAULT)
        }
        commits |= {short_commit(run.about["commit"]) for of in runs.values() for run in of}
        rows += _rows(name, runs)
    if len(commits) > 1:
        raise InputError(f"the runs are of different commits, {', '.join(sorted(commits))}; do them anew")
    seeds = f"seeds {SEEDS[0]} to {SEEDS[-1]}"
    return f"{markdown_table(rows)}\n*`docs/tools/page_default.py`: {seeds}; commit {commits.pop()}.*\n"


def _rows(name: str, runs: Mapping[str, Sequence[Run]]) -> list[list[str]]:
    scored = {method: Scored.joined([run.scored for run in of]) for method, of in runs.items()}
    default, trials = scored[DEFAULT], f"{name}, {len(scored[DEFAULT].trials.truth)} trials"
    rows = []
    for figure in task(name).scored:
        metric, _, reading = figure.partition("@")
        told = CURVES[metric].values if metric in FIGURES else None
        if told is None:
            continue
        values = {method: told(of)[:, int(reading) - 1].astype(float) for method, of in scored.items()}
        known = [method for method in CHOICE if not np.isnan(values[method]).any()]
        if not known or np.isnan(values[DEFAULT]).any():  # a place that nobody knows
            continue
        best = max(known, key=lambda method: CURVES[metric].better * values[method].mean())
        less = mean(values[DEFAULT] - values[best], default.sizes)
        cells = ["-" if np.isnan(of).any() else f"{of.mean():.3f}" for of in values.values()]
        rows.append(["" if rows else trials, heading(figure), *cells, _apart(less)])
    return rows


def _apart(less: Figure) -> str:
    value, *ends = (f"{round(of or 0.0, 3) + 0.0:+.3f}" for of in (less.value, less.low, less.high))
    return f"{value} ({' to '.join(ends)})"


def main(words: Sequence[str]) -> int:
    """Do the runs that the pages want and FOLDER lacks, and fill the tables; returns the exit status."""

    def work() -> None:
        folder, pages = Path(words[0]), [Path(page) for page in words[1:]]
        wanted = [one for page in pages for block in asked_for(read_page(page), "default")
                  for one in _asked(block)]  # fmt: skip
        with ProcessPoolExecutor() as pool:
            begun = [
                pool.submit(do, folder, name, trials, method, seed)
                for seed in SEEDS
                for name, trials in wanted
                for method in (DEFAULT, *CHOICE, BASELINE)
            ]
            for one in begun:
                one.result()
        for page in pages:
            fill_page(page, partial(fill_blocks, kind="default", made=partial(table, folder=folder)))

    return exit_status("default", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
