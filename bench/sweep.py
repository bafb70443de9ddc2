"""A sweep: read its runs from a file, do them, and keep what is done, whenever and however it is stopped.

A sweep's file has a run for every combination of its lists. Its folder holds `sweep.json` (the list of runs asked
for), `chunks/` (finished chunks of runs that are not whole yet) and `runs/` (whole runs, as `bench run` writes them).
Only this process writes there. Workers, local or on a Dask cluster, receive trials and send back their results.

A chunk holds the trials that a worker does at once. Its file begins with a seal: a hash of its content, and of the
source code, the libraries and the readings that made it. A chunk whose seal differs is done again, so that no run
mixes results of different source code.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.bench import results
from tactsim.bench.config import SOLIDS, RunConfig, any_config
from tactsim.bench.experiment import (
    Config,
    Gathered,
    check_estimator,
    check_presses,
    estimator_of,
    finished_run,
    gather,
    plan_of,
    tasks_of,
)
from tactsim.bench.machine import versions
from tactsim.bench.results import Run, sweep_order
from tactsim.bench.tasks import task
from tactsim.bench.trials import (
    OneTrial,
    Progress,
    SpaceTrials,
    TrialPlan,
    Trials,
    check_readings,
    run_chunk,
    source_of_trials,
)
from tactsim.core import InputError
from tactsim.core.documents import LARGE, parse_json, parse_toml, read_toml
from tactsim.core.errors import unknown
from tactsim.core.files import lock, new_folder, read_bytes, replacing, write_text
from tactsim.core.npz import read_npz
from tactsim.core.workers import worker_processes
from tactsim.estimators import create
from tactsim.estimators.estimator import budget_of, flatten_work, unflatten_work


def read(source: str) -> tuple[str, list[Config]]:
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


def expand(table: Mapping[str, Any], what: str) -> list[Config]:
    """Turn a sweep's tables into its runs: every combination of every list, without repeats.

    Raises InputError for an unknown key, a wrong value, no runs or more than 100,000, and, with the number of the
    [[run]], for what `experiment` refuses before the work.
    """
    configs: dict[str, Config] = {}
    sources: set[tuple[str, int]] = set()
    for where, words in _combinations(table, what):
        try:
            for seed in _seeds(words):
                config = any_config(**words, **seed)
                check_estimator(config, estimator_of(config))
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
    if words.get("task") in (None, SOLIDS) or "seed" in words:
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


MOST_TRIALS = 20  # trials of a chunk: the most that a worker loses when it is killed


@dataclass(frozen=True)
class Chunk:
    """Some trials of one run. made_with: what their result depends on, for the seal."""

    run: str
    number: int
    tasks: tuple[OneTrial, ...]
    made_with: str

    def path(self, folder: Path) -> Path:
        """Name the chunk's file in a sweep's folder."""
        return folder / "chunks" / f"{self.run}.{self.number:05d}.npz"

    def seal(self, body: bytes) -> bytes:
        """Hash a file's content with which trials it holds and what they were made with: 32 bytes."""
        tasks = json.dumps([[task.truth, task.trial] for task in self.tasks])
        return hashlib.sha256(f"{self.made_with} {tasks}".encode() + body).digest()


def chunks_of(name: str, plan: TrialPlan, tasks: Sequence[OneTrial]) -> list[Chunk]:
    """Divide a run into chunks of at most MOST_TRIALS trials, letter after letter.

    A chunk goes on with the next letter, so that a run of few trials is one chunk, for which one worker fits once.
    """
    trying = [plan.readings, plan.seed, plan.explore, plan.press is not None, plan.slip.model_dump()]
    trying.append(plan.each_held_out)
    made_with = json.dumps([plan.source, plan.digest, trying, versions()], sort_keys=True)
    return [
        Chunk(name, number, tuple(tasks[first : first + MOST_TRIALS]), made_with)
        for number, first in enumerate(range(0, len(tasks), MOST_TRIALS))
    ]


def take(waiting: list[Chunk], run: str | None, begun: Set[str]) -> Chunk:
    """Take a chunk from those that wait: of `run` if one is left, or else of a run that has not begun, or the first.

    So few workers fit the estimator of the same run. Raises IndexError if none waits.
    """
    order = range(len(waiting))
    same = (k for k in order if waiting[k].run == run)
    new = (k for k in order if waiting[k].run not in begun)
    return waiting.pop(next(same, next(new, 0)))


def save_chunk(folder: Path, chunk: Chunk, trials: Trials, work: Mapping[str, int]) -> None:
    """Keep a chunk that is done, whole or not at all. Raises InputError if it cannot be written."""
    content = BytesIO()
    arrays = {field.name: getattr(trials, field.name) for field in fields(trials)}
    np.savez(content, allow_pickle=False, work=np.array(json.dumps(work)), **arrays)
    body = content.getvalue()
    with replacing(chunk.path(folder)) as stream:
        stream.write(chunk.seal(body) + body)


def load_chunk(folder: Path, chunk: Chunk) -> tuple[Trials, dict[str, int]] | None:
    """Read a chunk that is done; None if there is no file, or its seal differs."""
    try:
        content = read_bytes(chunk.path(folder), LARGE)
    except InputError:
        return None
    if chunk.seal(content[32:]) != content[:32]:
        return None
    try:
        names = [field.name for field in fields(SpaceTrials)]
        own = [field.name for field in fields(Trials)]
        arrays = read_npz(BytesIO(content[32:]), ("work", *own), names[len(own) :])
        work = parse_json(str(arrays.pop("work")), "work")
    except InputError:
        return None
    return (SpaceTrials if "start" in arrays else Trials)(**arrays), work


SCHEDULER_ANSWERS_IN = 10.0  # s, or it counts as none
ATTEMPTS = 3  # how often trials are tried when workers die

Pool = Callable[[], AbstractContextManager[Executor]]


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

    jobs: local processes, if no other `pool` is given. Readings that several runs share are pressed once, and
    a worker fits an estimator once for all its trials of a run, most often all of them.

    Raises InputError if the folder belongs to another sweep, is in use or cannot be written, or if it holds
    runs made by other source code while others are still to do.
    """
    names = _names(configs)  # a wrong option is reported before the work
    with _locked(folder):
        _claim(folder, names, configs)
        places = {name: folder / "runs" / name for name in names}
        whole = {name: results.load(place) for name, place in places.items() if (place / "run.json").exists()}
        _tidy(folder, list(whole))
        todo = {name: config for name, config in zip(names, configs, strict=True) if name not in whole}
        if todo:
            _check_sources(folder, whole)
        gathered = _gather_all(todo, jobs=jobs, cache=cache, progress=progress)
        plans = {
            name: plan_of(config, gathered[name].scan, solids=gathered[name].solids)
            for name, config in todo.items()
        }
        chunks = {
            name: chunks_of(name, plans[name], tasks_of(config, gathered[name].letters))
            for name, config in todo.items()
        }
        left = {
            name: [chunk for chunk in of_run if load_chunk(folder, chunk) is None]
            for name, of_run in chunks.items()
        }
        done = sum(len(run.trials.truth) for run in whole.values())
        total = done + sum(len(chunk.tasks) for of_run in chunks.values() for chunk in of_run)
        done = total - sum(len(chunk.tasks) for of_run in left.values() for chunk in of_run)
        progress("sweep", done, total)

        waiting = {name: {chunk.number for chunk in of_run} for name, of_run in left.items()}
        for name in todo:
            if not waiting[name]:
                _write_run(folder, todo[name], gathered[name], chunks[name])
        queue = [chunk for of_run in left.values() for chunk in of_run]
        for chunk, trials, work in _work_off(queue, plans, pool or _local(jobs), None if pool else jobs):
            save_chunk(folder, chunk, trials, work)
            done += len(chunk.tasks)
            progress("sweep", done, total)
            name = chunk.run
            waiting[name].discard(chunk.number)
            if not waiting[name]:
                _write_run(folder, todo[name], gathered[name], chunks[name])
    return list(places.values())


def dask_pool(address: str) -> Pool:
    """Make a pool of the workers of a Dask cluster at tcp://HOST:PORT.

    If a worker dies, its trials are sent to another. Entering the pool raises InputError if dask is not
    installed or no scheduler answers. Raises InputError for what is no such address.
    """
    if re.fullmatch(r"(\w+://)?[^/]+:\d+", address) is None:
        raise InputError(f"--dask {address}: give the scheduler's address, such as tcp://localhost:8786")

    @contextmanager
    def enter() -> Iterator[Executor]:
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
                yield executor
            except BaseException:
                executor.shutdown(wait=False)  # cancels what is not done
                raise

    return enter


def _local(jobs: int) -> Pool:
    return lambda: worker_processes(jobs)


def _work_off(
    queue: list[Chunk], plans: Mapping[str, TrialPlan], pool: Pool, at_once: int | None
) -> Iterator[tuple[Chunk, Trials, dict[str, int]]]:
    """Send chunks to workers and yield their results; after a worker's death send the rest again.

    at_once: the number of workers, each of which then gets one chunk at a time; None if it is not known, which sends
    all chunks.
    """
    left = {(chunk.run, chunk.number): chunk for chunk in queue}
    for attempt in range(1, ATTEMPTS + 1):
        if not left:
            return
        try:
            with pool() as executor:
                for chunk, trials, work in _results(executor, list(left.values()), plans, at_once):
                    del left[chunk.run, chunk.number]
                    yield chunk, trials, work
        except BrokenExecutor:
            if attempt == ATTEMPTS:
                raise


def _results(
    executor: Executor, waiting: list[Chunk], plans: Mapping[str, TrialPlan], at_once: int | None
) -> Iterator[tuple[Chunk, Trials, dict[str, int]]]:
    """Send chunks to workers and yield their results as they come. Raises BrokenExecutor if a worker dies."""
    running, begun = dict[Future[Any], Chunk](), set[str]()
    free: list[str | None] = [None] * (at_once or len(waiting))  # the run that each free worker has fitted
    while waiting or running:
        while waiting and free:
            run = free.pop() if at_once else waiting[0].run
            chunk = take(waiting, run, begun)
            begun.add(chunk.run)
            running[executor.submit(run_chunk, plans[chunk.run], list(chunk.tasks))] = chunk
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            chunk = running.pop(future)
            free.append(chunk.run)
            trials, work = future.result()
            yield chunk, trials, work


def _gather_all(
    configs: Mapping[str, Config], *, jobs: int, cache: bool, progress: Progress
) -> dict[str, Gathered]:
    """Press or load the readings of every run, each set of readings once."""
    found: dict[str, Gathered] = {}
    by_source: dict[str, Gathered] = {}
    for name, config in configs.items():
        source = config.source
        if source not in by_source:
            by_source[source] = gather(config, jobs=jobs, cache=cache, progress=progress)
        found[name] = by_source[source]
        if isinstance(config, RunConfig):
            check_readings(found[name].scan, found[name].letters, config.readings, config.hold_out)
    return found


def _check_sources(folder: Path, whole: Mapping[str, Run]) -> None:
    """Raise InputError if a whole run was made by other source code than the rest would be."""
    for name, run in whole.items():
        if run.about["source"] != source_of_trials(run.estimator):
            raise InputError(
                f"{folder / 'runs' / name} was made by other source code than this; remove such runs, which are "
                "then done again, or name another folder with --out"
            )


def _write_run(folder: Path, config: Config, gathered: Gathered, chunks: Sequence[Chunk]) -> None:
    """Put a run's chunks together, write its folder, and remove the chunks."""
    loaded = [load_chunk(folder, chunk) for chunk in chunks]
    pieces = [piece for piece in loaded if piece is not None]
    if len(pieces) != len(chunks):
        raise InputError(
            f"{folder / 'chunks'}: a finished chunk was changed while the sweep ran; start it again"
        )
    work: Counter[str] = Counter()
    for _, of_chunk in pieces:
        work.update(flatten_work(of_chunk))
    estimator = create(config.estimator, **config.options)
    joined = Trials.joined(trials for trials, _ in pieces)
    run = finished_run(config, gathered, joined, unflatten_work(work), estimator)
    with new_folder(folder / "runs" / chunks[0].run) as inside:
        results.save(run, inside)
    for chunk in chunks:
        chunk.path(folder).unlink(missing_ok=True)


def _tidy(folder: Path, done: Sequence[str]) -> None:
    """Remove what a killed sweep left: chunks of runs that are whole, and half-written files."""
    for path in [*folder.glob("runs/.*.part"), *folder.glob("chunks/.*.part")]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path in folder.glob("chunks/*.npz"):
        if path.name.rsplit(".", 2)[0] in done:
            path.unlink()


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
    content = results.to_json(
        {
            "schema": results.SCHEMA,
            "runs": [
                {"name": name, "config": config.model_dump(mode="json")}
                for name, config in zip(names, configs, strict=True)
            ],
        }
    )
    path = folder / "sweep.json"
    if not path.exists():
        write_text(path, content)
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
        raise InputError(
            f"cannot write {folder}: {error.strerror or error}; name a folder that can be written"
        ) from error
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
