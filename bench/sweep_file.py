"""Read the runs of a sweep from a TOML file or a suite: one run for every combination of its lists."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.runner import check_estimator, check_presses
from tactsim.bench.tasks import task
from tactsim.core import InputError
from tactsim.core.documents import parse_toml, read_toml
from tactsim.core.errors import unknown
from tactsim.estimators import create


def read(source: str) -> tuple[str, list[RunConfig]]:
    """Read a sweep from a TOML file or a suite's name: its name and its runs, in order.

    The file has `[[run]]` tables, and `[defaults]` for what they leave out. Their keys are the long options of
    `bench run` with underscores (`set` and `scan_set` are tables). A list stands for one run per entry, and
    several lists for every combination. Where a task is named and no seed, there is a run for each of its seeds.

    Raises InputError if the file cannot be read, a key is unknown or a value is wrong.
    """
    path = Path(source)
    if not path.exists() and source in suites():
        table, name = _suite(source), source
    elif path.suffix or path.exists():
        table, name = read_toml(path, "sweep"), path.stem
    else:
        raise unknown("suite or sweep file", source, suites())
    return name, expand(table, f"sweep {source}")


def count_runs(suite: str) -> int:
    """Count the runs of a suite that comes with the project, without making their configurations."""
    return sum(len(_seeds(words)) for _, words in _combinations(_suite(suite), f"suite {suite}"))


def _suite(name: str) -> dict[str, Any]:
    return parse_toml((files("tactsim.bench") / "suites" / f"{name}.toml").read_bytes(), f"suite {name}")


def suites() -> tuple[str, ...]:
    """List the named suites that come with the project."""
    return tuple(
        sorted(
            entry.name.removesuffix(".toml")
            for entry in (files("tactsim.bench") / "suites").iterdir()
            if entry.name.endswith(".toml")
        )
    )


def expand(table: Mapping[str, Any], what: str) -> list[RunConfig]:
    """Turn a sweep's tables into its runs: every combination of every list, without repeats.

    Raises InputError for an unknown key, a wrong value, no runs or more than 100,000, and, with the number of the
    [[run]], for what `runner` refuses before the work.
    """
    configs: dict[str, RunConfig] = {}
    sources: set[tuple[str, int]] = set()
    for where, words in _combinations(table, what):
        try:
            for seed in _seeds(words):
                config = run_config(**words, **seed)
                check_estimator(config, create(config.estimator, **config.options))
                if (asked := (config.source, config.readings)) not in sources:
                    check_presses(config)
                    sources.add(asked)
                configs.setdefault(config.digest, config)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
    return list(configs.values())


def _combinations(table: Mapping[str, Any], what: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Give where each combination of every list stands, and its words.

    Raises InputError as `expand` does, but for wrong values.
    """
    strange = set(table) - {"run", "defaults"}
    if strange:
        raise unknown(f"table in {what}", strange.pop(), ("run", "defaults"))
    defaults, runs = table.get("defaults", {}), table.get("run", [])
    if not (isinstance(defaults, dict) and isinstance(runs, list) and all(isinstance(r, dict) for r in runs)):
        raise InputError(f"{what}: write [defaults] once and [[run]] for each group of runs")
    if not runs:
        raise InputError(f"{what} has no [[run]]; write one for each group of runs")
    total = 0
    for number, run in enumerate(runs, start=1):
        where = f"{what}, [[run]] {number}"
        axes = list(_axes({**defaults, **run}))
        empty = [".".join(key) for key, values in axes if not values]
        if empty:
            raise InputError(f"{where}: the list {empty[0]} is empty; give it a value or leave it out")
        count = int(np.prod([len(values) for _, values in axes], dtype=object)) if axes else 1
        if count + total > 100_000:
            raise InputError(f"{where} asks for {count:,} runs; the most is 100,000")
        total += count
        for values in itertools.product(*(values for _, values in axes)):
            words: dict[str, Any] = {}
            for (key, _), value in zip(axes, values, strict=True):
                inner = words
                for group in key[:-1]:
                    inner = inner.setdefault(group, {})
                inner[key[-1]] = value
            yield where, words


def _seeds(words: Mapping[str, Any]) -> list[dict[str, int]]:
    """Give what is to be added to a combination: each seed of the task that is named without one, or else nothing."""
    if words.get("task") is None or "seed" in words:
        return [{}]
    return [{"seed": seed} for seed in task(str(words["task"])).seeds]


def _axes(
    table: Mapping[str, Any], prefix: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], list[Any]]]:
    """Walk a table: every key, dotted ones as tuples, with the list of values that it takes."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _axes(value, (*prefix, key))
        else:
            yield (*prefix, key), value if isinstance(value, list) else [value]
