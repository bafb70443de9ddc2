"""Do the runs that a task asks of a method, and put them into a bundle."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from tactsim.bench import experiment
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.leaderboard.bundle import DONE, Bundle
from tactsim.bench.leaderboard.confined import (
    Confined,
    Limits,
    NoScore,
    is_plug_in,
    module_of,
)
from tactsim.bench.leaderboard.confined_trials import confined_processes, run_trials_confined
from tactsim.bench.machine import machine, versions
from tactsim.bench.results import Run
from tactsim.bench.tasks import Task, task
from tactsim.bench.tasks.data import check_data
from tactsim.bench.trials import OneTrial, Progress, check_readings, source_of_trials
from tactsim.core import InputError
from tactsim.core.errors import short, unknown
from tactsim.core.plug_ins import plug_ins
from tactsim.core.source_digest import git_commit, source_digest
from tactsim.estimators import create, names
from tactsim.estimators.registry import GROUP


@dataclass(frozen=True)
class Method:
    """What is tried: an estimator's registered name and its options."""

    estimator: str
    options: Mapping[str, Any]

    @property
    def plug_in(self) -> bool:
        """Tell whether it comes from an installed package; it is then never imported here."""
        return is_plug_in(self.estimator)

    def processes(self, jobs: int, limits: Limits | None) -> AbstractContextManager[Sequence[Confined]]:
        """Start the processes of a plug-in; a built-in estimator needs none to do its runs."""
        if not self.plug_in:
            return nullcontext(())
        return confined_processes(self.estimator, self.options, jobs, limits)


def submit(
    task_name: str,
    method: Method,
    *,
    title: str | None = None,
    reproducible: bool = True,
    jobs: int = 1,
    cache: bool = True,
    limits: Limits | None = None,
    rng: np.random.Generator,
    progress: Progress = experiment.silent,
) -> tuple[Bundle, str]:
    """Do all runs of a task, one a seed; a plug-in runs confined, and gets a status instead of a score if it fails.

    task_name: of a frozen task, or a FILE.toml of one's own. title: how tables call the method; by default its name and
    options. reproducible: whether the same seeds give the same bits. rng: draws the order in which a plug-in sees the
    trials. Returns the bundle, and the last that a plug-in printed if it failed.

    Raises InputError for an unknown task, estimator or option, and if this machine presses other data than the task's.
    """
    asked, hashes = stated(task_name)
    if title is not None and not (title.isprintable() and 0 < len(title) <= 200):
        raise InputError(f"title {short(title)}: give 1 to 200 printable characters")
    if method.estimator not in names():
        raise unknown("estimator", method.estimator, names())
    if not method.plug_in:
        create(method.estimator, **method.options)  # a wrong option is reported before the work
    check_data(asked, jobs=jobs, cache=cache, progress=_of("press", progress))
    status, output, runs = DONE, "", list[Run]()
    try:
        with method.processes(jobs, limits) as processes:
            for number, config in enumerate(configs_of(asked, method, processes)):
                of_run = _of_run(number, len(asked.seeds), progress)
                if method.plug_in:
                    runs.append(
                        run_confined(config, processes, rng=rng, jobs=jobs, cache=cache, progress=of_run)
                    )
                else:
                    runs.append(experiment.perform(config, jobs=jobs, cache=cache, progress=of_run))
    except NoScore as error:
        status, output, runs = error.status, error.output, []
    bundle = Bundle(
        task=Path(asked.name).name,
        task_data=hashes,
        method="",
        estimator=method.estimator,
        options=runs[0].about["settings"] if runs else method.options,
        reproducible=reproducible,
        status=status,
        versions=versions(),
        source_hash=source_of(method),
        machine=machine(),
        commit=git_commit(),
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        runs=tuple(runs),
        package=package_of(method),
    )
    words = [method.estimator, *(f"{name} {value}" for name, value in method.options.items())]
    return replace(bundle, method=title or (bundle.pooled.label if runs else ", ".join(words))), output


def stated(task_name: str) -> tuple[Task, str]:
    """Give a task and the hash of its data. Raises InputError for an unknown task, and for one that states none."""
    asked = task(task_name)
    if asked.data is None:
        raise InputError(
            f"task {asked.name} states no hashes of its data, so nobody could check a result; "
            "`bench tasks FILE --check` prints them"
        )
    return asked, asked.data


def configs_of(asked: Task, method: Method, processes: Sequence[Confined]) -> list[RunConfig]:
    """Give the runs of a method on a task, one a seed, with the bound of their errors, which the tables show.

    A plug-in says in its own process whether it chooses touches. Raises InputError for an unknown estimator or option.
    """
    if not method.plug_in:
        configs = asked.configs(method.estimator, method.options)
        return [config.model_copy(update={"bound": True}) for config in configs]
    words: dict[str, Any] = {
        "estimator": method.estimator,
        "set": dict(method.options),
        "task": asked.name,
        "bound": True,
    }
    if asked.words.get("explore") == "information":
        words["explore"] = "information" if processes[0].proposes else "blind"
    return [run_config(**words, seed=seed) for seed in asked.seeds]


def run_confined(
    config: RunConfig,
    processes: Sequence[Confined],
    *,
    rng: np.random.Generator,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress = experiment.silent,
) -> Run:
    """Do a run as `experiment.perform` does, with the estimator in processes of its own: it is not imported here.

    Raises InputError for a configuration that does not fit together, and NoScore if the estimator fails.
    """
    start = perf_counter()
    gathered = experiment.gather(config, jobs=jobs, cache=cache, progress=progress)
    check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(config.trials)]
    trying = perf_counter()
    plan = experiment.plan_of(config, gathered.scan)
    trials, work = run_trials_confined(plan, tasks, processes, rng=rng, progress=progress)
    tried = perf_counter()
    seconds = {"trials": tried - trying, "total": tried - start}
    estimator = processes[0]
    source = source_of(Method(config.estimator, config.options))
    run = experiment.finished_run(
        config, gathered, trials, work, estimator, source=source, seconds=seconds, jobs=jobs
    )
    return replace(run, about=run.about | {"settings": estimator.settings})


def source_of(method: Method) -> str:
    """Hash the source code that trials of a method depend on.

    Of a plug-in these are tactsim's and all files of the plug-in's own package, such as weights.
    """
    if not method.plug_in:
        return source_of_trials(method.estimator)
    module = module_of(method.estimator)
    content = hashlib.sha256(source_digest(module).encode())
    spec = find_spec(module.partition(".")[0])
    for place in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(place)
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix not in (".py", ".pyc"):
                with path.open("rb") as stream:
                    found = hashlib.file_digest(stream, "sha256").hexdigest()
                content.update(f"{path.relative_to(folder)} {found}\n".encode())
    return content.hexdigest()


def package_of(method: Method) -> str | None:
    """Name the distribution that a plug-in came in, with its version; None for a built-in estimator."""
    found = [point.dist for point in plug_ins(GROUP) if point.name == method.estimator and method.plug_in]
    return next((f"{dist.name} {dist.version}" for dist in found if dist is not None), None)


def _of(stage: str, progress: Progress) -> Progress:
    """Report one stage only."""
    return lambda at, done, total: progress(at, done, total) if at == stage else None


def _of_run(number: int, runs: int, progress: Progress) -> Progress:
    """Report the trials of one of many runs as a part of all."""

    def report(stage: str, done: int, total: int) -> None:
        if stage == "trials":
            progress("sweep", number * total + done, runs * total)

    return report
