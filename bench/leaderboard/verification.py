"""Do some trials of a bundle again, chosen so that its author could not know which, and compare them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tactsim.bench import experiment
from tactsim.bench.bound.efficiency import bounds_of_trials
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.experiment import Gathered
from tactsim.bench.leaderboard.bundle import DONE, Bundle
from tactsim.bench.leaderboard.comparison import alike, first_difference, improbable, rows
from tactsim.bench.leaderboard.confined import Confined, Limits, NoScore
from tactsim.bench.leaderboard.confined_trials import confined_processes, run_trials_confined
from tactsim.bench.leaderboard.fresh import compare_fresh, fresh_config
from tactsim.bench.leaderboard.submission import Method, package_of, source_of, stated
from tactsim.bench.machine import machine, versions
from tactsim.bench.placement import Properties, properties
from tactsim.bench.results import Run
from tactsim.bench.tasks import Task, names
from tactsim.bench.tasks.data import check_data
from tactsim.bench.trials import OneTrial, Progress, Trials, run_trials
from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.estimators import NONE, Estimate, Estimator, Options
from tactsim.estimators import names as estimators
from tactsim.estimators.estimator import about_estimator

SHARE = 0.05
LEAST = 20  # trials: with fewer the bound could not refuse anything, with 13 only the worst
_SAME = 1e-6  # mm, rad: what the task itself says of a trial is worked out anew, perhaps by another library
_NOT_COMPARED = ("estimator", "bins", "particles", "set", "explore", "task", "bound")


@dataclass(frozen=True)
class Verdict:
    """Whether a bundle was confirmed.

    exact: whether all trials that were done again are the same to the bit. said: in one line what was found. again,
    trials: how many trials were done again, of how many. notes: what differs between there and here.
    """

    verified: bool
    exact: bool
    said: str
    again: int
    trials: int
    notes: tuple[str, ...] = ()


def verify(
    bundle: Bundle,
    *,
    share: float = SHARE,
    full: bool = False,
    fresh: bool = False,
    rng: np.random.Generator,
    jobs: int = 1,
    cache: bool = True,
    limits: Limits | None = None,
    progress: Progress = experiment.silent,
) -> Verdict:
    """Check that a bundle's runs are those that its task asks for, and do a share of the trials again.

    share: of the trials, at least LEAST of them. full: do all. fresh: also do a run that nobody could have prepared
    for, see `fresh`; its seed comes from `rng`. rng: chooses the trials; an author must not be able to
    guess it. The estimator runs in a process of its own, also a built-in one. Trials must be the same to the bit. Only
    of a method that is not reproducible, or of another machine, they are compared within the bound of `improbable`.

    Raises InputError if the task, its data or the estimator are not those of this installation.
    """
    asked = _task_of(bundle)
    method = Method(bundle.estimator, bundle.options)
    if method.estimator not in estimators():
        package = f"; install {bundle.package}" if bundle.package else ""
        raise InputError(f"the estimator {short(method.estimator)} is not installed here{package}")
    notes = _notes(bundle, method, asked)
    count = len(bundle.trials.truth) if bundle.runs else 0

    def refused(said: str, again: int = 0) -> Verdict:
        return Verdict(False, False, said, again, count, notes)

    if bundle.status != DONE:
        return refused(f"it has no score that could be checked: {bundle.status}")
    if tuple(run.seed for run in bundle.runs) != tuple(sorted(asked.seeds)):
        return refused(f"task {asked.name} asks for the seeds {', '.join(map(str, asked.seeds))}")
    check_data(asked, jobs=jobs, cache=cache)
    configs = {run.seed: _config(asked, method, run) for run in bundle.runs}
    gathered = {seed: _gathered(config, jobs, cache) for seed, config in configs.items()}
    for run in bundle.runs:
        fault = _fault(run, configs[run.seed], gathered[run.seed])
        if fault is not None:
            return refused(f"seed {run.seed}: {fault}")

    chosen = np.arange(count)
    if not full:
        chosen = np.sort(rng.choice(count, min(count, max(math.ceil(share * count), LEAST)), replace=False))
    wanted = [bundle.ids[n] for n in chosen]
    of_fresh = fresh_config(asked, bundle, rng) if fresh else None
    worse, said_of_fresh = False, ""
    try:
        with confined_processes(method.estimator, method.options, jobs, limits) as processes:
            parts = list(_again(bundle, wanted, configs, gathered, processes, rng, progress))
            if of_fresh is not None:
                worse, said_of_fresh = compare_fresh(
                    bundle, of_fresh, processes, rng=rng, jobs=jobs, progress=progress
                )
    except NoScore as error:
        return refused(f"done again it has no score: {error.status}", len(wanted))
    except _OtherOptions as error:
        return refused(str(error), len(wanted))
    verified, exact, said = _compared(bundle, chosen, Trials.joined(parts), method, asked, rng)
    if verified and worse:
        said = f"it is better than the method is where nobody could have prepared for it: {said_of_fresh}"
    elif verified and said_of_fresh:
        said += f"; {said_of_fresh}"
    return Verdict(verified and not worse, exact, said, len(wanted), count, notes)


class _OtherOptions(Exception):
    """A method is set up in another way than its bundle says."""


def _again(
    bundle: Bundle,
    wanted: Sequence[tuple[int, str, int]],
    configs: Mapping[int, RunConfig],
    gathered: Mapping[int, Gathered],
    processes: Sequence[Confined],
    rng: np.random.Generator,
    progress: Progress,
) -> Iterator[Trials]:
    """Do the wanted trials again, seed after seed."""
    done = 0

    def report(stage: str, at: int, total: int) -> None:
        progress("sweep", done + at, len(wanted))

    for run in bundle.runs:
        tasks = [OneTrial(letter, trial) for seed, letter, trial in wanted if seed == run.seed]
        said = _differing_options(run, processes[0])
        if said is not None:
            raise _OtherOptions(f"seed {run.seed}: {said}")
        if tasks:
            plan = experiment.plan_of(configs[run.seed], gathered[run.seed].scan)
            yield run_trials_confined(plan, tasks, processes, rng=rng, progress=report)[0]
            done += len(tasks)


def _compared(
    bundle: Bundle, chosen: np.ndarray, again: Trials, method: Method, asked: Task, rng: np.random.Generator
) -> tuple[bool, bool, str]:
    trials = rows(bundle.trials, chosen)
    seeds = [bundle.ids[n][0] for n in chosen]
    same = alike(trials, again)
    if same.all():
        return True, True, f"all {len(same)} trials that were done again are the same to the bit"
    excuses = _excuses(bundle)
    if not excuses:
        said = str(first_difference(trials, again, seeds))
        if bundle.source_hash != source_of(method):
            said += f"; the code here is not that of the bundle, which was made at commit {bundle.commit or 'unknown'}"
        return False, False, said
    objects = {run.seed: run.objects for run in bundle.runs}
    fault = improbable(trials, again, seeds, objects, rng)
    if fault is not None:
        return False, False, fault
    return (
        True,
        False,
        (
            f"{np.count_nonzero(same)} of {len(same)} trials that were done again are the same to the bit, and all "
            f"together are within what chance allows; that is all one can ask, because {' and '.join(excuses)}"
        ),
    )


def _task_of(bundle: Bundle) -> Task:
    # A name from somebody else's file must not lead to another place of this machine.
    beside = Path(bundle.task).name == bundle.task and Path(bundle.task).is_file()
    if bundle.task not in names() and not beside:
        raise InputError(
            f"it is of the task {short(bundle.task)}, which this version of tactsim does not have; it has "
            f"{', '.join(names())}, and a task of one's own is a file in the folder where one is"
        )
    asked, data = stated(bundle.task)
    if data != bundle.task_data:
        raise InputError(
            f"it is of another version of the task {asked.name}: its data have the hash {bundle.task_data[:12]}..., "
            f"here {data[:12]}...; use the version of tactsim that made it, {bundle.versions.get('tactsim', 'unknown')}"
        )
    return asked


def _config(asked: Task, method: Method, run: Run) -> RunConfig:
    """Say what a run should have been; where touches are chosen, whether they were is the method's affair."""
    words = {"estimator": method.estimator, "set": dict(method.options), "task": asked.name, "seed": run.seed}
    if asked.words.get("explore") == "information":
        words["explore"] = "blind" if run.config.get("explore") == "blind" else "information"
    return run_config(**words)


def _gathered(config: RunConfig, jobs: int, cache: bool) -> Gathered:
    return experiment.gather(config, jobs=jobs, cache=cache, progress=experiment.silent)


def _fault(run: Run, config: RunConfig, gathered: Gathered) -> str | None:
    """Find what of a run is not what its task gives to every method, whatever the method answers."""
    for name, value in config.model_dump(mode="json").items():
        if name not in _NOT_COMPARED and run.config.get(name, value) != value:
            return f"the task says {name} {short(value)}, and the run {short(run.config[name])}"
    if run.config.get("explore") != config.explore:
        return f"the task says explore {config.explore}, and the run {short(run.config.get('explore'))}"
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(config.trials)]
    done = list(zip(run.trials.truth.tolist(), run.trials.trial.tolist(), strict=True))
    if done != [(task.truth, task.trial) for task in tasks] or run.readings != config.readings:
        return "its trials are not those of the task: some are missing, or there are more"
    plan = experiment.plan_of(config, gathered.scan, _Nobody(Options()))
    recorded = plan.press is None
    # What is pressed on demand need not be pressed: where the object is does not depend on it.
    plan = replace(plan, press=None, explore="random")
    given, _ = run_trials(plan, _Nobody(Options()), tasks, progress=experiment.silent)
    if not _close(given.true_pose, run.trials.true_pose):
        return "an object lies elsewhere than the task puts it (true_x, true_y, true_theta)"
    if recorded and config.explore == "random" and not np.array_equal(given.reading, run.trials.reading):
        return "a trial has other readings than the task gives it, or in another order"
    if not _alike_objects(run.objects, properties(gathered.scan)):
        return "what it says of the objects (symmetry, centre, inertia) is not what the task says"
    if run.bounds is not None:
        bounds, _ = bounds_of_trials(
            gathered.scan, run.trials, config.explore, config.moving,
            sequences=config.sequences, cache=gathered.cache,
        )  # fmt: skip
        if bounds is None or not np.allclose(bounds, run.bounds, rtol=1e-3):
            return "its bounds of the error (bounds.csv) are not those of the task"
    return None


def _alike_objects(one: Mapping[str, Properties], other: Mapping[str, Properties]) -> bool:
    def numbers(of: Properties) -> list[float]:
        return [of.symmetry, *of.centre, of.inertia_over_mass]

    return one.keys() == other.keys() and all(
        _close(numbers(of), numbers(other[letter])) for letter, of in one.items()
    )


def _differing_options(run: Run, estimator: Estimator) -> str | None:
    """Compare how a method says that it is set up with what the run says; another version may have other options."""
    for name, value in about_estimator(estimator)["options"].items():
        if run.about["options"].get(name, value) != value:
            return (
                f"option {name} is said to be {short(run.about['options'][name])}, and it is {short(value)}"
            )
    budget = about_estimator(estimator)["budget"]
    if run.about["budget"] != budget:
        return f"the budget is said to be {short(run.about['budget'])}, and it is {short(budget)}"
    return None


def _excuses(bundle: Bundle) -> list[str]:
    """Say why an honest bundle might differ in the last bits; nothing if it must not."""
    found = []
    if not bundle.reproducible:
        found.append("its author says that the method is not reproducible")
    if _place(bundle.machine) != _place(machine()):
        found.append(
            f"it was made on another machine ({bundle.machine['processor']}, {bundle.machine['system']})"
        )
    here = versions()
    for name, version in bundle.versions.items():
        if name != "tactsim" and here.get(name, version) != version:
            found.append(f"it was made with {name} {version}, and here is {here[name]}")
    return found


def _place(of: Mapping[str, object]) -> tuple[str, str, str]:
    """Name what the last bits depend on: processor, operating system, architecture; not the system's release."""
    system = str(of["system"]).split()
    return str(of["processor"]), system[0], system[-1]


def _notes(bundle: Bundle, method: Method, asked: Task) -> tuple[str, ...]:
    notes = [one for one in _excuses(bundle) if bundle.reproducible or "author" not in one]
    made_by, here = bundle.versions.get("tactsim"), versions()["tactsim"]
    if made_by != here:
        notes.append(f"it was made by tactsim {made_by or 'of an unknown version'}, and here is {here}")
    if bundle.source_hash != source_of(method):
        notes.append(
            "the code that its trials depend on is not the code here"
            + (f"; it was made at commit {bundle.commit}" if bundle.commit else "")
        )
    package = package_of(method)
    if bundle.package != package:
        notes.append(
            f"the estimator came in {bundle.package or 'tactsim'}, and here in {package or 'tactsim'}"
        )
    return tuple(notes)


def _close(one: ArrayLike, other: ArrayLike) -> bool:
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=_SAME, atol=_SAME)


class _Nobody(Estimator):
    """Answer nothing in particular: what a trial is does not depend on the answers."""

    def fit(self, scan: Scan) -> None:
        """Learn nothing."""

    def without(self, letter: str, scan: Scan) -> Estimator:
        """Give this one, which knows no letter."""
        return self

    def reset(self, rng: np.random.Generator) -> None:
        """Forget nothing."""

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in nothing."""

    def estimate(self) -> Estimate:
        """Say that it is none of the letters."""
        return Estimate(NONE, {NONE: 1.0}, np.zeros(3))
