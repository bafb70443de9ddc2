"""How methods are called, and pools of those that differ in the seed alone, whose figures have intervals.

Runs of one protocol and one task saw the same readings, so that they may share a table or a picture: a `Group`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from tactsim.bench.intervals import Figure
from tactsim.bench.kinds import PLANE
from tactsim.bench.results import Run, task_name
from tactsim.bench.score import Metric, Scored, figures, summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.errors import counted, short, unknown

# What figures were called in tables before.
_BEFORE = {
    "right": "accuracy", "error": "error_mm", "error_all": "error_all_mm", "sharpness": "sharpness_mm",
    "bound": "bound_mm", "error_over_bound": "efficiency",
}  # fmt: skip


class Budget(NamedTuple):
    """How much an estimator may compute: the option's name, its text and its size as one number."""

    option: str
    text: str
    amount: int


def budget(run: Run) -> Budget | None:
    """Say how much the estimator of a run was allowed to compute; None if it has no such option."""
    stated = run.about["budget"]
    if stated is None:
        return None
    option, value = stated["option"], str(stated["value"])
    # At most three numbers of nine digits each, so that a file cannot make their product enormous.
    counts = [int(digits) for digits in re.findall(r"\d{1,9}", value)[:3]]
    return Budget(option, f"{counts[0]:,}" if len(counts) == 1 else value, math.prod(counts))


def method_name(run: Run) -> str:
    """Name the estimator with those of its options that are no budget and no default."""
    stated = run.about["budget"] or {}
    settings = {name: value for name, value in run.about["settings"].items() if name != stated.get("option")}
    return ", ".join([run.estimator, *(f"{name} {value}" for name, value in settings.items())])


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
    def scored(self) -> Scored:
        """Put the trials of all runs one after the other, for figures."""
        return Scored.joined([run.scored for run in self.runs])

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Give every metric, computed from the raw trials; of several runs with intervals over scans and trials."""
        if len(self.runs) == 1:
            return self.run.summary
        low, high = self.band("accuracy")
        return summarise(self.scored) | {"accuracy_low": low, "accuracy_high": high}

    def band(self, name: str) -> tuple[list[float | None], list[float | None]]:
        """Bound a figure at every reading with its 95 % interval; None where there is none."""
        found = [figure_of(self, f"{name}@{reading}") for reading in range(1, self.readings + 1)]
        return [figure.low for figure in found], [figure.high for figure in found]

    @cached_property
    def error_band(self) -> tuple[Sequence[float | None], Sequence[float | None]]:
        """Bound the mean error at every reading with its 95 % interval; None where there is no error."""
        return self.band("error_mm")

    @cached_property
    def against_bound(self) -> Mapping[str, Any]:
        """Give the bound of the error, and error over bound, by reading; see `Run.against_bound`."""
        if len(self.runs) == 1:
            return self.run.against_bound
        return replace(self.run, trials=self.trials, bounds=self.scored.bounds).against_bound

    @property
    def trials(self) -> Trials:
        """Give the trials of all runs, one run after the other."""
        return self.scored.trials

    @property
    def ids(self) -> list[tuple[int, str, int]]:
        """Name each of `trials`: seed, letter, number within the letter; pools of the same are compared by them."""
        return [(run.seed, *of_trial) for run in self.runs for of_trial in run.trials.ids]


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
    def thing(self) -> str:
        """Say what is recognised, see `Run.thing`."""
        found = {entry.run.thing for entry in self.entries}
        return found.pop() if len(found) == 1 else "object"

    @property
    def places(self) -> bool:
        """Tell whether any run says where its objects lie, rightly named."""
        return any(error is not None for entry in self.entries for error in entry.summary["error_mm"])

    @property
    def readings(self) -> int:
        """Count the readings that every run has."""
        return min(entry.readings for entry in self.entries)


def collect(runs: Iterable[tuple[Path, Run]]) -> list[Group]:
    """Group runs, each with the folder that it is known by, by protocol and task, in order of appearance.

    Runs that differ in the seed alone are one entry. A method's entries go by their budget, and those that would be
    called alike are told apart by their folders.
    """
    groups: dict[tuple[str, str], list[Pooled]] = {}
    for one in _pooled(runs):
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
    pools = _pooled((None, run) for run in runs)
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


def _pooled(runs: Iterable[tuple[Path | None, Run]]) -> list[Pooled]:
    """Put runs together that differ in the seed alone; one that is there twice stays by itself."""
    found: dict[tuple[Any, ...], tuple[Path | None, list[Run]]] = {}
    for number, (folder, run) in enumerate(runs):
        what = method_name(run), budget(run), run.protocol, task_name(run, with_seed=False)
        key: tuple[Any, ...] = (*what, run.readings, run.config["trials"])
        if key in found and run.seed in [other.seed for other in found[key][1]]:
            key = (*key, number)
        found.setdefault(key, (folder, []))[1].append(run)
    return [
        Pooled(method, of, protocol, task, tuple(alike), folder)
        for (method, of, protocol, task, *_), (folder, alike) in found.items()
    ]


def cell(one: Pooled, figure: str) -> str:
    """Write one figure of a pool, such as accuracy@5, with its interval; accuracy@5,10 for two readings, without.

    Raises InputError for an unknown figure or a reading that the runs do not have.
    """
    name, _, at = figure.partition("@")
    if "," in at:
        return " / ".join(cell(one, f"{name}@{reading}").partition(" (")[0] for reading in at.split(","))
    found, digits = figure_of(one, figure), metric_of(name, one.run.kind.name).digits
    if digits == 0:
        value, low, high = (str(part or "later") for part in (found.value, found.low, found.high))
        return value if low == high == value else f"{value} ({low}-{high})"
    if found.value is None:
        return "-"
    if digits is None:
        return f"{found.value:,.0f}" if found.value >= 1000 else f"{found.value:.3g}"
    value, *ends = in_digits(found, digits)
    if not ends and found.value > 0 and float(value) == 0:
        return f"<{10**-digits:.{digits}f}"
    return f"{value} ({'-'.join(ends)})" if ends else value


def in_digits(found: Figure, least: int) -> list[str]:
    """Write a known figure and, if it has one, its interval, with so many decimals that the interval's ends differ.

    least: how many at least. There are at most six: closer ends count as one, and need no more than the least. What is
    rounded to 0 has no sign.
    """
    numbers = [number for number in (found.value, found.low, found.high) if number is not None]
    rounded = [[f"{number:z.{digits}f}" for number in numbers] for digits in range(least, 7)]
    return next((texts for texts in rounded if len(set(texts[1:])) > 1), rounded[0])


def metric_of(figure: str, kind: str = PLANE) -> Metric:
    """Find what a figure such as accuracy@5 is, of runs of a kind. Raises InputError if there is none of that name."""
    name = figure.partition("@")[0]
    known = {of: metric for of, metric in figures(kind).items() if not metric.table}
    if name in known:
        return known[name]
    if name in _BEFORE:
        raise InputError(f"the figure {name} is now called {_BEFORE[name]}")
    raise unknown("figure", name, list(known))


def figure_of(one: Pooled, figure: str) -> Figure:
    """Work out one figure of a pool, such as accuracy@5. Raises InputError as `cell` does."""
    name, _, at = figure.partition("@")
    metric = metric_of(name, one.run.kind.name)
    if metric.of_readings and not (at.isdigit() and 1 <= int(at) <= one.readings):
        last = one.readings
        raise InputError(f"the figure {short(figure)} asks for none of {last} readings; write {name}@{last}")
    if at and not metric.of_readings:
        raise InputError(f"the figure {name} is of whole trials; leave away @{short(at)}")
    k = int(at) - 1 if at else 0
    if metric.pooled is not None:
        return metric.pooled(one.scored, k)
    found = metric.compute(one.scored)
    return Figure(found[k] if metric.of_readings else found, None, None)
