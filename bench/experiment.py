"""An experiment, from top to bottom: readings, fit, trials, and the `Run` of what came out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tactsim.bench.config import RunConfig, chosen_letters
from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.placement import Placement, load_scan, poses_unknown, properties, stated_properties
from tactsim.bench.results import Run
from tactsim.bench.runs.scan_quality import eq3_agreement, notes_on
from tactsim.bench.trials import (
    OneTrial,
    Press,
    Progress,
    TrialPlan,
    Trials,
    check_count,
    check_labels,
    check_readings,
    fit,
    received_trials,
    run_trials,
    send_trials,
    silent,
    source_of_trials,
)
from tactsim.core import InputError, Scan
from tactsim.core.errors import unknown
from tactsim.core.origins import object_origin, seen_from
from tactsim.core.poses import FloatArray
from tactsim.core.scan import train_on
from tactsim.core.seeds import stream
from tactsim.core.source_digest import git_commit
from tactsim.core.workers import worker_processes
from tactsim.estimators import Estimator, Options, create
from tactsim.estimators.estimator import about_estimator, name_of, proposes_none
from tactsim.estimators.likelihoods.occupancy import maps_of
from tactsim.estimators.options import FilterOptions, wants_pad_fit
from tactsim.estimators.registry import load
from tactsim.press import forward_model, scan_letters
from tactsim.press.scan_poses import PAPER, stage_for
from tactsim.press.scanning import letters_of

if TYPE_CHECKING:
    from tactsim.estimators.pad_fit import PadFit
    from tactsim.solids.config import SpaceConfig

Config: TypeAlias = "RunConfig | SpaceConfig"

PARTS = 8  # of the trials, for each process: none waits long for the last of another
NO_BOUND = "it was not asked for; `bench run --bound` works it out"


@dataclass(frozen=True, eq=False)
class Gathered:
    """The readings of a run, which letters are tried, and what it took to get them.

    objects: what the error needs of each, which does not depend on how much of the readings is trained on.
    """

    scan: Scan
    letters: tuple[str, ...]
    work: dict[str, Any]
    seconds: float
    objects: Mapping[str, Any]


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
    """Press or load the readings, fit the estimator, do all trials and score them, in the plane or in space.

    scan: the readings that `config.given` names. estimator: replaces the one that `config` names. trials: those to do;
    by default `config.trials` of each letter. jobs: processes. cache: whether pressed readings may be read from the
    cache and kept there. progress(stage, done, total) is called for the stages "press", "map" and "trials".

    Raises InputError for a configuration that does not fit together.
    """
    start = perf_counter()
    if estimator is not None:
        config = _with_estimator(config, estimator)
    fitted = estimator_of(config, estimator)  # a wrong option is reported before the work
    about = about_estimator(fitted)  # before it is fitted, as a run of a sweep says it
    gathered = gather(config, scan=scan, jobs=jobs, cache=cache, progress=progress)
    if isinstance(config, RunConfig):
        check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)
    plan = plan_of(config, gathered.scan, estimator, gathered.objects)
    tasks = trials or tasks_of(config, gathered.letters)

    fitting = perf_counter()
    with nullcontext() if jobs == 1 else worker_processes(min(jobs, len(tasks))) as executor:
        # Workers fit while this process does: its estimator's maps are shown, and with one job it does the trials.
        sent = None if executor is None else send_trials(executor, plan, tasks, PARTS * jobs)
        progress("map", 0, 1)
        fit(fitted, gathered.scan, forward_model)
        progress("map", 1, 1)
        trying = perf_counter()
        if sent is None:
            done, work = run_trials(plan, fitted, tasks, progress=progress)
        else:
            done, work = received_trials(sent, progress)
    tried = perf_counter()
    seconds = {"fit": trying - fitting, "trials": tried - trying, "total": tried - start}
    source = None if estimator is None else source_of_trials(estimator)
    run = finished_run(
        config, gathered, done, work, fitted, about=about, source=source, seconds=seconds, jobs=jobs
    )
    if not fitted.in_space:
        return replace(run, plan=plan, maps=maps_of(fitted))
    from tactsim.solids.field import surfaces_of

    return replace(run, plan=plan, maps=surfaces_of(fitted))


def estimator_of(config: Config, estimator: Estimator | None = None) -> Estimator:
    """Create the estimator that a configuration names, or take `estimator`, which `_with_estimator` has named in it.

    Raises InputError, which says whose an option is, and for an estimator that is not for such runs, or cannot choose
    touches and should.
    """
    for name, usual in (("bins", "histogram"), ("particles", "particle")):
        given = getattr(config, name, None) is not None
        if given and name not in load(config.estimator).options_type.model_fields:
            raise InputError(
                f"--{name} (in Python {name}): estimator {config.estimator} has none; leave it out, or add --estimator "
                f"{usual}"
            )
    if estimator is None:
        estimator = create(config.estimator, **config.options)
    in_space = not isinstance(config, RunConfig)
    if estimator.in_space and not in_space:
        raise InputError(f"estimator {config.estimator} recognises objects in space; add --task solids")
    if in_space and not estimator.in_space:
        raise InputError(
            f"estimator {config.estimator} recognises objects in the plane; `bench list` names those for --task solids"
        )
    if config.explore == "information" and not estimator.proposes:
        raise proposes_none(config.estimator)
    return estimator


def tasks_of(config: Config, letters: Sequence[str]) -> list[OneTrial]:
    """List the trials of a run, letter after letter; in space the objects share `trials`, and take turns."""
    count = {
        letter: config.trials
        if isinstance(config, RunConfig)
        else (config.trials - place + len(letters) - 1) // len(letters)
        for place, letter in enumerate(letters)
    }
    return [OneTrial(letter, trial) for letter in letters for trial in range(count[letter])]


def check_presses(config: Config) -> None:
    """Raise InputError before the presses for letters to hold out that are not pressed, and for too many readings.

    Readings that are not pressed are left to `check_readings`, once they are loaded.
    """
    if not (isinstance(config, RunConfig) and config.pressed):
        return
    letters = letters_of(config.scan_options)
    _held_out(config, [letter.name for letter in letters])
    for letter in letters if config.readings > PAPER.poses else ():
        stage = PAPER if config.on_demand else stage_for(config.scan_options.pad, letter)
        check_count(letter.name, stage.poses, config.readings)


def _with_estimator(config: Config, estimator: Estimator) -> Config:
    """Name an estimator, by its class if it is not registered, and its options. Raises InputError if it has none."""
    kind = type(estimator)
    name = name_of(estimator)
    if not isinstance(getattr(estimator, "options", None), Options):
        raise InputError(
            f"the estimator {name} has no options; its __init__ must call super().__init__(options)"
        )
    if config.options:
        raise InputError(f"the estimator {name} was given with its options; leave out bins, particles, set")
    options = estimator.options.model_dump(mode="json", exclude_defaults=True)
    name = estimator.created_as or f"{kind.__module__}:{kind.__qualname__}"
    return config.model_copy(update={"estimator": name, "set": options})


def gather(
    config: Config, *, scan: Scan | None = None, jobs: int, cache: bool, progress: Progress
) -> Gathered:
    """Get the readings of a run: those given as `scan`, from the press or from files.

    Poses are seen from the centre of the training poses, if that is not the origin already; `meta` of the scan says so.
    Raises InputError if a named letter is not among the readings, a letter is called NONE or two files do
    not fit together.
    """
    if not isinstance(config, RunConfig):
        from tactsim.solids.runner import gather_in_space  # runs in the plane do without its room

        return gather_in_space(config, progress=progress)
    start = perf_counter()
    work: dict[str, Any] = {"presses": 0, "skipped": {}}
    train = None if config.train_scan is None else train_scan(config)  # before the presses
    if scan is not None:
        stated_properties(scan)
    elif config.scan is not None:
        scan = load_scan(config.scan, config.seed)
    elif config.presses is not None:
        from tactsim.bench.pad.measured import measured_scan

        assert train is not None  # as a configuration with presses has it
        letters = chosen_letters(config, train.letters)
        scan = measured_scan(config.presses, letters, config.trials, config.readings)
    else:
        check_presses(config)
        scan, work = scan_letters(
            config.scan_options,
            jobs=jobs,
            cache=cache,
            progress=lambda done, total: progress("press", done, total),
        )
    if train is not None:
        scan = train_on(train, scan)
    letters = chosen_letters(config, scan.letters)
    if not scan.letters:
        raise InputError(f"{config.scan or 'the scan'} holds no readings")
    if not letters:
        raise InputError(f"letters names none to try; the scan has {', '.join(scan.letters)}")
    check_labels(letters)
    known = letters
    if train is not None and config.letters is None:  # what is tested may be fewer than what is known
        letters = tuple(letter for letter in letters if len(scan.where("test", letter))) or letters
    scan = scan.of_letters(known)
    # T_R^O is drawn about 0: with 0 at the object the trials are the same, wherever poses have their origin.
    origin = object_origin(scan)
    objects = properties(seen_from(scan, origin))
    scan = scan.untrained(_held_out(config, letters))
    if config.train_presses is not None:
        scan = scan.with_train_presses(config.train_presses, stream(config.seed, "train_presses"))
    return Gathered(seen_from(scan, origin), letters, work, perf_counter() - start, objects)


def _held_out(config: RunConfig, letters: Sequence[str]) -> tuple[str, ...]:
    """Say which of the letters nothing is trained on in any trial. Raises InputError if they are not among them."""
    held_out = () if config.each_held_out else config.hold_out
    for letter in held_out:
        if letter not in letters and len(letter) > 1 and set(letter) <= set(letters):
            raise InputError(
                f"--hold-out (in Python hold_out) {letter}: several letters have commas between them: "
                f"{','.join(letter)}; one is left to train on"
            )
        if letter not in letters:
            raise unknown("letter to hold out", letter, letters)
    if set(letters) <= set(held_out) or (config.each_held_out and len(letters) == 1):
        raise InputError("--hold-out (in Python hold_out) names every letter; leave one to train on")
    return held_out


def train_scan(config: RunConfig) -> Scan:
    """Load the training readings that a run takes from a file of their own. Raises InputError if it has none."""
    if config.train_scan is None:
        raise InputError("a run on a pad's presses takes its training readings from --train-scan")
    return load_scan(config.train_scan)


def plan_of(
    config: Config, scan: Scan, given: Estimator | None = None, objects: Mapping[str, Placement] | None = None
) -> TrialPlan:
    """Put together what a worker needs to do this run's trials on these readings. objects: of `Gathered`."""
    if not isinstance(config, RunConfig):
        from tactsim.solids.touching import SolidPress

        press: Press | None = SolidPress(config.scan_options, config.hand)
        return TrialPlan(
            config.estimator, config.options, scan, config.readings, config.seed, config.explore, press=press,
            given=given, objects=objects,
        )  # fmt: skip
    press = None
    if config.on_demand:
        from tactsim.bench.on_demand import OnDemand  # brings MuJoCo, which most runs need not

        press = OnDemand(config.scan_options)
    return TrialPlan(
        config.estimator,
        config.options,
        scan,
        config.readings,
        config.seed,
        config.explore,
        config.moving,
        press,
        forward_model,
        given,
        config.each_held_out,
        config.presses is not None,
        objects,
    )


def finished_run(
    config: Config,
    gathered: Gathered,
    trials: Trials,
    work: dict[str, Any],
    estimator: Estimator,
    *,
    about: dict[str, Any] | None = None,
    source: str | None = None,
    seconds: dict[str, float] | None = None,
    jobs: int | None = None,
) -> Run:
    """Score the trials and build the `Run`.

    estimator: the one that did the trials, whose fit to the pad need not be found again, or one like it. about: what
    `about_estimator` said of it before it was fitted. source: see `source_of_trials`, of an estimator that is not the
    registered one. seconds: of the stages; a sweep, which does the trials of several runs at once, has none.
    """
    scan = gathered.scan
    about = dict(about or about_estimator(estimator))
    bounds = None
    if isinstance(config, RunConfig):
        said, bounds = _said_in_plane(config, gathered, trials, estimator)
        about |= said
    else:
        from tactsim.solids.runner import about_in_space

        about |= about_in_space(config, scan)
    about |= {
        "letters": list(gathered.letters),
        "scan": dict(scan.meta),
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
            "update_per_reading": float(trials.update_s.mean()),
            "update_p99": float(np.quantile(trials.update_s, 0.99)),
            "estimate_per_reading": float(trials.estimate_s.mean()),
            "propose_per_reading": float(trials.propose_s.mean()),
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
        shape_files=config.shapes if isinstance(config, RunConfig) else (),
    )


def _said_in_plane(
    config: RunConfig, gathered: Gathered, trials: Trials, estimator: Estimator
) -> tuple[dict[str, Any], FloatArray | None]:
    """Give what a run in the plane says of itself beside the rest, and the bounds of its trials (n, r) mm."""
    scan, options = gathered.scan, estimator.options
    said: dict[str, Any] = {}
    bounds, no_bound = None, NO_BOUND
    if config.bound:
        from tactsim.bench.bound.efficiency import bounds_of_trials

        bounds, no_bound = bounds_of_trials(scan, trials, config.explore, config.moving)
    if isinstance(options, FilterOptions) and hasattr(estimator, "pad_fit") and wants_pad_fit(options, scan):
        pad_fit: PadFit | None = estimator.pad_fit
        if pad_fit is None:  # a sweep's workers have fitted theirs
            from tactsim.estimators.pad_fit import fit_to_pad

            pad_fit = fit_to_pad(scan, options)
        options = pad_fit.outer(options)
        said = {"options": options.model_dump(mode="json"), "pad_fit": pad_fit.facts()}
    notes = notes_on(scan)
    said |= {
        "protocol": _protocol_name(config, scan),
        "slip": config.moving.describe(),
        "no_bound": no_bound,
        "classifier_agreement": eq3_agreement(scan, options),
        **({"notes": notes} if notes else {}),
    }
    return said, bounds


def _protocol_name(config: RunConfig, scan: Scan) -> str:
    """Name the protocol of a run; only results of one protocol share a table."""
    options = scan.meta.get("options")  # of the press, if the scan says them
    stated = options.get("test_poses") if isinstance(options, Mapping) else None
    where = (
        f"test poses {'from a file' if config.scan else stated if stated in ('same', 'random') else 'given'}"
    )
    if config.presses is not None:
        where = "presses on a pad"
    if poses_unknown(scan.meta):
        where = "one press a trial, poses unknown"
    order = "random order"
    if config.on_demand:
        where = "touches in the robot's frame"
    if config.explore == "information":
        # Recorded readings lie around the object: the poses to choose among tell where it is.
        order = "chosen by information" + (
            "" if config.on_demand else " among recorded poses, which tell the place"
        )
    held_out = f", {' '.join(config.hold_out)} held out" if config.hold_out else ""
    if config.each_held_out:
        held_out = ", each letter held out in turn"
    return f"{where}, {order}{held_out}"
