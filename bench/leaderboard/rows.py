"""The figures of a leaderboard as tidy CSV: one row a figure of a method, and one row a pair of methods."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from tactsim.bench.leaderboard.standings import Standings
from tactsim.bench.leaderboard.task_page import columns

FIGURES = ("task", "task_data", "method", "estimator", "file", "status", "rank_best", "rank_worst", "figure", "value",
           "low", "high", "trials", "scans")  # fmt: skip
PAIRS = ("task", "task_data", "method", "other", "accuracy", "only_method_right", "only_other_right", "mcnemar_p",
         "error", "difference", "difference_low", "difference_high", "bootstrap_p")  # fmt: skip


def figures_csv(standings: Iterable[Standings]) -> str:
    """Write every figure of every method; a method without a score has one row with its status."""
    return _csv(FIGURES, (row for of in standings for row in _figures(of)))


def pairs_csv(standings: Iterable[Standings]) -> str:
    """Write the comparison of every pair of ranked methods; p values are corrected for all pairs of the task."""
    return _csv(PAIRS, (row for of in standings for row in _pairs(of)))


def _figures(of: Standings) -> Iterator[Sequence[Any]]:
    for one in (*of.ranked, *of.unranked):
        who = (of.task, of.data, one.bundle.method, one.bundle.estimator, one.path.name, one.status)
        if one.rank is None:
            yield *who, *[""] * (len(FIGURES) - len(who))
            continue
        counts = len(one.bundle.ids), len(one.bundle.runs)
        for figure in columns(of):
            found = one.figure(figure)
            yield *who, *one.rank, figure, found.value, found.low, found.high, *counts
        yield *who, *one.rank, "ms", one.ms_per_reading, None, None, *counts


def _pairs(of: Standings) -> Iterator[Sequence[Any]]:
    wins, errors = of.accuracies.wins, of.errors
    for i, j in zip(*np.triu_indices(len(of.ranked), 1), strict=True):
        found = [float(values[i, j]) for values in (errors.difference, errors.low, errors.high)]
        yield (
            of.task, of.data, of.ranked[i].label, of.ranked[j].label,
            of.accuracy_by, int(wins[i, j]), int(wins[j, i]), float(of.accuracies.p[i, j]),
            of.error_by, *(None if np.isnan(value) else value for value in found), float(errors.p[i, j]),
        )  # fmt: skip


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()
