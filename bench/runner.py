"""One run from readings to scores: press or load, fit, try, summarise."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter
from typing import Any

from tactsim.bench.config import RunConfig
from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.results import Run
from tactsim.bench.score import properties, summarise
from tactsim.bench.trials import Progress, Protocol, Task, Trials, check_readings, run_trials
from tactsim.core import InputError, Scan
from tactsim.core.errors import unknown
from tactsim.core.scan import train_on
from tactsim.estimators import NONE, Estimator, create
from tactsim.press import scan_letters


def silent(stage: str, done: int, total: int) -> None:
    """Report no progress."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """The readings of a run, which letters are tried, and what it took to get them."""

    scan: Scan
    letters: tuple[str, ...]
    work: dict[str, Any]
    seconds: float


def perform(
    config: RunConfig, *, jobs: int = 1, cache: bool = True, progress: Progress = silent
) -> tuple[Run, Estimator]:
    """Press or load the readings, fit the estimator, do all trials and score them.

    jobs: processes. cache: whether pressed readings may be taken from and put into the cache.
    progress(stage, done, total) is called for the stages "press", "map" and "trials".

    Returns the run and the fitted estimator. Raises InputError for a configuration that does not
    fit together.
    """
    start = perf_counter()
    estimator = create(config.estimator, **config.options)  # a wrong option is said before the work
    gathered = gather(config, jobs=jobs, cache=cache, progress=progress)
    check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)

    fitting = perf_counter()
    progress("map", 0, 1)
    estimator.fit(gathered.scan)
    progress("map", 1, 1)

    trying = perf_counter()
    tasks = [Task(letter, trial) for letter in gathered.letters for trial in range(config.trials)]
    protocol = protocol_of(config, gathered.scan)
    trials, work = run_trials(protocol, estimator, tasks, jobs=jobs, progress=progress)
    tried = perf_counter()
    seconds = {"fit": trying - fitting, "trials": tried - trying, "total": tried - start}
    return finished_run(config, gathered, trials, work, seconds=seconds, jobs=jobs), estimator


def gather(config: RunConfig, *, jobs: int, cache: bool, progress: Progress) -> Gathered:
    """Get the readings of a run from the press or from files.

    Raises InputError if a named letter is not among the readings, a letter is called NONE or two files do
    not fit together.
    """
    start = perf_counter()
    work: dict[str, Any] = {"presses": 0, "skipped": {}}
    if config.scan_file is None:
        scan, work = scan_letters(
            config.scan, jobs=jobs, cache=cache, progress=lambda done, total: progress("press", done, total)
        )
    else:
        scan = Scan.load(config.scan_file)
    if config.train_file is not None:
        scan = train_on(Scan.load(config.train_file), scan)
    letters = config.letters or scan.letters
    if not letters:
        raise InputError(f"{config.scan_file} holds no readings")
    if NONE in letters:
        raise InputError(f"a letter is called {NONE!r}, which means none of the known letters; rename it")
    for letter in letters:
        if letter not in scan.letters:
            raise unknown("letter of the scan", letter, scan.letters)
    for letter in config.hold_out:
        if letter not in letters:
            raise unknown("letter to hold out", letter, letters)
    if set(letters) <= set(config.hold_out):
        raise InputError("--hold-out leaves no letter to train on")
    scan = scan.of_letters(letters).untrained(config.hold_out)
    return Gathered(scan, letters, work, perf_counter() - start)


def protocol_of(config: RunConfig, scan: Scan) -> Protocol:
    """Say what a worker needs to do this run's trials on these readings."""
    return Protocol(config.estimator, config.options, scan, config.readings, config.seed, config.explore)


def finished_run(
    config: RunConfig,
    gathered: Gathered,
    trials: Trials,
    work: dict[str, Any],
    *,
    seconds: dict[str, float] | None = None,
    jobs: int | None = None,
) -> Run:
    """Score the trials and put everything that a run's folder keeps together.

    seconds: of the stages, where they were measured in one piece.
    """
    objects = properties(gathered.scan)
    estimator = create(config.estimator, **config.options)
    about: dict[str, Any] = {
        "protocol": _protocol_name(config),
        "letters": list(gathered.letters),
        "description": estimator.describe(),
        "options": estimator.options.model_dump(mode="json"),
        "classifier_agreement": eq3_agreement(gathered.scan),
        "scan": dict(gathered.scan.meta),
        "versions": versions(),
        "machine": machine(),
    }
    times = {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "jobs": jobs,
        "peak_memory_mb": peak_memory_mb(),
        "seconds": {
            "scan": gathered.seconds,
            **(seconds or {}),
            "update_per_reading": float(trials.update_s.mean()),
            "estimate_per_reading": float(trials.estimate_s.mean()),
            "propose_per_reading": float(trials.propose_s.mean()),
        },
    }
    return Run(
        config=config.model_dump(mode="json"),
        about=about,
        objects=objects,
        work=gathered.work | work | {"skipped": gathered.work["skipped"] | work["skipped"]},
        trials=trials,
        summary=summarise(trials, objects),
        times=times,
    )


def eq3_agreement(scan: Scan) -> float | None:
    """Tell which share of the taxels that eq. 3 decides it decides rightly; None for unknown shapes.

    The training readings are judged, each taxel by whether its centre lies on the letter.
    """
    from tactsim.bench.agreement import classifier_agreement
    from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify
    from tactsim.models import letter, names

    if not set(scan.letters) <= set(names()):
        return None
    train = scan.where("train")
    kinds = classify(train.readings)
    agreement = classifier_agreement(
        train, kinds == CONTACT, kinds == NO_CONTACT, {label: letter(label) for label in train.letters}
    )
    return agreement.share if agreement.decided else None


def _protocol_name(config: RunConfig) -> str:
    """Name what may share a table: results of different protocols are never put side by side."""
    poses = "from a file" if config.scan_file else config.scan.test_poses
    order = "random order" if config.explore == "random" else "order chosen by information"
    held_out = f", {' '.join(config.hold_out)} held out" if config.hold_out else ""
    return f"test poses {poses}, {order}{held_out}"
