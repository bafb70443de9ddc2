"""Many runs that survive: what is done stays done, whenever and however the sweep was stopped.

A sweep's folder holds `sweep.json` (the list of runs asked for), `parts/` (finished pieces of runs
that are not whole yet) and `runs/` (whole runs, as `bench run` writes them). Only this process
writes there; workers, local or on a Dask cluster, are sent trials to do and send back what came out.
"""

from __future__ import annotations

import fcntl
import hashlib
import itertools
import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.bench import results
from tactsim.bench.config import BUDGETS, RunConfig, run_config
from tactsim.bench.machine import versions
from tactsim.bench.runner import Gathered, finished_run, gather, plan_of
from tactsim.bench.trials import Progress, Task, TrialPlan, Trials, check_readings, run_chunk, unflatten_work
from tactsim.core import InputError
from tactsim.core.documents import LARGE, parse_json, parse_toml, read_text, read_toml
from tactsim.core.errors import unknown
from tactsim.core.files import new_folder, read_bytes, replacing, write_text
from tactsim.core.npz import read_npz
from tactsim.core.workers import worker_processes
from tactsim.estimators import create

TRIALS_A_PART = 20  # what a kill can cost: at most this many trials a worker
ATTEMPTS = 3  # how often trials are sent out again when a worker dies over them

Pool = Callable[[], AbstractContextManager[Executor]]


@dataclass(frozen=True)
class Part:
    """A piece of one run: some trials of one letter."""

    run: str
    number: int
    tasks: tuple[Task, ...]


def read(source: str) -> tuple[str, list[RunConfig]]:
    """Read a sweep from a TOML file or a suite's name: its name and its runs, in order.

    The file has `[[run]]` tables, and `[defaults]` laid under each. Their keys are the long options
    of `bench run` with underscores (`set` and `scan_set` are tables); a list stands for one run per
    entry, and several lists for every combination.

    Raises InputError if the file cannot be read, a key is unknown or a value is wrong.
    """
    path = Path(source)
    suite = files("tactsim.bench") / "suites" / f"{source}.toml"
    if not path.exists() and source in suites():
        table, name = parse_toml(suite.read_bytes(), f"suite {source}"), source
    elif path.suffix or path.exists():
        table, name = read_toml(path, "sweep"), path.stem
    else:
        raise unknown("suite (nor is it a file)", source, suites())
    return name, expand(table, f"sweep {source}")


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

    Raises InputError for an unknown key, a wrong value, no runs or more than 100,000.
    """
    strange = set(table) - {"run", "defaults"}
    if strange:
        raise unknown(f"table in {what}", strange.pop(), ("run", "defaults"))
    defaults, runs = table.get("defaults", {}), table.get("run", [])
    if not (isinstance(defaults, dict) and isinstance(runs, list) and all(isinstance(r, dict) for r in runs)):
        raise InputError(f"{what}: write [defaults] once and [[run]] for each group of runs")
    if not runs:
        raise InputError(f"{what} has no [[run]]")
    configs: dict[str, RunConfig] = {}
    for run in runs:
        axes = list(_axes({**defaults, **run}))
        empty = [".".join(key) for key, values in axes if not values]
        if empty:
            raise InputError(f"{what}: the list {empty[0]} is empty; give it a value or leave it out")
        count = int(np.prod([len(values) for _, values in axes], dtype=object)) if axes else 1
        if count + len(configs) > 100_000:
            raise InputError(f"{what} asks for {count:,} runs; the most is 100,000")
        for values in itertools.product(*(values for _, values in axes)):
            words: dict[str, Any] = {}
            for (key, _), value in zip(axes, values, strict=True):
                inner = words
                for group in key[:-1]:
                    inner = inner.setdefault(group, {})
                inner[key[-1]] = value
            config = run_config(**words)
            configs.setdefault(_digest(config), config)
    return list(configs.values())


def _axes(
    table: Mapping[str, Any], prefix: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], list[Any]]]:
    """Walk a table: every key, dotted ones as tuples, with the list of values that it takes."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _axes(value, (*prefix, key))
        else:
            yield (*prefix, key), value if isinstance(value, list) else [value]


def perform(
    configs: Sequence[RunConfig],
    folder: Path,
    *,
    jobs: int,
    pool: Pool | None = None,
    cache: bool = True,
    progress: Progress,
) -> list[Path]:
    """Do every run that `folder` does not hold yet; returns the folders of all runs, in order.

    jobs: local processes, where no `pool` of another kind is given. Readings that several runs share
    are pressed once, and each worker fits an estimator once for all the trials that it is sent.

    Raises InputError if the folder belongs to another sweep, is in use or cannot be written.
    """
    for config in configs:
        create(config.estimator, **config.options)  # a wrong option is said before the work
    names = _names(configs)
    with _locked(folder):
        _claim(folder, names, configs)
        places = [folder / "runs" / name for name in names]
        _tidy(folder, [place.name for place in places if (place / "run.json").exists()])
        todo = {
            name: config
            for name, config, place in zip(names, configs, places, strict=True)
            if not (place / "run.json").exists()
        }
        gathered = _gather_all(todo, jobs=jobs, cache=cache, progress=progress)
        parts = {name: _parts(name, gathered[name].letters, config) for name, config in todo.items()}
        left = {
            name: [part for part in of_run if _load_part(folder, part) is None]
            for name, of_run in parts.items()
        }
        done = sum(len(results.load(place).trials.truth) for place in places if (place / "run.json").exists())
        total = done + sum(len(part.tasks) for of_run in parts.values() for part in of_run)
        done = total - sum(len(part.tasks) for of_run in left.values() for part in of_run)
        progress("sweep", done, total)

        waiting = {name: {part.number for part in of_run} for name, of_run in left.items()}
        for name in todo:
            if not waiting[name]:
                _write_run(folder, name, todo[name], gathered[name], parts[name])
        plans = {name: plan_of(config, gathered[name].scan) for name, config in todo.items()}
        queue = [part for of_run in left.values() for part in of_run]
        for part, trials, work in _work_off(queue, plans, pool or _local(jobs)):
            _save_part(folder, part, trials, work)
            done += len(part.tasks)
            progress("sweep", done, total)
            name = part.run
            waiting[name].discard(part.number)
            if not waiting[name]:
                _write_run(folder, name, todo[name], gathered[name], parts[name])
    return places


def dask_pool(address: str) -> Pool:
    """Use the workers of a Dask cluster, tcp://HOST:PORT, behind the face of a local pool.

    A worker that dies has its trials sent to another. Raises InputError, when entered, if dask is
    not installed or no scheduler answers.
    """

    @contextmanager
    def enter() -> Iterator[Executor]:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--dask needs the package distributed: pip install 'tactsim[dask]'") from None
        try:
            client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--dask {address}: no scheduler answers there ({error})") from error
        with client, client.get_executor(pure=False, retries=ATTEMPTS) as executor:
            yield executor

    return enter


def _local(jobs: int) -> Pool:
    return lambda: worker_processes(jobs)


def _work_off(
    queue: list[Part], plans: Mapping[str, TrialPlan], pool: Pool
) -> Iterator[tuple[Part, Trials, dict[str, int]]]:
    """Send parts out and give back what comes in; after a worker's death the rest is sent again."""
    left = {(part.run, part.number): part for part in queue}
    for attempt in range(1, ATTEMPTS + 1):
        if not left:
            return
        try:
            with pool() as executor:
                futures = {
                    executor.submit(run_chunk, plans[part.run], list(part.tasks)): part
                    for part in left.values()
                }
                try:
                    for future in as_completed(futures):
                        part = futures[future]
                        trials, work = future.result()
                        del left[part.run, part.number]
                        yield part, trials, work
                except BaseException:
                    executor.shutdown(wait=False, cancel_futures=True)
                    raise
        except BrokenProcessPool:
            if attempt == ATTEMPTS:
                raise


def _parts(name: str, letters: Sequence[str], config: RunConfig) -> list[Part]:
    chunks = [
        tuple(Task(letter, trial) for trial in range(first, min(first + TRIALS_A_PART, config.trials)))
        for letter in letters
        for first in range(0, config.trials, TRIALS_A_PART)
    ]
    return [Part(name, number, chunk) for number, chunk in enumerate(chunks)]


def _gather_all(
    configs: Mapping[str, RunConfig], *, jobs: int, cache: bool, progress: Progress
) -> dict[str, Gathered]:
    """Press or load the readings of every run, each set of readings once."""
    found: dict[str, Gathered] = {}
    by_source: dict[str, Gathered] = {}
    for name, config in configs.items():
        source = config.source
        if source not in by_source:
            by_source[source] = gather(config, jobs=jobs, cache=cache, progress=progress)
        found[name] = by_source[source]
        check_readings(found[name].scan, found[name].letters, config.readings, config.hold_out)
    return found


def _write_run(folder: Path, name: str, config: RunConfig, gathered: Gathered, parts: list[Part]) -> None:
    """Put a run's parts together, write its folder, and remove the parts."""
    loaded = [_load_part(folder, part) for part in parts]
    pieces = [piece for piece in loaded if piece is not None]
    if len(pieces) != len(parts):
        raise InputError(
            f"{folder / 'parts'}: a finished part was changed while the sweep ran; start it again"
        )
    work: Counter[str] = Counter()
    for _, part_work in pieces:
        work.update(part_work)
    run = finished_run(config, gathered, Trials.joined(trials for trials, _ in pieces), unflatten_work(work))
    place = folder / "runs" / name
    with new_folder(place) as inside:
        results.save(run, inside)
    for part in parts:
        _part_path(folder, part).unlink(missing_ok=True)


def _tidy(folder: Path, done: Sequence[str]) -> None:
    """Remove what a sweep that was killed left: parts of runs that are whole, files half-written."""
    for path in [*folder.glob("runs/.*.part"), *folder.glob("parts/.*.part")]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path in folder.glob("parts/*.npz"):
        if path.name.rsplit(".", 2)[0] in done:
            path.unlink()


def _part_path(folder: Path, part: Part) -> Path:
    return folder / "parts" / f"{part.run}.{part.number:05d}.npz"


def _save_part(folder: Path, part: Part, trials: Trials, work: Mapping[str, int]) -> None:
    content = BytesIO()
    arrays = {field.name: getattr(trials, field.name) for field in fields(Trials)}
    np.savez(content, allow_pickle=False, work=np.array(json.dumps(work)), **arrays)
    body = content.getvalue()
    with replacing(_part_path(folder, part)) as stream:
        stream.write(_seal(body) + body)


def _load_part(folder: Path, part: Part) -> tuple[Trials, dict[str, int]] | None:
    """Read a finished part; None if there is none, or it is not what this version wrote."""
    try:
        content = read_bytes(_part_path(folder, part), LARGE)
    except InputError:
        return None
    if _seal(content[32:]) != content[:32]:
        return None
    try:
        arrays = read_npz(BytesIO(content[32:]), ("work", *(field.name for field in fields(Trials))))
        work = parse_json(str(arrays.pop("work")), "work")
    except InputError:
        return None
    return Trials(**arrays), work


def _seal(body: bytes) -> bytes:
    """Hash a part with the versions that made it, so that no run mixes the trials of two versions."""
    return hashlib.sha256(json.dumps(versions(), sort_keys=True).encode() + body).digest()


def _names(configs: Sequence[RunConfig]) -> list[str]:
    """Name each run by its estimator, its budget and a digest of its configuration."""
    return [
        "-".join(
            [config.estimator]
            + [f"{key}{config.options[key]}" for key in BUDGETS if key in config.options]
            + [f"seed{config.seed}", _digest(config)[:10]]
        )
        for config in configs
    ]


def _digest(config: RunConfig) -> str:
    return hashlib.sha256(json.dumps(config.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()


def _claim(folder: Path, names: Sequence[str], configs: Sequence[RunConfig]) -> None:
    """Write down which sweep the folder belongs to, or check that it is this one."""
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
    elif read_text(path, "sweep's list of runs", LARGE) != content:
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
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{folder}: another sweep is at work there; wait for it or name another folder with --out"
            ) from None
        yield
    finally:
        os.close(descriptor)
