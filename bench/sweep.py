"""Do many runs, and keep what is done, whenever and however the sweep is stopped.

A sweep's folder holds `sweep.json` (the list of runs asked for), `chunks/` (finished chunks of runs that are not
whole yet) and `runs/` (whole runs, as `bench run` writes them). Only this process writes there. Workers, local or
on a Dask cluster, receive trials and send back their results.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from tactsim.bench import results
from tactsim.bench.about_estimator import budget_of
from tactsim.bench.chunks import Chunk, Waiting, chunks_of, load_chunk, save_chunk
from tactsim.bench.config import RunConfig
from tactsim.bench.report.collect import sweep_order
from tactsim.bench.run import Run
from tactsim.bench.runner import Gathered, finished_run, gather, plan_of
from tactsim.bench.trial_plan import TrialPlan, source_of_trials
from tactsim.bench.trial_workers import run_chunk
from tactsim.bench.trials import Progress, Trials, check_readings
from tactsim.bench.work_counts import unflatten_work
from tactsim.core import InputError
from tactsim.core.files import new_folder, write_text
from tactsim.core.workers import worker_processes
from tactsim.estimators import create

SCHEDULER_ANSWERS_IN = 10.0  # s, or it counts as none
ATTEMPTS = 3  # how often trials are tried when workers die

Pool = Callable[[], AbstractContextManager[Executor]]


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
        plans = {name: plan_of(config, gathered[name].scan) for name, config in todo.items()}
        chunks = {
            name: chunks_of(name, plans[name], gathered[name].letters, config.trials)
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
        waiting, running = Waiting(left.values()), dict[Future[Any], Chunk]()
        try:
            with pool() as executor:
                run = None
                while waiting and len(running) < (at_once or len(left)):
                    chunk = waiting.take(run)
                    run = None if at_once else chunk.run
                    running[executor.submit(run_chunk, plans[chunk.run], list(chunk.tasks))] = chunk
                while running:
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                    for future in done:
                        chunk = running.pop(future)
                        trials, work = future.result()
                        if waiting:  # the worker that is free now has fitted this run's estimator already
                            more = waiting.take(chunk.run)
                            running[executor.submit(run_chunk, plans[more.run], list(more.tasks))] = more
                        del left[chunk.run, chunk.number]
                        yield chunk, trials, work
        except BrokenExecutor:
            if attempt == ATTEMPTS:
                raise


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


def _check_sources(folder: Path, whole: Mapping[str, Run]) -> None:
    """Raise InputError if a whole run was made by other source code than the rest would be."""
    for name, run in whole.items():
        if run.about["source"] != source_of_trials(run.estimator):
            raise InputError(
                f"{folder / 'runs' / name} was made by other source code than this; remove such runs, which are "
                "then done again, or name another folder with --out"
            )


def _write_run(folder: Path, config: RunConfig, gathered: Gathered, chunks: Sequence[Chunk]) -> None:
    """Put a run's chunks together, write its folder, and remove the chunks."""
    loaded = [load_chunk(folder, chunk) for chunk in chunks]
    pieces = [piece for piece in loaded if piece is not None]
    if len(pieces) != len(chunks):
        raise InputError(
            f"{folder / 'chunks'}: a finished chunk was changed while the sweep ran; start it again"
        )
    work: Counter[str] = Counter()
    for _, of_chunk in pieces:
        work.update(of_chunk)
    run = finished_run(config, gathered, Trials.joined(trials for trials, _ in pieces), unflatten_work(work))
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


def _names(configs: Sequence[RunConfig]) -> list[str]:
    """Name each run by its estimator, its budget and a digest of its configuration.

    Raises InputError for an estimator or an option that does not exist.
    """
    names = []
    for config in configs:
        budget = budget_of(create(config.estimator, **config.options))
        words = [config.estimator, f"seed{config.seed}", config.digest[:10]]
        if budget is not None:
            words.insert(1, f"{budget['option']}{budget['value']}")
        names.append(re.sub(r"[^\w.-]", "_", "-".join(words)))
    return names


def _claim(folder: Path, names: Sequence[str], configs: Sequence[RunConfig]) -> None:
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
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{folder}: another sweep is at work there; wait for it or name another folder with --out"
            ) from None
        yield
    finally:
        os.close(descriptor)
