"""An experiment, from top to bottom: readings, fit, trials, and the `Run` of what came out."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from time import perf_counter
from typing import Any

import numpy as np

from tactsim.bench import kinds
from tactsim.bench.kinds import PLANE, Config, Gathered
from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.results import Run
from tactsim.bench.trials import (
    OneTrial,
    Progress,
    Trials,
    fit,
    run_trials,
    silent,
    source_of_trials,
)
from tactsim.core import InputError, Scan
from tactsim.core.source_digest import git_commit
from tactsim.estimators import Estimator, create
from tactsim.estimators.estimator import about_estimator, check_options, name_of, proposes_none
from tactsim.estimators.registry import load

PARTS = 8  # of the trials, for each process: none waits long for the last of another


def perform(
    config: Config,
    *,
    scan: Scan | None = None,
    estimator: Estimator | None = None,
    trials: Sequence[OneTrial] | None = None,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress = silent,
) -> Run:
    """Press or load the readings, fit the estimator, do all trials and score them.

    scan: the readings that `config.given` names. estimator: replaces the one that `config` names. trials: those to do;
    by default `config.trials` of each letter. jobs: processes. cache: whether pressed readings may be read from the
    cache and kept there. progress(stage, done, total) is called for the stages "press", "map" and "trials".

    Raises InputError for a configuration that does not fit together.
    """
    start, kind = perf_counter(), kinds.load(config.kind)
    if estimator is not None:
        config = _with_estimator(config, estimator)
    fitted = estimator_of(config, estimator)  # a wrong option is reported before the work
    gathered = gather(config, scan=scan, jobs=jobs, cache=cache, progress=progress)
    kind.check_gathered(config, gathered)
    plan = kind.plan(config, gathered.scan, estimator, gathered.objects)
    tasks = trials or kind.tasks(config, gathered)

    if jobs > 1:
        from tactsim.bench.sent_trials import received_trials, send_trials
        from tactsim.core.workers import worker_processes
    fitting = perf_counter()
    with nullcontext() if jobs == 1 else worker_processes(min(jobs, len(tasks))) as executor:
        # Workers fit while this process does: its estimator's maps are shown, and with one job it does the trials.
        sent = None if executor is None else send_trials(executor, plan, tasks, PARTS * jobs)
        progress("map", 0, 1)
        fit(fitted, gathered.scan, plan.forward)
        progress("map", 1, 1)
        # Its bins are as wide as the readings ask for
        about, trying = about_estimator(fitted), perf_counter()
        if sent is None:
            done = (*run_trials(plan, fitted, tasks, progress=progress), about)
        else:
            done = received_trials(sent, progress)
    tried = perf_counter()
    seconds = {"fit": trying - fitting, "trials": tried - trying, "total": tried - start}
    source = None if estimator is None else source_of_trials(estimator)
    run = finished_run(config, gathered, *done, fitted, source=source, seconds=seconds, jobs=jobs)
    return replace(run, plan=plan, maps=kind.maps(fitted))


def estimator_of(config: Config, estimator: Estimator | None = None) -> Estimator:
    """Create the estimator that a configuration names, or take `estimator`, which `_with_estimator` has named in it.

    Raises InputError, which says whose an option is, and for an estimator that is not for such runs, or cannot choose
    touches and should.
    """
    for name, usual in (("bins", "histogram"), ("particles", "particle")):
        given = getattr(config, name, None) is not None
        if given and name not in load(config.estimator).options_type.model_fields:
            none = f"--{name} (in Python {name}): estimator {config.estimator} has none"
            raise InputError(f"{none}; leave it out, or add --estimator {usual}")
    if estimator is None:
        estimator = create(config.estimator, **config.options)
    if config.kind != estimator.KIND:
        own = "leave out --task" if estimator.KIND == PLANE else f"add --task {estimator.KIND}"
        what = f"estimator {config.estimator} is for runs of kind {estimator.KIND}"
        raise InputError(f"{what}: {own}, or take another")
    if config.explore == "information" and not estimator.proposes:
        raise proposes_none(config.estimator)
    return estimator


def _with_estimator(config: Config, estimator: Estimator) -> Config:
    """Name an estimator, by its class if it is not registered, and its options. Raises InputError if it has none."""
    kind = type(estimator)
    name = name_of(estimator)
    check_options(estimator, name)
    if config.options:
        raise InputError(f"the estimator {name} was given with its options; leave out bins, particles, set")
    options = estimator.options.model_dump(mode="json", exclude_defaults=True)
    name = estimator.created_as or f"{kind.__module__}:{kind.__qualname__}"
    return config.model_copy(update={"estimator": name, "set": options})


def gather(
    config: Config,
    *,
    scan: Scan | None = None,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress = silent,
) -> Gathered:
    """Get the readings of a run: those given as `scan`, from the press or from files.

    Raises InputError if a named object is not among the readings, or files do not fit together.
    """
    return kinds.load(config.kind).gather(config, scan=scan, jobs=jobs, cache=cache, progress=progress)


def finished_run(
    config: Config,
    gathered: Gathered,
    trials: Trials,
    work: dict[str, Any],
    about: dict[str, Any],
    estimator: Estimator,
    *,
    source: str | None = None,
    seconds: dict[str, float] | None = None,
    jobs: int | None = None,
) -> Run:
    """Score the trials and build the `Run`.

    about: what `about_estimator` says of the fitted estimator. estimator: the one that did the trials, whose fit to the
    pad need not be found again, or one like it. source: see `source_of_trials`, of an estimator that is not the
    registered one. seconds: of the stages; a sweep, which does the trials of several runs at once, has none.
    """
    scan = gathered.scan
    kind = kinds.load(config.kind)
    said, bounds = kind.said(config, gathered, trials, estimator)
    learned = scan.where("train").letters
    about = {
        **about,
        **said,
        "letters": list(gathered.letters),
        "scan": dict(scan.meta),
        "alone": learned[0] if len(learned) == 1 and not about["options"].get("unknown") else None,
        "readings_digest": scan.digest,
        "versions": versions(),
        "source": source or source_of_trials(config.estimator),
        "commit": git_commit(),
        "machine": machine(),
    }
    times = {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "jobs": jobs,
        "peak_memory_mb": peak_memory_mb(),
        "seconds": {
            "scan": gathered.seconds,
            **(seconds or {}),
            "update_per_reading": float(trials.update_s[trials.taken].mean()),
            "update_p99": float(np.quantile(trials.update_s[trials.taken], 0.99)),
            "estimate_per_reading": float(trials.estimate_s[trials.taken].mean()),
            "propose_per_reading": float(trials.propose_s[trials.taken].mean()),
        },
    }
    return Run(
        config=config.model_dump(mode="json"),
        about=about,
        objects=dict(gathered.objects),
        work=gathered.work | work | {"skipped": gathered.work["skipped"] | work["skipped"]},
        trials=trials,
        times=times,
        bounds=bounds,
        shape_files=kind.shape_files(config),
    )
