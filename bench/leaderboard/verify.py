"""Do some trials of a bundle again, chosen so that its author could not know which, and compare both as two runs.

With the same code, versions and processor they must be the same in all that a bundle keeps. Else, and where the author
says that the method is not reproducible, they must not be worse beyond chance (`bench compare`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from tactsim.bench import experiment
from tactsim.bench.compare import compare
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.leaderboard.bundle import DONE, Bundle, Machine, kept, select
from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs
from tactsim.bench.leaderboard.submit import Method, package_of, source_of, stated
from tactsim.bench.machine import machine, versions
from tactsim.bench.placement import Properties
from tactsim.bench.results import Run
from tactsim.bench.runs.saved import LATER
from tactsim.bench.score import errors
from tactsim.bench.tasks import Task, names
from tactsim.bench.tasks.data import check_data
from tactsim.bench.trials import Progress, Trials
from tactsim.core import InputError
from tactsim.core.errors import short
from tactsim.estimators import names as estimators

SHARE = 0.05
LEAST = 20  # trials
CHANCE = 0.001  # how often an honest bundle is refused for a difference that is one of chance
_FRESH_SEEDS = 2**62
_BOUNDS_ALIKE = 0.02  # relative: a bound is kept with 7 binary digits
_MOST_BOUNDS = 0.95  # of them must be alike: that of a pose which is hardly determined is ill-conditioned
_NOT_COMPARED = ("estimator", "bins", "particles", "set", "explore", "task", "bound")


@dataclass(frozen=True)
class Verdict:
    """Whether a bundle was confirmed.

    said: in one line what was found. again, trials: how many trials were done again, of how many. other_code: whether
    the code here is not that of the bundle, so that one that is not confirmed is not refuted either. notes: what
    differs between there and here.
    """

    verified: bool
    said: str
    again: int
    trials: int
    other_code: bool
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
    for, see `_fresh_words`; its seed comes from `rng`. rng: chooses the trials; an author must not be able to guess it.
    The trials are done in a process of their own.

    Raises InputError if the task, its data or the estimator are not those of this installation.
    """
    asked = _task_of(bundle)
    method = Method(bundle.estimator, bundle.options)
    if method.estimator not in estimators():
        package = f"; install {bundle.package}" if bundle.package else ""
        raise InputError(f"the estimator {short(method.estimator)} is not installed here{package}")
    other_code = bundle.source_hash != source_of(method)
    excuses = _excuses(bundle, method, other_code)
    count = sum(len(run.trials.truth) for run in bundle.runs)

    def judged(verified: bool, said: str, again: int = 0) -> Verdict:
        return Verdict(verified, said, again, count, other_code, tuple(excuses))

    if bundle.status != DONE:
        return judged(False, f"it has no score that could be checked: {bundle.status}")
    if tuple(run.seed for run in bundle.runs) != tuple(sorted(asked.seeds)):
        return judged(False, f"task {asked.name} asks for the seeds {', '.join(map(str, asked.seeds))}")
    check_data(asked, jobs=jobs, cache=cache)
    words = [_words(asked, method, run) for run in bundle.runs]
    for run, of_run in zip(bundle.runs, words, strict=True):
        if (fault := _asked_otherwise(run, run_config(**of_run), jobs, cache)) is not None:
            return judged(False, f"seed {run.seed}: {fault}")

    chosen = np.ones(count, dtype=bool)
    if not full:
        chosen[:] = False
        chosen[rng.choice(count, min(count, max(math.ceil(share * count), LEAST)), replace=False)] = True
    runs, wanted = [], []
    for run, of_run in zip(bundle.runs, words, strict=True):
        mine, chosen = chosen[: len(run.trials.truth)], chosen[len(run.trials.truth) :]
        if mine.any():
            part = select(run.trials, mine)
            runs.append(replace(run, trials=part, bounds=None if run.bounds is None else run.bounds[mine]))
            wanted.append(Wanted({**of_run, "bound": run.bounds is not None}, part.ids))
    if fresh:
        wanted.append(Wanted(_fresh_words(asked, bundle, rng)))
    again = sum(len(run.trials.truth) for run in runs)
    try:
        done = limited_runs(wanted, jobs=jobs, cache=cache, limits=limits, progress=progress)
    except NoScore as error:
        return judged(False, f"done again it has no score: {error.status}", again)
    of_fresh = done.pop() if fresh else None
    verified, said = compared(runs, kept(done), excuses)
    if verified and of_fresh is not None:
        worse, found = _worse_when_fresh(bundle.runs, of_fresh)
        verified = not worse
        better = f"it is better than the method is where nobody could have prepared for it: {found}"
        said = better if worse else f"{said}; {found}"
    return judged(verified, said, again)


def compared(runs: Sequence[Run], again: Sequence[Run], excuses: Sequence[str]) -> tuple[bool, str]:
    """Compare runs with the same runs done again, seed by seed: whether they pass, and in one line what was found.

    excuses: why honest ones might differ in the last bits; nothing if they must not.
    """
    for run, other in zip(runs, again, strict=True):
        if (fault := _set_up_otherwise(run, other)) is not None:
            return False, f"seed {run.seed}: {fault}"
    pairs = zip(runs, again, strict=True)
    same = np.concatenate([np.all([*_alike(a.trials, b.trials).values()], axis=0) for a, b in pairs])
    if same.all():
        return True, f"all {len(same)} trials that were done again are the same in all that a bundle keeps"
    if not excuses:
        return False, _first_difference(runs, again)
    base, new = (replace(of[0], trials=Trials.joined(run.trials for run in of)) for of in (runs, again))
    # Where objects lie was compared above.
    new = replace(new, trials=replace(new.trials, true_pose=base.trials.true_pose))
    worse = [row for row in compare(base, new, level=1 - CHANCE) if row.verdict == "worse"]
    found = f"{same.sum()} of {len(same)} trials that were done again are the same in all that a bundle keeps"
    if worse:
        said = f"{worse[0].name} is {worse[0].base:.4g} in the bundle and {worse[0].new:.4g} when it is done again"
        return False, f"{said}, beyond chance; {found}; {' and '.join(excuses)}"
    return True, f"{found}, and all together are within what chance allows, because {' and '.join(excuses)}"


def _alike(one: Trials, other: Trials) -> dict[str, NDArray[np.bool_]]:
    """Tell by column which of n trials are the same (n,): neither times nor what an earlier version did not note."""
    found = {}
    for name in (of.name for of in fields(one) if not of.name.endswith("_s")):
        a, b = (getattr(of, name).reshape(len(one.truth), -1) for of in (one, other))
        if name not in LATER or not np.isnan(a).all():
            found[name] = ((a == b) | ((a != a) & (b != b))).all(axis=1)  # NaN is as NaN
    return found


def _first_difference(runs: Sequence[Run], again: Sequence[Run]) -> str:
    """Name the first trial, and its first column, that differ."""
    for run, other in zip(runs, again, strict=True):
        alike = _alike(run.trials, other.trials)
        for n, (letter, number) in enumerate(run.trials.ids):
            for name in (name for name, same in alike.items() if not same[n]):
                of_trial = f"seed {run.seed}, letter {letter}, trial {number}"
                return f"{of_trial}: {name} is not what it is in the bundle when it is done again"
    raise AssertionError("nothing differs")


def _set_up_otherwise(run: Run, again: Run) -> str | None:
    """Find what of a run is not what it is when it is done again, whatever the method answers."""
    for name in ("options", "budget"):
        if run.about[name] != again.about[name]:
            return f"the {name} are said to be {short(run.about[name])}, and are {short(again.about[name])}"
    steps = np.abs(run.trials.true_pose - again.trials.true_pose)
    if not (steps <= 0.005).all():  # a step more or less
        return "an object lies elsewhere than the task puts it (true_x, true_y, true_theta)"
    if not _alike_objects(run.objects, again.objects):
        return "what it says of the objects (symmetry, centre, inertia) is not what the task says"
    if run.bounds is not None and (
        again.bounds is None or np.isclose(run.bounds, again.bounds, rtol=_BOUNDS_ALIKE).mean() < _MOST_BOUNDS
    ):
        return "its bounds of the error are not those of the task"
    return None


def _alike_objects(one: dict[str, Properties], other: dict[str, Properties]) -> bool:
    def numbers(of: Properties) -> list[float]:
        return [of.symmetry, *of.centre, of.inertia_over_mass]

    # The task works them out anew, perhaps with another library.
    return one.keys() == other.keys() and all(
        np.allclose(numbers(of), numbers(other[letter]), rtol=1e-6, atol=1e-6) for letter, of in one.items()
    )


def _words(asked: Task, method: Method, run: Run) -> dict[str, Any]:
    """Say what a run should have been; where touches are chosen, whether they were is the method's affair."""
    words = {"estimator": method.estimator, "set": dict(method.options), "task": asked.name, "seed": run.seed}
    if asked.chosen:
        words["explore"] = "blind" if run.config.get("explore") == "blind" else "information"
    return words


def _asked_otherwise(run: Run, config: RunConfig, jobs: int, cache: bool) -> str | None:
    """Find what of a run's configuration and trials is not what its task asks of every method."""
    for name, value in config.model_dump(mode="json").items():
        if name not in _NOT_COMPARED and run.config.get(name, value) != value:
            return f"the task says {name} {short(value)}, and the run {short(run.config[name])}"
    if run.config.get("explore") != config.explore:
        return f"the task says explore {config.explore}, and the run {short(run.config.get('explore'))}"
    gathered = experiment.gather(config, jobs=jobs, cache=cache)
    if run.trials.ids != [(task.truth, task.trial) for task in run.kind.tasks(config, gathered)]:
        return "its trials are not those of the task: some are missing, or there are more"
    return None if run.readings == config.readings else f"its trials are not of {config.readings} readings"


def _fresh_words(asked: Task, bundle: Bundle, rng: np.random.Generator) -> dict[str, Any]:
    """Ask for one more run of a task, with a seed that `rng` draws: a new scan, new places, a new order.

    The seeds of a task are public, and so is all that follows from them: a package that has the answers in it is
    verified to the last bit. On a fresh seed it knows no more than others. Raises InputError if readings are recorded.
    """
    words = {**asked.words, "trials": asked.trials, "readings": asked.readings}
    words |= {"estimator": bundle.estimator, "set": bundle.options, "seed": int(rng.integers(_FRESH_SEEDS))}
    if asked.chosen:
        words["explore"] = bundle.runs[0].config["explore"]
    if not run_config(**words).pressed:
        raise InputError(f"task {asked.name} has recorded readings; there are no fresh ones to press")
    return words


def _worse_when_fresh(runs: Sequence[Run], fresh: Run) -> tuple[bool, str]:
    """Tell whether runs are better than a fresh one, beyond chance, and in one line what was found.

    Compared are the share of right labels and the placement error, each averaged over a run: the fresh one is one more
    draw of what a run gives, if all is well (a prediction interval, Student 1908, one-sided at CHANCE / 2 each). The
    spread of the runs is at least what the number of trials alone would make it.
    """
    said, worse = [], False
    for what, sign, of in (
        ("right labels", 1, lambda run: run.trials.right.mean(axis=1)),
        ("error in mm", -1, lambda run: errors(run.trials, run.objects).mean(axis=1)[run.trials.known]),
    ):
        values, found = [of(run) for run in runs], of(fresh)
        if not (len(found) and all(map(len, values))):
            continue
        means, each = np.array([one.mean() for one in values]), np.concatenate(values)
        spread = each.var()
        if sign > 0:  # where all are right, the spread says nothing of the next
            p = (each.sum() + 1) / (len(each) + 2)
            spread = max(spread, p * (1 - p))
        deviation = math.sqrt(max(means.var(ddof=1), spread / len(found)) * (1 + 1 / len(means)))
        allowed = float(student_t.isf(CHANCE / 2, len(means) - 1)) * deviation
        worse = worse or sign * (means.mean() - found.mean()) > allowed
        said.append(f"{what} {found.mean():.4g} on a fresh scan and {means.mean():.4g} in the bundle")
    return worse, "; ".join(said)


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


def _excuses(bundle: Bundle, method: Method, other_code: bool) -> list[str]:
    """Say why an honest bundle might differ in the last bits; nothing if it must not."""
    found = []
    if not bundle.reproducible:
        found.append("its author says that the method is not reproducible")
    there = bundle.machine
    if _place(there) != _place(Machine.model_validate(machine())):
        found.append(f"it was made on another machine ({there.processor}, {there.system})")
    here = versions()
    for name, version in bundle.versions.items():
        if here.get(name, version) != version:
            found.append(f"it was made with {name} {version}, and here is {here[name]}")
    if bundle.package != (package := package_of(method)):
        found.append(f"the estimator came in {bundle.package or 'tactsim'}, here in {package or 'tactsim'}")
    if other_code:
        at = f", which was made at commit {bundle.commit}" if bundle.commit else ""
        found.append(f"the code here is not that of the bundle{at}")
    return found


def _place(of: Machine) -> tuple[str, str, str]:
    """Name what the last bits depend on: processor, operating system, architecture; not the system's release."""
    system = of.system.split()
    return of.processor, system[0], system[-1]
