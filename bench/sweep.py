"""A sweep: read its runs from a file, do them, and keep what is done, whenever and however it is stopped.

A sweep's file has a run for every combination of its lists. Its folder holds `sweep.json` (the list of runs asked
for) and `runs/` (whole runs, as `bench run` writes them). Only this process writes there. Workers, local or on a Dask
cluster, receive trials and send back their results. A sweep that was stopped does again the runs that were at work.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import AbstractContextManager, contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.bench import kinds, results
from tactsim.bench.config import any_config
from tactsim.bench.experiment import Config, Gathered, estimator_of, finished_run, gather
from tactsim.bench.kinds import OF_THE_METHOD
from tactsim.bench.results import Run
from tactsim.bench.runs.saved import load, sweep_order
from tactsim.bench.sent_trials import Done, received_trials, send_trials
from tactsim.bench.tasks import task
from tactsim.bench.trials import (
    OneTrial,
    Progress,
    TrialPlan,
    silent,
    source_of_trials,
)
from tactsim.core import InputError
from tactsim.core.documents import parse_toml, read_toml
from tactsim.core.errors import unknown
from tactsim.core.files import lock, new_folder, write_text
from tactsim.core.workers import worker_processes
from tactsim.estimators import create
from tactsim.estimators.estimator import budget_of


def read(source: str, also: Sequence[str] = ()) -> tuple[str, list[Config]]:
    """Read a sweep from a TOML file or a suite's name: its name and its runs, in order.

    also: estimators that are asked the same with their defaults, beside those of the sweep.

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
    for one in also:
        create(one)  # a name that is unknown is no fault of the file
    return name, expand(table, f"sweep {source}", also)


def count_runs(suite: str) -> int:
    """Count the runs of a suite that comes with the project, without making their configurations."""
    return sum(len(_seeds(words)) for _, words in _combinations(_suite(suite), f"suite {suite}"))


def _suite(name: str) -> dict[str, Any]:
    return parse_toml((files("tactsim.bench") / "suites" / f"{name}.toml").read_bytes(), f"suite {name}")


def suites() -> dict[str, str]:
    """List the named suites that come with the project, with the first line of each file: what it asks."""
    found = (entry for entry in (files("tactsim.bench") / "suites").iterdir() if entry.name.endswith(".toml"))
    first = {entry.name[:-5]: entry.read_text("utf-8").partition("\n")[0].lstrip("# ") for entry in found}
    return dict(sorted(first.items()))


def expand(table: Mapping[str, Any], what: str, also: Sequence[str] = ()) -> list[Config]:
    """Turn a sweep's tables into its runs: every combination of every list, without repeats.

    Raises InputError for an unknown key, a wrong value, no runs or more than 100,000, and, with the number of the
    [[run]], for what `experiment` refuses before the work.
    """
    configs: dict[str, Config] = {}
    sources: set[tuple[str, int]] = set()
    for where, of_file in _combinations(table, what):
        of_data = {name: value for name, value in of_file.items() if name not in OF_THE_METHOD}
        try:
            methods = [of_file, *(of_data | {"estimator": one} for one in also)]
            for words, seed in itertools.product(methods, _seeds(of_file)):
                config = any_config(**words, **seed)
                estimator_of(config)  # refuses a wrong option
                if (asked := (config.source, config.readings)) not in sources:
                    kinds.load(config.kind).check(config)
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
    if words.get("task") in (None, *kinds.names()) or "seed" in words:
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


_SCHEMA = 3  # of sweep.json
SCHEDULER_ANSWERS_IN = 10.0  # s, or it counts as none
ATTEMPTS = 3  # how often trials are tried when workers die

# Gives an executor, and how many tasks it does at once.
Pool = Callable[[], AbstractContextManager[tuple[Executor, int]]]


def perform(
    configs: Sequence[Config],
    folder: Path,
    *,
    jobs: int,
    pool: Pool | None = None,
    cache: bool = True,
    progress: Progress,
) -> list[Path]:
    """Do every run that `folder` does not hold yet; returns the folders of all runs, in order.

    jobs: local processes, if no other `pool` is given. Readings that several runs share are pressed once.

    Raises InputError if the folder belongs to another sweep, is in use or cannot be written, or if it holds
    runs made by other source code while others are still to do.
    """
    names = _names(configs)  # a wrong option is reported before the work
    with _locked(folder):
        # What a killed sweep left.
        for path in (*folder.glob(".sweep.json.*.part"), *folder.glob("runs/.*.part")):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        _claim(folder, names, configs)
        places = {name: folder / "runs" / name for name in names}
        whole = {name: load(place) for name, place in places.items() if (place / "run.json").exists()}
        todo = {name: config for name, config in zip(names, configs, strict=True) if name not in whole}
        if todo:
            _check_sources(folder, whole)
        gathered = _gather_all(todo, jobs=jobs, cache=cache, progress=progress)
        plans, tasks = dict[str, TrialPlan](), dict[str, Sequence[OneTrial]]()
        for name, config in todo.items():
            kind, of = kinds.load(config.kind), gathered[name]
            plans[name] = kind.plan(config, of.scan, None, of.objects)
            tasks[name] = kind.tasks(config, of)
        kept = sum(len(run.trials.truth) for run in whole.values())
        total = kept + sum(map(len, tasks.values()))

        def report(now: int) -> None:
            progress("sweep", kept + now, total)

        for name, done in _trials_of_runs(plans, tasks, pool or _local(jobs), report):
            config = todo[name]
            estimator = create(config.estimator, **config.options)
            run = finished_run(config, gathered[name], *done, estimator)
            with new_folder(places[name]) as inside:
                results.save(run, inside)
    return list(places.values())


def _local(jobs: int) -> Pool:
    @contextmanager
    def enter() -> Iterator[tuple[Executor, int]]:
        with worker_processes(jobs) as executor:
            yield executor, jobs

    return enter


def dask_pool(address: str) -> Pool:
    """Make a pool of the workers of a Dask cluster at tcp://HOST:PORT.

    If a worker dies, its trials are sent to another. Raises InputError for what is no such address, if dask is not
    installed, and if no scheduler answers.
    """
    if re.fullmatch(r"(\w+://)?[^/]+:\d+", address) is None:
        raise InputError(f"--dask {address}: give the scheduler's address, such as tcp://localhost:8786")

    @contextmanager
    def enter() -> Iterator[tuple[Executor, int]]:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--dask needs the package distributed: pip install 'tactsim[dask]'") from None
        try:
            client = Client(address, timeout=SCHEDULER_ANSWERS_IN, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--dask {address}: no scheduler answers there ({error})") from error
        with client, client.get_executor(pure=False, retries=ATTEMPTS) as executor:
            try:
                yield executor, max(1, sum(client.nthreads().values()))
            except BaseException:
                executor.shutdown(wait=False)  # cancels what is not done
                raise

    with enter():  # or it would be refused only when everything is pressed
        return enter


def _trials_of_runs(
    plans: Mapping[str, TrialPlan],
    tasks: Mapping[str, Sequence[OneTrial]],
    pool: Pool,
    report: Callable[[int], None],
) -> Iterator[tuple[str, Done]]:
    """Let workers do the trials of runs, by their names; yield what they did of a run once all is there.

    Runs that were at work when a worker died are sent again. report(done) is called with how many trials are done.
    """
    left = dict(tasks)
    total = sum(map(len, tasks.values()))
    report(0)
    for attempt in range(1, ATTEMPTS + 1):
        if not left:
            return
        try:
            with pool() as (executor, workers):
                # So few parts of a run that few workers fit its estimator, and so many that none waits for long.
                parts = -(-2 * workers // len(left))
                sent = {name: send_trials(executor, plans[name], left[name], parts) for name in left}
                run_of = {future: (name, size) for name, of_run in sent.items() for size, future in of_run}
                done = total - sum(map(len, left.values()))
                for future in as_completed(run_of):
                    future.result()
                    name, size = run_of.pop(future)
                    done += size
                    report(done)
                    if name in sent and all(part.done() for _, part in sent[name]):
                        yield name, received_trials(sent.pop(name), silent)
                        del left[name]
        except BrokenExecutor:
            if attempt == ATTEMPTS:
                raise


def _gather_all(
    configs: Mapping[str, Config], *, jobs: int, cache: bool, progress: Progress
) -> dict[str, Gathered]:
    """Press or load the readings of every run, each set of readings once."""
    found, by_source = dict[str, Gathered](), dict[str, Gathered]()
    for name, config in configs.items():
        if (source := config.source) not in by_source:
            by_source[source] = gather(config, jobs=jobs, cache=cache, progress=progress)
        found[name] = by_source[source]
        kinds.load(config.kind).check_gathered(config, found[name])
    return found


def _check_sources(folder: Path, whole: Mapping[str, Run]) -> None:
    """Raise InputError if a whole run was made by other source code than the rest would be."""
    for name, run in whole.items():
        if run.about["source"] != source_of_trials(run.estimator):
            raise InputError(
                f"{folder / 'runs' / name} was made by other source code than this; remove such runs, which are "
                "then done again, or name another folder with --out"
            )


def _names(configs: Sequence[Config]) -> list[str]:
    """Name each run by its estimator, its budget and a digest of its configuration.

    Raises InputError for an estimator or an option that does not exist.
    """
    names = []
    for config in configs:
        budget = budget_of(estimator_of(config))
        words = [config.estimator, f"seed{config.seed}", config.digest[:10]]
        if budget is not None:
            words.insert(1, f"{budget['option']}{budget['value']}")
        names.append(re.sub(r"[^\w.-]", "_", "-".join(words)))
    return names


def _claim(folder: Path, names: Sequence[str], configs: Sequence[Config]) -> None:
    """Write down which sweep the folder belongs to, or check that it is this one: one with the same runs."""
    path = folder / "sweep.json"
    if not path.exists():
        if any(one.name != ".lock" for one in folder.iterdir()):
            raise InputError(
                f"--out {folder}: the folder holds something already, and no sweep; name a new one"
            )
        asked = [(name, config.model_dump(mode="json")) for name, config in zip(names, configs, strict=True)]
        runs = [{"name": name, "config": config} for name, config in asked]
        write_text(path, results.to_json({"schema": _SCHEMA, "runs": runs}))
    # By their names, which end with a digest of what is asked: what else a configuration says changes no result.
    elif set(sweep_order(folder)) != set(names):
        raise InputError(
            f"{folder} holds another sweep (its sweep.json asks for other runs); name another folder with --out"
        )


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep a second sweep out of the folder for as long as this one lasts, however it ends."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"cannot write {folder}: {why}; name a folder that can be written") from error
    try:
        try:
            lock(descriptor)
        except OSError:
            raise InputError(
                f"{folder}: another sweep is at work there; wait for it or name another folder with --out"
            ) from None
        yield
    finally:
        os.close(descriptor)
