"""Pool runs that differ in the seed alone, and bound their figures by a bootstrap over scans and trials.

Runs of one protocol and one task saw the same readings, so that they may share a table or a picture: a `Group`.

A run has a scan of its own, and all its trials share the maps learned from it. So its trials are not independent,
and an interval from the trials of one run says nothing of the next scan. The bootstrap has two levels (Davison and
Hinkley 1997, section 3.8): it draws as many runs as there are, with replacement, and from each of them as many trials
as it has. Intervals are percentiles. Where trials differ more than scans they are somewhat too wide. Where scans differ
more, and there are only five, they hold the truth in 85 to 90 % of cases instead of 95 %: a reason to run more seeds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.bench.results import Run
from tactsim.bench.runs.naming import Budget, budget, method_name, task_name
from tactsim.bench.score import (
    Scored,
    errors,
    recognition_seconds,
    recoveries,
    settled_at,
    settled_by,
    summarise,
    wilson,
)
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.errors import counted, unknown
from tactsim.core.poses import FloatArray

DRAWS = 2000
LEVEL = 0.95
# All draws of a single trial are that trial, which would be an interval without a width.
_FEWEST = 2


@dataclass(frozen=True)
class Figure:
    """A figure with its 95 % interval; None where there is none, or, of a reading, where it is later."""

    value: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, eq=False)
class Pooled:
    """The runs of one method and budget, protocol and task, one for each seed; in a report perhaps a single one.

    folder: of the first, where it is known. mark: what tells it from others that would be called alike; or "".
    """

    method: str
    budget: Budget | None
    protocol: str
    task: str
    runs: tuple[Run, ...]
    folder: Path | None = None
    mark: str = ""

    @property
    def label(self) -> str:
        """Name the method with its budget."""
        name = f"{self.method}, {self.budget.text} {self.budget.option}" if self.budget else self.method
        return f"{name} ({self.mark})" if self.mark else name

    @property
    def run(self) -> Run:
        """Give the first run, for what all have in common."""
        return self.runs[0]

    @property
    def seeds(self) -> str:
        """List the seeds."""
        return " ".join(str(run.seed) for run in self.runs)

    @property
    def readings(self) -> int:
        """Count the readings of a trial."""
        return self.run.readings

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Give every metric, computed from the raw trials; of several runs with intervals over scans and trials."""
        if len(self.runs) == 1:
            return self.run.summary
        found = [_right(self, k) for k in range(self.readings)]
        over_scans = {"accuracy_low": [of.low for of in found], "accuracy_high": [of.high for of in found]}
        return summarise(self.trials, self.run.objects) | over_scans

    @cached_property
    def error_band(self) -> tuple[Sequence[float | None], Sequence[float | None]]:
        """Bound the mean error at every reading with its 95 % interval; None where there is no error."""
        found = [_error(self, k) for k in range(self.readings)]
        return [figure.low for figure in found], [figure.high for figure in found]

    @cached_property
    def against_bound(self) -> Mapping[str, Any]:
        """Give the bound of the error, and error over bound, by reading; see `Run.against_bound`."""
        if len(self.runs) == 1:
            return self.run.against_bound
        return replace(self.run, trials=self.trials, bounds=self.bounds).against_bound

    @cached_property
    def trials(self) -> Trials:
        """Give the trials of all runs, one run after the other."""
        return Trials.joined(run.trials for run in self.runs)

    @cached_property
    def errors(self) -> FloatArray:
        """Give the placement errors (n, r), mm, of all trials."""
        return np.concatenate([errors(run.trials, run.objects) for run in self.runs])

    @cached_property
    def bounds(self) -> FloatArray | None:
        """Give the Cramer-Rao bounds (n, r), mm, of all trials; None if one run has none."""
        known = [run.bounds for run in self.runs if run.bounds is not None]
        return np.concatenate(known) if len(known) == len(self.runs) else None

    @property
    def counts(self) -> FloatArray:
        """Give how often each bootstrap draw has each trial, (draws, n)."""
        return _counts_of(self._sizes)

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(len(run.trials.truth) for run in self.runs)

    def mean(self, values: ArrayLike, of: ArrayLike | None = None) -> Figure:
        """Average values (n,) of the trials, of those only that `of` (n,) marks; None if one is NaN: not known."""
        return mean(values, self._sizes, of)

    def share(self, holds: ArrayLike, of: ArrayLike | None = None) -> Figure:
        """Give the share of the trials in which something `holds` (n,), of those only that `of` (n,) marks."""
        return share(holds, self._sizes, of)

    def ratio(self, above: ArrayLike, below: ArrayLike) -> Figure:
        """Divide the sum of `above` (n,) over the trials by that of `below` (n,)."""
        above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
        if not below.any():
            return Figure(None, None, None)
        found = float(above.sum() / below.sum())
        if np.count_nonzero(below) < _FEWEST:
            return Figure(found, None, None)
        drawn, divisor = self.counts @ above, self.counts @ below
        low, high = np.quantile(drawn[divisor > 0] / divisor[divisor > 0], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return Figure(found, float(low), float(high))

    def settled(self, share: float) -> Figure:
        """Find the reading by which `share` of the trials are and stay right."""
        right = self.trials.right
        at, readings = settled_at(right), right.shape[1]
        # (draws, readings) trials settled by then
        settled = self.counts @ (at[:, None] <= np.arange(1, readings + 1))
        enough = settled >= share * self.counts.sum(axis=1, keepdims=True) - 1e-9
        drawn = np.where(enough.any(axis=1), enough.argmax(axis=1) + 1, readings + 1)
        low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], method="inverted_cdf")
        return Figure(settled_by(right, share), *(int(at) if at <= readings else None for at in (low, high)))

    def all_right_from(self) -> Figure:
        """Find the reading from which every trial is and stays right; least and most are those of a single run."""
        each = [settled_by(run.trials.right, 1.0) for run in self.runs]
        known = [reading for reading in each if reading is not None]
        return Figure(
            settled_by(self.trials.right, 1.0),
            min(known) if known else None,
            max(known) if len(known) == len(each) else None,
        )


def mean(values: ArrayLike, sizes: tuple[int, ...], of: ArrayLike | None = None) -> Figure:
    """Average values (n,) of the trials of runs of these sizes, one run after the other; see `Pooled.mean`.

    One trial alone has no interval.
    """
    values = np.asarray(values, dtype=float)
    marked = np.ones(len(values)) if of is None else np.asarray(of, dtype=float)
    if not marked.any() or np.isnan(values[marked > 0]).any():
        return Figure(None, None, None)
    counted = np.where(marked > 0, values, 0.0)  # of the others nothing need be known
    found = float(counted.sum() / marked.sum())
    if np.count_nonzero(marked) < _FEWEST:
        return Figure(found, None, None)
    counts = _counts_of(sizes)
    number = counts @ marked
    drawn = (counts @ counted)[number > 0] / number[number > 0]
    low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Figure(found, float(low), float(high))


def share(holds: ArrayLike, sizes: tuple[int, ...], of: ArrayLike | None = None) -> Figure:
    """Give the share as `mean` does; its interval is never narrower than Wilson's, which is that of a single run.

    Where something holds in all trials, it does in all draws of the bootstrap, which says nothing of the next trial.
    """
    found = mean(holds, sizes, of)
    if found.value is None:
        return found
    number = int(np.size(holds) if of is None else np.count_nonzero(of))
    low, high = map(float, wilson(found.value * number, number))
    if len(sizes) > 1 and found.low is not None and found.high is not None:
        low, high = min(low, found.low), max(high, found.high)
    return Figure(found.value, low, high)


def resampled(sizes: Sequence[int], rng: np.random.Generator, draws: int = DRAWS) -> FloatArray:
    """Draw runs of these sizes with replacement, and trials of each; gives the trials' counts (draws, n)."""
    runs = rng.multinomial(len(sizes), np.full(len(sizes), 1 / len(sizes)), size=draws)  # (draws, runs)
    # k copies of a run are k times as many of its trials.
    return np.hstack(
        [
            rng.multinomial(times * size, np.full(size, 1 / size))
            for times, size in zip(runs.T, sizes, strict=True)
        ]
    ).astype(float)


@lru_cache(maxsize=4)
def _counts_of(sizes: tuple[int, ...]) -> FloatArray:
    """Draw for runs of these sizes, the same for all methods, as they are drawn from one seed."""
    counts = resampled(sizes, np.random.default_rng(0))
    counts.setflags(write=False)
    return counts


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one protocol on the same readings of the same letters: they share plots.

    task: what differs from the defaults in the data, in words.
    """

    protocol: str
    task: str
    entries: tuple[Pooled, ...]

    @property
    def methods(self) -> tuple[str, ...]:
        """List the methods, in order of appearance."""
        return tuple(dict.fromkeys(entry.method for entry in self.entries))

    @property
    def readings(self) -> int:
        """Count the readings that every run has."""
        return min(entry.readings for entry in self.entries)


def collect(runs: Iterable[tuple[Path, Run]], *, pool_seeds: bool = False) -> list[Group]:
    """Group runs, each with the folder that it is known by, by protocol and task, in order of appearance.

    pool_seeds: whether runs that differ in the seed alone are one entry. A method's entries go by their budget, and
    those that would be called alike are told apart by their folders.
    """
    groups: dict[tuple[str, str], list[Pooled]] = {}
    for one in _pooled(runs, pool_seeds):
        groups.setdefault((one.protocol, one.task), []).append(one)
    order = list(dict.fromkeys(protocol for protocol, _ in groups))
    collected = []
    for (protocol, task), pools in sorted(groups.items(), key=lambda item: order.index(item[0][0])):
        counts = Counter(one.label for one in pools)
        methods = list(dict.fromkeys(one.method for one in pools))
        pools.sort(key=lambda one: (methods.index(one.method), one.budget.amount if one.budget else 0))
        named = (
            replace(one, mark=one.folder.name) if one.folder and counts[one.label] > 1 else one
            for one in pools
        )
        collected.append(Group(protocol, task, tuple(named)))
    return collected


def pool(runs: Iterable[Run]) -> list[Pooled]:
    """Put runs together that differ in the seed alone, those of one protocol and task side by side.

    Raises InputError if a run is there twice.
    """
    pools = _pooled(((None, run) for run in runs), True)
    seen = set()
    for one in pools:
        key = one.protocol, one.task, one.label, one.readings, one.run.config["trials"]
        if key in seen:
            raise InputError(
                f"{one.method} is there twice with the same seed, and only seeds that differ are pooled"
            )
        seen.add(key)
    kinds = list(dict.fromkeys((one.protocol, one.task) for one in pools))
    pools.sort(key=lambda one: kinds.index((one.protocol, one.task)))
    return [_told_apart(one, pools) for one in pools]


def _told_apart(one: Pooled, pools: Sequence[Pooled]) -> Pooled:
    """Mark a pool by its readings or trials if others of its protocol and task are called alike and have others."""
    alike = [of for of in pools if (of.protocol, of.task, of.label) == (one.protocol, one.task, one.label)]
    mark = []
    if len({of.readings for of in alike}) > 1:
        mark.append(counted(one.readings, one.run.kind.touch))
    if len({of.run.config["trials"] for of in alike}) > 1:
        mark.append(
            counted(len(one.run.trials.truth), "trial")
            if one.run.config["trials"] == "all"
            else counted(one.run.config["trials"], "trial")
        )
    return replace(one, mark=", ".join(mark))


def _pooled(runs: Iterable[tuple[Path | None, Run]], pool_seeds: bool) -> list[Pooled]:
    """Put runs together that differ in the seed alone, if `pool_seeds`; one that is there twice stays by itself."""
    found: dict[tuple[Any, ...], tuple[Path | None, list[Run]]] = {}
    for number, (folder, run) in enumerate(runs):
        task = task_name(run, with_seed=not pool_seeds)
        what = method_name(run), budget(run), run.protocol, task
        key: tuple[Any, ...] = (*what, run.readings, run.config["trials"], 0 if pool_seeds else number)
        if key in found and run.seed in [other.seed for other in found[key][1]]:
            key = (*key, number)
        found.setdefault(key, (folder, []))[1].append(run)
    return [
        Pooled(method, of, protocol, task, tuple(alike), folder)
        for (method, of, protocol, task, *_), (folder, alike) in found.items()
    ]


def cell(one: Pooled, figure: str) -> str:
    """Write one figure of a pool, such as right@5, with its interval; right@5,10 for two readings, without.

    Raises InputError for an unknown figure or a reading that the runs do not have.
    """
    name, at = parts_of(figure)
    if "," in at:
        return " / ".join(cell(one, f"{name}@{reading}").partition(" (")[0] for reading in at.split(","))
    found = figure_of(one, figure)
    if name == "ms":
        return f"{found.value:.3g}"
    if name in READINGS:
        value, low, high = (str(part or "later") for part in (found.value, found.low, found.high))
        return value if low == high == value else f"{value} ({low}-{high})"
    if found.value is None:
        return "-"
    value, *ends = in_digits(found, 2 if name in ("error", "error_all", "efficiency", "sharpness") else 3)
    return f"{value} ({'-'.join(ends)})" if ends else value


def in_digits(found: Figure, least: int) -> list[str]:
    """Write a known figure and, if it has one, its interval, with so many decimals that the interval's ends differ.

    least: how many at least. There are at most six: closer ends count as one, and need no more than the least. What is
    rounded to 0 has no sign.
    """
    numbers = [number for number in (found.value, found.low, found.high) if number is not None]
    rounded = [[f"{number:z.{digits}f}" for number in numbers] for digits in range(least, 7)]
    return next((texts for texts in rounded if len(set(texts[1:])) > 1), rounded[0])


def parts_of(figure: str) -> tuple[str, str]:
    """Split a figure, such as right@5 or accuracy@5, into its name in a table and its reading, "" if there is none."""
    name, _, at = figure.partition("@")
    return _METRICS.get(name, name), at


def figure_of(one: Pooled, figure: str) -> Figure:
    """Work out one figure of a pool, such as right@5. Raises InputError as `cell` does."""
    name, at = parts_of(figure)
    if name in READINGS and not at:
        return READINGS[name](one)
    if name == "recovered_within_3" and not at:
        return _recovered(one)
    if name == "ms" and not at:
        return Figure(1e3 * recognition_seconds(one.trials, one.readings), None, None)
    if name in CURVES and at.isdigit():
        reading, readings = int(at), one.readings
        if not 1 <= reading <= readings:
            raise InputError(f"the figure {figure} asks for reading {reading} of {readings}")
        return CURVES[name](one, reading - 1)
    raise unknown(
        "figure", figure, (*READINGS, "recovered_within_3", "ms", *(f"{curve}@5" for curve in CURVES))
    )


def _right(one: Pooled, k: int) -> Figure:
    return one.share(one.trials.right[:, k])


def _error(one: Pooled, k: int) -> Figure:
    return one.mean(one.errors[:, k], of=one.trials.named[:, k])


def _recovered(one: Pooled) -> Figure:
    of_runs = [recoveries(Scored(run.trials, run.objects), 3) for run in one.runs]
    jumps, found = (np.concatenate(column) for column in zip(*of_runs, strict=True))
    return one.ratio(found, jumps)


def _bound(one: Pooled, k: int) -> Figure:
    from tactsim.bench.bound.efficiency import stated  # most runs do without that room

    if one.bounds is None:
        return Figure(None, None, None)
    return one.mean(one.bounds[:, k], of=stated(one.bounds[:, k], one.trials))


def _efficiency(one: Pooled, k: int) -> Figure:
    from tactsim.bench.bound.efficiency import stated

    if one.bounds is None:
        return Figure(None, None, None)
    chosen = stated(one.bounds[:, k], one.trials) & one.trials.named[:, k]
    return one.ratio(np.where(chosen, one.errors[:, k], 0), np.where(chosen, one.bounds[:, k], 0))


def _coverage(one: Pooled, k: int, level: float) -> Figure:
    return one.share(one.trials.credibility[:, k] < level, of=one.trials.sure[:, k])


def _sharpness(one: Pooled, k: int) -> Figure:
    sure = one.trials.sure[:, k]
    return one.mean(np.where(sure, one.trials.radius_90[:, k], 0), of=sure)


# The figures that a table may ask for, of a pool of runs: after reading k + 1, and readings by which something holds.
CURVES: dict[str, Callable[[Pooled, int], Figure]] = {
    "right": _right,
    "error": _error,
    "error_all": lambda one, k: one.mean(one.errors[:, k], of=one.trials.known),
    "bound": _bound,
    "efficiency": _efficiency,
    "coverage_50": lambda one, k: _coverage(one, k, 0.5),
    "coverage_90": lambda one, k: _coverage(one, k, 0.9),
    "sharpness": _sharpness,
    "calibration_gap": lambda one, k: one.mean(one.trials.p_label[:, k] - one.trials.right[:, k]),
    "refused_unknown": lambda one, k: one.share(one.trials.right[:, k], of=~one.trials.known),
    "refused_known": lambda one, k: one.share(one.trials.label[:, k] == "none", of=one.trials.known),
}
READINGS: dict[str, Callable[[Pooled], Figure]] = {
    "settled_95": lambda one: one.settled(0.95),
    "settled_50": lambda one: one.settled(0.5),
    "all_right_from": Pooled.all_right_from,
}
# What a run's metrics are called here.
_METRICS = {
    "accuracy": "right", "error_mm": "error", "error_all_mm": "error_all", "bound_mm": "bound",
    "error_over_bound": "efficiency",
}  # fmt: skip
HEADINGS = {
    "right": "right after {}",
    "error": "error after {}, mm",
    "error_all": "error over all trials after {}, mm",
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
