"""Do one run: press or load the readings, fit the estimator, do the trials, score them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from time import perf_counter
from typing import Any

from tactsim.bench.about_estimator import about_estimator
from tactsim.bench.agreement import eq3_agreement
from tactsim.bench.bound.efficiency import bounds_of_trials
from tactsim.bench.bound.scan_information import ScanInformation, scan_information
from tactsim.bench.config import RunConfig, chosen_letters
from tactsim.bench.copies import notes_on
from tactsim.bench.fitting import fit, pad_fit_of
from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.offered_touches import Press
from tactsim.bench.placement_error import load_scan, properties, stated_properties
from tactsim.bench.run import Run
from tactsim.bench.trial_plan import TrialPlan, source_of_trials
from tactsim.bench.trial_workers import begun_trials
from tactsim.bench.trials import OneTrial, Progress, Trials, check_count, check_labels, check_readings
from tactsim.core import InputError, Scan
from tactsim.core.errors import unknown
from tactsim.core.scan import train_on
from tactsim.core.source_digest import git_commit
from tactsim.estimators import Estimator, Options, create
from tactsim.estimators.estimator import name_of, proposes_none
from tactsim.estimators.likelihoods.occupancy import maps_of
from tactsim.estimators.options import FilterOptions
from tactsim.press import forward_model, scan_letters
from tactsim.press.scan_poses import PAPER, stage_for
from tactsim.press.scanning import letters_of


def silent(stage: str, done: int, total: int) -> None:
    """Report no progress."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """The readings of a run, which letters are tried, and what it took to get them.

    cache: whether what else is worked out from the readings may be read from the cache and kept there.
    """

    scan: Scan
    letters: tuple[str, ...]
    work: dict[str, Any]
    seconds: float
    cache: bool

    @cached_property
    def information(self) -> ScanInformation:
        """Work out what the test readings tell of the place, once for all runs that share the readings.

        Raises InputError as `scan_information` does.
        """
        return scan_information(self.scan, cache=self.cache)


def perform(
    config: RunConfig,
    *,
    scan: Scan | None = None,
    estimator: Estimator | None = None,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress = silent,
) -> Run:
    """Press or load the readings, fit the estimator, do all trials and score them.

    scan: the readings that `config.given` names. estimator: replaces the one that `config` names. jobs:
    processes. cache: whether pressed readings may be read from the cache and kept there. progress(stage, done,
    total) is called for the stages "press", "map" and "trials".

    Raises InputError for a configuration that does not fit together.
    """
    start = perf_counter()
    if estimator is None:
        fitted = create(config.estimator, **config.options)  # a wrong option is reported before the work
    else:
        config, fitted = _with_estimator(config, estimator), estimator
    check_estimator(config, fitted)
    gathered = gather(config, scan=scan, jobs=jobs, cache=cache, progress=progress)
    check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)
    plan = plan_of(config, gathered.scan, estimator)
    if jobs > 1:
        plan.portable()  # an estimator that cannot be sent to workers is reported before the work
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(config.trials)]

    fitting = perf_counter()
    progress("map", 0, 1)
    with begun_trials(plan, tasks, jobs=jobs) as finish:
        fit(fitted, gathered.scan, forward_model)
        progress("map", 1, 1)
        trying = perf_counter()
        trials, work = finish(fitted, progress)
    tried = perf_counter()
    seconds = {"fit": trying - fitting, "trials": tried - trying, "total": tried - start}
    run = finished_run(
        config, gathered, trials, work, estimator=estimator, seconds=seconds, jobs=jobs, fitted=fitted
    )
    return replace(run, plan=plan, maps=maps_of(fitted))


def check_estimator(config: RunConfig, estimator: Estimator) -> None:
    """Raise InputError for an estimator that is not for runs in the plane, or cannot choose touches and should."""
    if estimator.in_space:
        raise InputError(f"estimator {config.estimator} recognises objects in space; add --task solids")
    if config.explore == "information" and not estimator.proposes:
        raise proposes_none(config.estimator)


def check_presses(config: RunConfig) -> None:
    """Raise InputError before the presses for letters to hold out that are not pressed, and for too many readings.

    Readings that are not pressed are left to `check_readings`, once they are loaded.
    """
    if not config.pressed:
        return
    letters = letters_of(config.scan_options)
    _held_out(config, [letter.name for letter in letters])
    for letter in letters if config.readings > PAPER.poses else ():
        stage = PAPER if config.on_demand else stage_for(config.scan_options.pad, letter)
        check_count(letter.name, stage.poses, config.readings)


def _with_estimator(config: RunConfig, estimator: Estimator) -> RunConfig:
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
    config: RunConfig, *, scan: Scan | None = None, jobs: int, cache: bool, progress: Progress
) -> Gathered:
    """Get the readings of a run: those given as `scan`, from the press or from files.

    Raises InputError if a named letter is not among the readings, a letter is called NONE or two files do
    not fit together.
    """
    if config.sequences and (config.on_demand or config.presses is not None):
        raise InputError(
            "moments of touches are in the sequences of a scan's test readings; leave out moments, or explore "
            "at random on a scan"
        )
    start = perf_counter()
    work: dict[str, Any] = {"presses": 0, "skipped": {}}
    train = None if config.train_scan is None else train_scan(config)  # before the presses
    if scan is not None:
        stated_properties(scan)
    elif config.scan is not None:
        scan = load_scan(config.scan)
    elif config.presses is not None:
        from tactsim.bench.measured import measured_scan

        assert train is not None  # as a configuration with presses has it
        letters = chosen_letters(config, train.letters)
        scan = measured_scan(config.presses, letters, config.trials, config.readings)
    else:
        check_presses(config)
        scan, work = scan_letters(
            config.scan_options,
            jobs=jobs,
            cache=cache,
            sequence=config.sequences,
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
    scan = scan.of_letters(letters).untrained(_held_out(config, letters))
    return Gathered(scan, letters, work, perf_counter() - start, cache)


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


def plan_of(config: RunConfig, scan: Scan, given: Estimator | None = None) -> TrialPlan:
    """Put together what a worker needs to do this run's trials on these readings."""
    return TrialPlan(
        config.estimator,
        config.options,
        scan,
        config.readings,
        config.seed,
        config.explore,
        config.moving,
        _press(config, scan),
        forward_model,
        given,
        config.each_held_out,
    )


def _press(config: RunConfig, scan: Scan) -> Press | None:
    """Choose where touches come from that are not simply the scan's."""
    # Each is imported here: most runs take the scan's readings, and need neither a pad's files nor MuJoCo.
    if config.presses is not None:
        from tactsim.bench.measured import MeasuredTrials

        return MeasuredTrials(scan, config.readings)
    if config.on_demand:
        from tactsim.bench.touching import OnDemand

        return OnDemand(config.scan_options)
    return None


def finished_run(
    config: RunConfig,
    gathered: Gathered,
    trials: Trials,
    work: dict[str, Any],
    *,
    estimator: Estimator | None = None,
    seconds: dict[str, float] | None = None,
    jobs: int | None = None,
    fitted: Estimator | None = None,
) -> Run:
    """Score the trials and build the `Run`.

    estimator: the one that replaced the configuration's, if any. seconds: of the stages; a sweep, which does
    the trials of several runs at once, has none. fitted: the estimator that did the trials, if it is at hand; what it
    has fitted to the pad need not be found again.
    """
    objects = properties(gathered.scan)
    bounds, no_bound = None, "a bound is of one image of each touch, and the estimator saw several"
    if not config.sequences:
        bounds, no_bound = bounds_of_trials(
            gathered.scan, trials, config.explore, config.moving, lambda: gathered.information
        )
    made = estimator or create(config.estimator, **config.options)
    notes = notes_on(gathered.scan)
    found, used = pad_fit_of(fitted or made, gathered.scan), made.options
    if found is not None:
        assert isinstance(used, FilterOptions)  # others fit nothing to the pad
        used = found.outer(used)
    about: dict[str, Any] = {
        "protocol": _protocol_name(config, gathered.scan),
        "letters": list(gathered.letters),
        "slip": config.moving.describe(),
        "no_bound": no_bound,
        **about_estimator(made),
        **({} if found is None else {"options": used.model_dump(mode="json"), "pad_fit": found.facts()}),
        "classifier_agreement": eq3_agreement(gathered.scan, used),
        "scan": dict(gathered.scan.meta),
        "readings_digest": gathered.scan.digest,
        "versions": versions(),
        "source": source_of_trials(estimator or config.estimator),
        "commit": git_commit(),
        "machine": machine(),
        **({"notes": notes} if notes else {}),
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
        times=times,
        bounds=bounds,
    )


def _protocol_name(config: RunConfig, scan: Scan) -> str:
    """Name the protocol of a run; only results of one protocol share a table."""
    where = "test poses " + ("from a file" if config.scan else _stated_test_poses(scan) or "given")
    if config.presses is not None:
        where = "presses on a pad"
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


def _stated_test_poses(scan: Scan) -> str | None:
    """Tell where the simulated pad was pressed for the test readings; None if the scan does not say."""
    options = scan.meta.get("options")
    stated = options.get("test_poses") if isinstance(options, Mapping) else None
    return stated if stated in ("same", "random") else None
