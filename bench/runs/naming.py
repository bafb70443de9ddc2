"""How runs are called, the method, its budget and the task, and which of them may be compared.

A method is an estimator with its options but without its budget. Runs of one protocol and one task saw the same
readings, so that they may share a table or a picture.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from tactsim.bench.results import Run
from tactsim.bench.score import Z_95, summarise
from tactsim.bench.trials import Trials
from tactsim.press import WORLDS, ScanOptions


class Budget(NamedTuple):
    """How much an estimator may compute: the option's name, its text and its size as one number."""

    option: str
    text: str
    amount: int


@dataclass(frozen=True, eq=False)
class Entry:
    """One run in a report, or runs that differ in the seed alone, whose trials are taken together.

    folder: of the first. label: a name that no other entry of its task has.
    """

    folder: Path
    runs: tuple[Run, ...]
    method: str
    budget: Budget | None
    label: str

    @property
    def run(self) -> Run:
        """Give the first run, for what all have in common."""
        return self.runs[0]

    @property
    def seeds(self) -> str:
        """List the seeds."""
        return " ".join(str(run.seed) for run in self.runs)

    @cached_property
    def trials(self) -> Trials:
        """Give the trials of all runs, one run after the other."""
        return Trials.joined(run.trials for run in self.runs)

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Give every metric, computed from the raw trials; of several runs with intervals over scans and trials."""
        if len(self.runs) == 1:
            return self.run.summary
        from tactsim.bench.runs.pooled import intervals

        return summarise(self.trials, self.run.objects) | intervals(self.runs)

    @property
    def error_band(self) -> tuple[Sequence[float | None], Sequence[float | None]]:
        """Bound the mean error at every reading with its 95 % interval; None where there is no error."""
        s = self.summary
        if "error_low_mm" in s:  # of several scans
            return s["error_low_mm"], s["error_high_mm"]
        pairs = list(zip(s["error_mm"], s["error_standard_error_mm"], strict=True))
        low = [None if None in pair else max(pair[0] - Z_95 * pair[1], 0.0) for pair in pairs]
        return low, [None if None in pair else pair[0] + Z_95 * pair[1] for pair in pairs]

    @cached_property
    def against_bound(self) -> Mapping[str, Any]:
        """Give the bound of the error, and error over bound, by reading; see `Run.against_bound`."""
        if len(self.runs) == 1:
            return self.run.against_bound
        known = [run.bounds for run in self.runs if run.bounds is not None]
        bounds = np.concatenate(known) if len(known) == len(self.runs) else None
        return replace(self.run, trials=self.trials, bounds=bounds).against_bound

    @property
    def readings(self) -> int:
        """Count the readings of a trial."""
        return self.run.readings


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one protocol on the same readings of the same letters: they share plots.

    task: what differs from the defaults in the data, in words.
    """

    protocol: str
    task: str
    entries: tuple[Entry, ...]

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

    pool_seeds: whether runs that differ in the seed alone are one entry.
    """
    tasks: dict[tuple[str, str], list[tuple[Path, Run]]] = {}
    for folder, run in runs:
        key = run.about["protocol"], task_name(run, with_seed=not pool_seeds)
        tasks.setdefault(key, []).append((folder, run))
    order = list(dict.fromkeys(protocol for protocol, _ in tasks))
    return [
        Group(protocol, task, tuple(_entries(runs, pool_seeds)))
        for (protocol, task), runs in sorted(tasks.items(), key=lambda item: order.index(item[0][0]))
    ]


def _entries(runs: Sequence[tuple[Path, Run]], pool_seeds: bool) -> list[Entry]:
    alike: dict[Any, tuple[Path, list[Run]]] = {}
    for number, (folder, run) in enumerate(runs):
        key = method_name(run), budget(run), run.readings, run.config["trials"]
        first = alike.setdefault((key, 0 if pool_seeds else number), (folder, []))
        if run.seed in [other.seed for other in first[1]]:  # done twice: what differs nobody has said
            first = alike.setdefault((key, number + 1), (folder, []))
        first[1].append(run)
    named = [(folder, of, method_name(of[0]), budget(of[0])) for folder, of in alike.values()]
    labels = [f"{method}, {of.text} {of.option}" if of else method for _, _, method, of in named]
    counts = Counter(labels)
    entries = [
        Entry(
            folder, tuple(runs), method, of,
            label if counts[label] == 1 else f"{label} ({folder.name})",
        )
        for (folder, runs, method, of), label in zip(named, labels, strict=True)
    ]  # fmt: skip
    methods = list(dict.fromkeys(entry.method for entry in entries))
    return sorted(
        entries, key=lambda entry: (methods.index(entry.method), entry.budget.amount if entry.budget else 0)
    )


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
    words = [
        f"{option} {value}"
        for option, value in run.about["settings"].items()
        if option != stated.get("option")
    ]
    return ", ".join([run.estimator, *words])


def task_name(run: Run, *, with_seed: bool = True) -> str:
    """Say in which motion, letters, readings and seed a run differs from the defaults; "defaults" if in none.

    Runs with one protocol and one task name saw the same readings; without the seed, readings of the same kind.
    """
    config = run.config
    other = {
        name: config[name] for name in ("scan", "train_scan", "train_presses", "presses") if config.get(name)
    }
    if config.get("given"):
        other["readings"] = config["given"][:12]
    elif not (config.get("scan") or config.get("presses")):
        standard = _flat(_standard(run).model_dump(mode="json"))
        other |= _differing(_flat(run.about["scan"].get("options", {})), standard)
        if other.get("shapes"):
            other["shapes"] = _in_folder(other["shapes"])
            other = {name: value for name, value in other.items() if name != "letters" or value}
        if other.get("seed") == config["seed"]:
            del other["seed"]
    elif config.get("letters"):
        other["letters"] = config["letters"]
    words = [run.about["slip"]] if run.about.get("slip") else []
    for world, values in WORLDS.items():
        settings = _flat(values)
        if settings and settings.items() <= other.items():
            words.append(world)
            other = {name: value for name, value in other.items() if name not in settings}
    if "seed" in other:
        words.append(f"scan's seed {other.pop('seed')}")
    if config["seed"] != 0 and with_seed:
        words.append(f"seed {config['seed']}")
    return ", ".join([*words, *(f"{name} {_word(value)}" for name, value in other.items())]) or "defaults"


def _standard(run: Run) -> BaseModel:
    """Give the options of a scan by default."""
    if not run.in_space:
        return ScanOptions()
    from tactsim.press.space import SpaceOptions

    return SpaceOptions()


def _differing(mine: Mapping[str, Any], standard: Mapping[str, Any]) -> dict[str, Any]:
    """Give the options of a scan that differ from the defaults; test_poses, part of the protocol, is left out."""
    return {
        name: value for name, value in mine.items() if name != "test_poses" and value != standard.get(name)
    }


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat


def _in_folder(paths: Sequence[str]) -> str:
    """Name files, their folder once if they share it: examples/relief: cone.stl, dome.stl."""
    places = list(map(PurePosixPath, paths))
    if len({place.parent for place in places}) > 1 or len(places) == 1:
        return " ".join(paths)
    return f"{places[0].parent}: {', '.join(place.name for place in places)}"


def _word(value: Any) -> str:
    if not isinstance(value, list):
        return str(value)
    words = list(map(str, value))
    return _ranges(words) if all(len(word) == 1 for word in words) else " ".join(words)


def _ranges(letters: Sequence[str]) -> str:
    """Write letters as one types them: AEIOU, A-Z0-9."""
    parts: list[list[str]] = []
    for letter in letters:
        if parts and ord(letter) == ord(parts[-1][-1]) + 1:
            parts[-1].append(letter)
        else:
            parts.append([letter])
    return "".join(f"{part[0]}-{part[-1]}" if len(part) > 2 else "".join(part) for part in parts)
