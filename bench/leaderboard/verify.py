"""Do some trials of a bundle again, chosen so that its author could not know which, and compare them.

With the same code, versions and processor they must be the same to the bit. Else, and where the author says that the
method is not reproducible, they must be within the bound of `improbable`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from tactsim.bench import experiment
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.experiment import Gathered
from tactsim.bench.leaderboard.bundle import COMPARED, DONE, Bundle, kept, rounded, select
from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs
from tactsim.bench.leaderboard.submit import Method, package_of, source_of, stated
from tactsim.bench.machine import machine, versions
from tactsim.bench.placement import Properties
from tactsim.bench.results import Run
from tactsim.bench.score import errors
from tactsim.bench.tasks import Task, names
from tactsim.bench.tasks.data import Witness, check_data
from tactsim.bench.trials import Progress, Trials, run_trials
from tactsim.core import InputError
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray
from tactsim.estimators import names as estimators

SHARE = 0.05
LEAST = 20  # trials: with fewer the bound could not refuse anything, with 13 only the worst
CHANCE = 0.001  # how often an honest bundle is refused by the bound
DRAWS = 20_000
_FRESH_SEEDS = 2**62
_BOUNDS_ALIKE = 0.02  # relative: a bound is kept with 7 binary digits
_MOST_BOUNDS = (
    0.95  # of them must be alike elsewhere: that of a pose which is hardly determined is ill-conditioned
)
_NOT_COMPARED = ("estimator", "bins", "particles", "set", "explore", "task", "bound")


@dataclass(frozen=True)
class Verdict:
    """Whether a bundle was confirmed.

    exact: whether all trials that were done again are the same to the bit. said: in one line what was found. again,
    trials: how many trials were done again, of how many. other_code: whether the code here is not that of the bundle,
    so that one that is not confirmed is not refuted either. notes: what differs between there and here.
    """

    verified: bool
    exact: bool
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
    excuses = _excuses(bundle, other_code)
    notes = _notes(bundle, method, excuses)
    count = len(bundle.trials.truth) if bundle.runs else 0

    def refused(said: str, again: int = 0) -> Verdict:
        return Verdict(False, False, said, again, count, other_code, notes)

    if bundle.status != DONE:
        return refused(f"it has no score that could be checked: {bundle.status}")
    if tuple(run.seed for run in bundle.runs) != tuple(sorted(asked.seeds)):
        return refused(f"task {asked.name} asks for the seeds {', '.join(map(str, asked.seeds))}")
    check_data(asked, jobs=jobs, cache=cache)
    words = [_words(asked, method, run) for run in bundle.runs]
    for run, of_run in zip(bundle.runs, words, strict=True):
        config = run_config(**of_run)
        gathered = experiment.gather(config, jobs=jobs, cache=cache, progress=experiment.silent)
        if (fault := _fault(run, config, gathered)) is not None:
            return refused(f"seed {run.seed}: {fault}")

    chosen = np.arange(count)
    if not full:
        chosen = np.sort(rng.choice(count, min(count, max(math.ceil(share * count), LEAST)), replace=False))
    wanted, runs = [], []
    for run, of_run in zip(bundle.runs, words, strict=True):
        trials = [
            (letter, trial) for seed, letter, trial in map(bundle.ids.__getitem__, chosen) if seed == run.seed
        ]
        if trials:
            runs.append(run)
            wanted.append(Wanted({**of_run, "bound": run.bounds is not None}, trials))
    if fresh:
        wanted.append(Wanted(_fresh_words(asked, bundle, rng)))
    try:
        again = limited_runs(wanted, jobs=jobs, cache=cache, limits=limits, progress=progress)
    except NoScore as error:
        return refused(f"done again it has no score: {error.status}", len(chosen))
    of_fresh = again.pop() if fresh else None
    for run, other in zip(runs, again, strict=True):
        if (fault := _set_up_otherwise(run, other)) is not None:
            return refused(f"seed {run.seed}: {fault}", len(chosen))
    verified, exact, said = _compared(bundle, chosen, again, excuses, rng)
    if verified and of_fresh is not None:
        worse, found = _worse_when_fresh(bundle, of_fresh)
        verified = not worse
        said = (
            f"it is better than the method is where nobody could have prepared for it: {found}"
            if worse
            else f"{said}; {found}"
        )
    return Verdict(verified, exact, said, len(chosen), count, other_code, notes)


def _compared(
    bundle: Bundle, chosen: np.ndarray, again: Sequence[Run], excuses: Sequence[str], rng: np.random.Generator
) -> tuple[bool, bool, str]:
    """Compare the chosen trials with the same trials done again: whether they pass, whether to the bit, and why."""
    small, digests = kept(again)
    trials, other = select(bundle.trials, chosen), Trials.joined(run.trials for run in small)
    seeds = [bundle.ids[n][0] for n in chosen]
    difference = _first_difference(trials, other, seeds)
    same = bundle.digests[chosen] == digests
    bounds = bundle.pooled.bounds
    if bounds is not None and _share_of_bounds_alike(bounds[chosen], small) < (
        _MOST_BOUNDS if excuses else 1
    ):
        return False, False, "its bounds of the error are not those of the task"
    if same.all() and difference is None:
        return True, True, f"all {len(same)} trials that were done again are the same to the bit"
    if not excuses:
        n = int(np.argmin(same))
        return (
            False,
            False,
            difference
            or (
                f"seed {seeds[n]}, letter {trials.truth[n]}, trial {trials.trial[n]}: it differs when it is done "
                "again, in digits that a bundle does not keep"
            ),
        )
    objects = {run.seed: run.objects for run in bundle.runs}
    fault = improbable(trials, other, seeds, objects, rng)
    if fault is not None:
        return False, False, f"{fault}; {' and '.join(excuses)}"
    answers = (trials.label == other.label).all(axis=1) & (trials.pose == other.pose).all(axis=(1, 2))
    return (
        True,
        False,
        f"{np.count_nonzero(same)} of {len(same)} trials that were done again are the same to the bit, "
        f"{np.count_nonzero(answers)} name the same labels at the same places, and all together are within what chance "
        f"allows; that is all one can ask, because {' and '.join(excuses)}",
    )


def _share_of_bounds_alike(stated: FloatArray, again: Sequence[Run]) -> float:
    found = [run.bounds for run in again if run.bounds is not None]
    if len(found) < len(again):
        return 0.0
    return float(np.isclose(stated, np.concatenate(found), rtol=_BOUNDS_ALIKE).mean())


def _first_difference(stated: Trials, again: Trials, seeds: Sequence[int]) -> str | None:
    """Name the first trial, reading and column that differ, with both values; None if none does. Times do not count."""
    found = []
    for place, name in enumerate(COMPARED):
        one, other = getattr(stated, name), getattr(again, name)
        differ = np.asarray(one != other)
        if one.dtype.kind == "f":
            differ &= ~(np.isnan(one) & np.isnan(other))
        if differ.any():
            n, *where = np.argwhere(differ)[0].tolist()
            found.append((n, where[0] if where else 0, place, one, other))
    if not found:
        return None
    n, reading, place, one, other = min(found, key=lambda entry: entry[:3])
    values = [of[n][reading] if of.ndim > 1 else of[n] for of in (one, other)]
    return (
        f"seed {seeds[n]}, letter {stated.truth[n]}, trial {stated.trial[n]}, reading {reading + 1}: {COMPARED[place]} "
        f"is {values[0].tolist()} in the bundle and {values[1].tolist()} when it is done again"
    )


def improbable(
    stated: Trials,
    again: Trials,
    seeds: Sequence[int],
    objects: Mapping[int, Mapping[str, Properties]],
    rng: np.random.Generator,
) -> str | None:
    """Say what differs more than chance allows between trials and the same trials done again; None if nothing does.

    seeds: (n,) of the trials. objects: of the run of each seed. rng: draws the signs.

    Of each trial three numbers are compared: the share of the readings after which the label is right, the mean
    placement error, and the mean probability of the right label. If both are draws of one method, each difference might
    as well have the other sign. So the mean difference is compared with that under random signs (the paired permutation
    test, Fisher 1935). A figure is improbable if at most CHANCE / 3 of the draws are as far from 0, so an honest bundle
    is refused once in 1 / CHANCE times at most.
    """
    figures = {
        "the share of right labels": (stated.right.mean(axis=1), again.right.mean(axis=1)),
        "the placement error in mm": (_errors(stated, seeds, objects), _errors(again, seeds, objects)),
        "the probability of the right label": (stated.p_truth.mean(axis=1), again.p_truth.mean(axis=1)),
    }
    signs = rng.choice([-1.0, 1.0], size=(DRAWS, len(stated.truth)))
    for what, (one, other) in figures.items():
        difference = one - other
        known = np.isfinite(difference)
        drawn = np.abs(signs[:, known] @ difference[known])
        # The draw that is the difference itself counts too; equal sums may differ by rounding.
        as_far = 1 + np.count_nonzero(drawn >= abs(difference[known].sum()) * (1 - 1e-9))
        if difference[known].any() and as_far / (DRAWS + 1) <= CHANCE / len(figures):
            return (
                f"{what} is {one[known].mean():.4g} in the bundle and {other[known].mean():.4g} when the "
                f"same {known.sum()} trials are done again; chance does that to one honest bundle in "
                f"{1 / CHANCE:,.0f} at most"
            )
    return None


def _errors(
    trials: Trials, seeds: Sequence[int], objects: Mapping[int, Mapping[str, Properties]]
) -> FloatArray:
    """Average each trial's placement errors, (n,) mm; NaN where the letter is not known."""
    found = np.empty(len(seeds))
    for seed in dict.fromkeys(seeds):
        of_run = np.array(seeds) == seed
        found[of_run] = errors(select(trials, of_run), objects[seed]).mean(axis=1)
    return np.where(trials.known, found, np.nan)


def _fresh_words(asked: Task, bundle: Bundle, rng: np.random.Generator) -> dict[str, Any]:
    """Ask for one more run of a task, with a seed that `rng` draws: a new scan, new places, a new order.

    The seeds of a task are public, and so is all that follows from them. A package that has the answers in it, or finds
    them out from the random numbers that it is given, is verified to the bit. On a fresh seed it knows no more than
    others. Raises InputError if the task's readings are recorded.
    """
    words = {
        **asked.words,
        "trials": asked.trials,
        "readings": asked.readings,
        "seed": int(rng.integers(_FRESH_SEEDS)),
    }
    if asked.chosen:
        words["explore"] = bundle.runs[0].config["explore"]
    words |= {"estimator": bundle.estimator, "set": dict(bundle.options)}
    if not run_config(**words).pressed:
        raise InputError(f"task {asked.name} has recorded readings; there are no fresh ones to press")
    return words


def _worse_when_fresh(bundle: Bundle, fresh: Run) -> tuple[bool, str]:
    """Tell whether a bundle is better than a fresh run, beyond chance, and in one line what was found.

    Compared are the share of right labels and the placement error, each averaged over a run. The bundle's runs are
    draws of what a run of this method gives, and the fresh one is one more if all is well (a prediction interval,
    Student 1908, one-sided at CHANCE / 2 each). Their spread is at least what the number of trials alone would make it.
    """
    of_fresh = _shares_and_errors(fresh)
    of_runs = [_shares_and_errors(run) for run in bundle.runs]
    said, worse = [], False
    for place, (what, sign) in enumerate((("right labels", 1), ("error in mm", -1))):
        values = [figures[place] for figures in of_runs]
        means = np.array([one.mean() for one in values if len(one)])
        if not (len(of_fresh[place]) and len(means)):
            continue
        found = float(of_fresh[place].mean())
        below = sign * (means.mean() - found)
        worse = worse or below > _allowed(means, np.concatenate(values), len(of_fresh[place]), what)
        said.append(f"{what} {found:.4g} on a fresh scan and {means.mean():.4g} in the bundle")
    return worse, "; ".join(said)


def _allowed(means: FloatArray, values: FloatArray, count: int, what: str) -> float:
    """Say by how much a further run of `count` trials may be worse than the mean of others, by chance."""
    spread = values.var()
    if what == "right labels":  # where all are right, the spread says nothing of the next
        p = (values.sum() + 1) / (len(values) + 2)
        spread = max(spread, p * (1 - p))
    deviation = np.sqrt(max(means.var(ddof=1), spread / count))
    return float(student_t.isf(CHANCE / 2, len(means) - 1) * deviation * np.sqrt(1 + 1 / len(means)))


def _shares_and_errors(run: Run) -> tuple[FloatArray, FloatArray]:
    """Give for each trial the share of right labels, and for each of a known letter the mean error, mm."""
    return run.trials.right.mean(axis=1), errors(run.trials, run.objects).mean(axis=1)[run.trials.known]


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


def _words(asked: Task, method: Method, run: Run) -> dict[str, Any]:
    """Say what a run should have been; where touches are chosen, whether they were is the method's affair."""
    words = {"estimator": method.estimator, "set": dict(method.options), "task": asked.name, "seed": run.seed}
    if asked.chosen:
        words["explore"] = "blind" if run.config.get("explore") == "blind" else "information"
    return words


def _fault(run: Run, config: RunConfig, gathered: Gathered) -> str | None:
    """Find what of a run is not what its task gives to every method, whatever the method answers."""
    for name, value in config.model_dump(mode="json").items():
        if name not in _NOT_COMPARED and run.config.get(name, value) != value:
            return f"the task says {name} {short(value)}, and the run {short(run.config[name])}"
    if run.config.get("explore") != config.explore:
        return f"the task says explore {config.explore}, and the run {short(run.config.get('explore'))}"
    tasks = experiment.tasks_of(config, gathered.letters)
    done = list(zip(run.trials.truth.tolist(), run.trials.trial.tolist(), strict=True))
    if done != [(task.truth, task.trial) for task in tasks] or run.readings != config.readings:
        return "its trials are not those of the task: some are missing, or there are more"
    nobody = Witness()
    # What is pressed on demand need not be pressed: where the object is does not depend on it.
    plan = replace(
        experiment.plan_of(config, gathered.scan, nobody, gathered.objects), press=None, explore="random"
    )
    given = rounded(run_trials(plan, nobody, tasks, progress=experiment.silent)[0])
    if not np.array_equal(given.known, run.trials.known):
        return "it says otherwise than the task which letters are known"
    if not np.allclose(given.true_pose, run.trials.true_pose, rtol=0, atol=0.005):  # a step more or less
        return "an object lies elsewhere than the task puts it (true_x, true_y, true_theta)"
    if not _alike_objects(run.objects, gathered.objects):
        return "what it says of the objects (symmetry, centre, inertia) is not what the task says"
    return None


def _alike_objects(one: Mapping[str, Properties], other: Mapping[str, Properties]) -> bool:
    def numbers(of: Properties) -> list[float]:
        return [of.symmetry, *of.centre, of.inertia_over_mass]

    # The task works them out anew, perhaps with another library.
    return one.keys() == other.keys() and all(
        np.allclose(numbers(of), numbers(other[letter]), rtol=1e-6, atol=1e-6) for letter, of in one.items()
    )


def _set_up_otherwise(run: Run, again: Run) -> str | None:
    """Compare how a method says that it is set up with what the run says; another version may have other options."""
    for name, value in again.about["options"].items():
        if run.about["options"].get(name, value) != value:
            return (
                f"option {name} is said to be {short(run.about['options'][name])}, and it is {short(value)}"
            )
    if run.about["budget"] != again.about["budget"]:
        return (
            f"the budget is said to be {short(run.about['budget'])}, and it is {short(again.about['budget'])}"
        )
    return None


def _excuses(bundle: Bundle, other_code: bool) -> list[str]:
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
        if here.get(name, version) != version:
            found.append(f"it was made with {name} {version}, and here is {here[name]}")
    if other_code:
        at = f", which was made at commit {bundle.commit}" if bundle.commit else ""
        found.append(f"the code here is not that of the bundle{at}")
    return found


def _place(of: Mapping[str, object]) -> tuple[str, str, str]:
    """Name what the last bits depend on: processor, operating system, architecture; not the system's release."""
    system = str(of["system"]).split()
    return str(of["processor"]), system[0], system[-1]


def _notes(bundle: Bundle, method: Method, excuses: Sequence[str]) -> tuple[str, ...]:
    notes = [one for one in excuses if "author" not in one]
    package = package_of(method)
    if bundle.package != package:
        notes.append(
            f"the estimator came in {bundle.package or 'tactsim'}, and here in {package or 'tactsim'}"
        )
    return tuple(notes)
