"""Which methods of a task can be told apart: paired tests of all pairs, corrected, and the ranks that they leave.

All methods of a task saw the same trials, so they are compared trial by trial. Accuracy: McNemar's exact test,
corrected for the number of pairs by Holm (1979). Placement error: a bootstrap over scans and trials whose draws are
the same for all methods, corrected by the largest of the studentised differences (Westfall and Young 1993). The chance
that a table calls any two equal methods different is then 5 % at most on the scans of the task. The bootstrap also asks
about the next scan, which five scans answer only in part (`pooled`).

A method's rank is given as the range that the tests leave: above it are only methods that are better beyond chance,
below it only worse ones (Mogstad, Romano, Shaikh and Wilhelm 2024, Inference for Ranks).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.compare import mcnemar
from tactsim.bench.intervals import FEWEST_PAIRS, counts_of, percentiles
from tactsim.bench.runs.pooled import Pooled, figure_of, metric_of
from tactsim.core import InputError
from tactsim.core.poses import FloatArray

LEVEL = 0.05  # of a table: the chance that any two equal methods of it are called different


@dataclass(frozen=True, eq=False)
class Accuracies:
    """All pairs of m methods by accuracy.

    wins: (m, m) trials that the row's method has right and the column's has not. p: (m, m), corrected.
    """

    wins: NDArray[np.int64]
    p: FloatArray


@dataclass(frozen=True, eq=False)
class Errors:
    """All pairs of m methods by placement error on the trials that both named, each (m, m).

    difference: mm, the row's mean error less the column's. low, high: its 95 % interval, uncorrected. p: corrected.
    NaN where no trial was named by both; p is 1 there.
    """

    difference: FloatArray
    low: FloatArray
    high: FloatArray
    p: FloatArray


def compare_accuracies(right: NDArray[np.bool_]) -> Accuracies:
    """Compare all pairs of methods by which trials (m, n) they have right, with McNemar's exact test."""
    count = right.astype(np.int64)
    wins = count @ (1 - count).T
    first, second = np.triu_indices(len(right), 1)
    p = np.ones(wins.shape)
    p[first, second] = p[second, first] = holm(
        [mcnemar(right[i], right[j]) for i, j in zip(first, second, strict=True)]
    )
    return Accuracies(wins, p)


def holm(p: Sequence[float]) -> FloatArray:
    """Correct p values for their number (Holm 1979): all that stay below a level do so with that level together."""
    values = np.asarray(p, dtype=float)
    order = np.argsort(values, kind="stable")
    steps = np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1))
    corrected = np.empty(len(values))
    corrected[order] = np.minimum(steps, 1)
    return corrected


def compare_errors(errors: FloatArray, named: NDArray[np.bool_], counts: FloatArray) -> Errors:
    """Compare all pairs of methods by placement errors (m, n), mm, of the trials that both named (m, n).

    counts: (draws, n), how often each bootstrap draw has each trial (`intervals.resampled`). Pairs with fewer common
    trials than `FEWEST_PAIRS` are not told apart.
    """
    methods = len(errors)
    first, second = np.triu_indices(methods, 1)
    both = (named[first] & named[second]).astype(float)  # (pairs, n)
    apart = (errors[first] - errors[second]) * both
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = apart.sum(axis=1) / both.sum(axis=1)
        drawn = (counts @ apart.T) / (counts @ both.T)  # (draws, pairs)
    drawn = np.where(np.isnan(drawn), difference, drawn)  # a draw without a common trial says nothing
    low, high = percentiles(drawn)
    p = _largest_of(np.where(both.sum(axis=1) < FEWEST_PAIRS, 0.0, difference), drawn)
    square = [np.full((methods, methods), np.nan) for _ in range(3)] + [np.ones((methods, methods))]
    halves = (difference, low, high, p), (-difference, -high, -low, p)
    for one, upper, lower in zip(square, *halves, strict=True):
        one[first, second], one[second, first] = upper, lower
    return Errors(*square)


def _largest_of(difference: FloatArray, drawn: FloatArray) -> FloatArray:
    """Give corrected p values of differences (pairs,) from their draws (draws, pairs), by the largest of a draw."""
    p = np.ones(len(difference))
    tested = np.isfinite(difference) & (difference != 0)
    if tested.any():
        # All draws may be the same: then nothing says how much they would differ, and they differ by rounding alone.
        spread = np.maximum(drawn[:, tested].std(axis=0), 1e-9 * np.abs(difference[tested]))
        chance = np.abs((drawn[:, tested] - difference[tested]) / spread).max(axis=1)
        beyond = (chance[:, None] >= np.abs(difference[tested] / spread)).sum(axis=0)
        p[tested] = (1 + beyond) / (1 + len(chance))
    return p


def ranks(better: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Give the best and the worst rank that each method can have, from which (m, m) row is better than which column."""
    above, below = better.sum(axis=0), better.sum(axis=1)
    return [(1 + int(a), len(better) - int(b)) for a, b in zip(above, below, strict=True)]


@dataclass(frozen=True, eq=False)
class Ranking:
    """Methods that had the same trials, the best first by the figure that ranks.

    ranks: of each pool the best and the worst that the tests leave; None of one without the figure that ranks. by:
    that figure, one of accuracy_by and error_by, by which all pairs are compared.
    """

    pools: tuple[Pooled, ...]
    ranks: tuple[tuple[int, int] | None, ...]
    by: str
    accuracy_by: str
    error_by: str
    accuracies: Accuracies
    errors: Errors

    def p(self, i: int, j: int) -> float:
        """Give the corrected p value of the i-th against the j-th in the figure that ranks."""
        of = self.accuracies if self.by == self.accuracy_by else self.errors
        return float(of.p[i, j])


def ranked(pools: Sequence[Pooled], by: str, other: str | None = None) -> Ranking:
    """Rank pools of runs by a figure such as error_mm@20; what is the same by it stands in the order of the other one.

    by, other: one an accuracy (accuracy@N), the other an error (error_mm@N, error_all_mm@N), `other` by default
    accuracy@5 or the error over all trials at the end. Raises InputError for another figure, and for pools that do not
    have the same trials.
    """
    last = min(one.readings for one in pools)
    kinds = {"accuracy": 0, "error_mm": 1, "error_all_mm": 1}
    if by.partition("@")[0] not in kinds:
        raise InputError(f"methods are ranked by accuracy@N, error_mm@N or error_all_mm@N, not by {by}")
    of_error = kinds[by.partition("@")[0]] == 1
    other = other or (f"accuracy@{min(5, last)}" if of_error else f"error_all_mm@{last}")
    accuracy_by, error_by = (other, by) if of_error else (by, other)
    pools = sorted(pools, key=lambda one: (*(_loss(one, figure) for figure in (by, other)), one.label))
    ids = [one.ids for one in pools]
    if any(sorted(one) != sorted(ids[0]) for one in ids):
        raise InputError("only methods that had the same trials are ranked")
    orders = [np.array(sorted(range(len(one)), key=one.__getitem__)) for one in ids]

    def column(values: Sequence[NDArray]) -> NDArray:
        return np.stack([of_one[order] for of_one, order in zip(values, orders, strict=True)])

    right = [one.trials.right[:, int(accuracy_by.partition("@")[2]) - 1] for one in pools]
    name, _, at = error_by.partition("@")
    k = int(at) - 1
    apart = [one.scored.error[:, k] for one in pools]
    of = [one.trials.named[:, k] if name == "error_mm" else one.trials.known for one in pools]
    counted = [chosen & ~np.isnan(errors) for chosen, errors in zip(of, apart, strict=True)]
    accuracies = compare_accuracies(column(right))
    errors = compare_errors(
        np.nan_to_num(column(apart)), column(counted), counts_of(pools[0].scored.sizes)[:, orders[0]]
    )
    if of_error:
        better = (errors.p <= LEVEL) & (errors.difference < 0)
    else:
        better = (accuracies.p <= LEVEL) & (accuracies.wins > accuracies.wins.T)
    # Those without the figure stand last, and are neither above nor below the others.
    given = [one for one in pools if np.isfinite(_loss(one, by))]
    places = [*ranks(better[: len(given), : len(given)]), *[None] * (len(pools) - len(given))]
    return Ranking(tuple(pools), tuple(places), by, accuracy_by, error_by, accuracies, errors)


def rank_words(places: tuple[int, int] | None) -> str:
    """Write the range of ranks that a method can have, or a dash."""
    if places is None:
        return "–"
    best, worst = places
    return f"{best}" if best == worst else f"{best}–{worst}"


def _loss(one: Pooled, figure: str) -> float:
    """Give a number that is smaller for the better; infinity where the figure is undefined."""
    value = figure_of(one, figure).value
    if value is None:
        return np.inf
    return -metric_of(figure, one.run.kind.name).better * value
