"""Try a method on a seed of its task that nobody could have prepared for: a new scan, new places, new order.

The seeds of a task are public, and so is all that follows from them. A package that has the answers in it, or finds
them out from the random numbers that it is given, is verified to the bit. On a fresh seed it knows no more than others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student_t

from tactsim.bench import experiment
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.leaderboard.bundle import Bundle
from tactsim.bench.leaderboard.comparison import CHANCE
from tactsim.bench.leaderboard.confined import Confined
from tactsim.bench.leaderboard.confined_trials import run_trials_confined
from tactsim.bench.placement import Properties, properties
from tactsim.bench.score import errors
from tactsim.bench.tasks import Task
from tactsim.bench.trials import OneTrial, Progress, Trials
from tactsim.core import InputError
from tactsim.core.poses import FloatArray

_SEEDS = 2**62


def fresh_config(asked: Task, bundle: Bundle, rng: np.random.Generator) -> RunConfig:
    """Ask for one more run of a task, with a seed that `rng` draws. Raises InputError if its readings are recorded."""
    words = {**asked.words, "trials": asked.trials, "readings": asked.readings}
    if asked.words.get("explore") == "information":
        words["explore"] = bundle.runs[0].config["explore"]
    config = run_config(
        **words, estimator=bundle.estimator, set=dict(bundle.options), seed=int(rng.integers(_SEEDS))
    )
    if not config.pressed:
        raise InputError(f"task {asked.name} has recorded readings; there are no fresh ones to press")
    return config


def compare_fresh(
    bundle: Bundle,
    config: RunConfig,
    processes: Sequence[Confined],
    *,
    rng: np.random.Generator,
    jobs: int,
    progress: Progress,
) -> tuple[bool, str]:
    """Do the fresh run, and tell whether the bundle is better than it, beyond chance, and in one line what was found.

    Compared are the share of right labels and the placement error, each averaged over a run. The bundle's runs are
    draws of what a run of this method gives, and the fresh one is one more if all is well (a prediction interval,
    Student 1908, one-sided at CHANCE / 2 each). Their spread is at least what the number of trials alone would make
    it. Raises NoScore if the estimator fails.
    """
    gathered = experiment.gather(config, jobs=jobs, cache=False, progress=experiment.silent)
    tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(config.trials)]
    plan = experiment.plan_of(config, gathered.scan)
    trials, _ = run_trials_confined(plan, tasks, processes, rng=rng, progress=progress)
    fresh = _figures(trials, properties(gathered.scan))
    stated = [_figures(run.trials, run.objects) for run in bundle.runs]
    said, worse = [], False
    for place, (what, sign) in enumerate((("right labels", 1), ("error in mm", -1))):
        of_runs = [figures[place] for figures in stated]
        means = np.array([values.mean() for values in of_runs if len(values)])
        if not (len(fresh[place]) and len(means)):
            continue
        found = float(fresh[place].mean())
        below = sign * (means.mean() - found)
        worse = worse or below > _allowed(means, np.concatenate(of_runs), len(fresh[place]), what)
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


def _figures(trials: Trials, objects: dict[str, Properties]) -> tuple[FloatArray, FloatArray]:
    """Give for each trial the share of right labels, and for each of a known letter the mean error, mm."""
    return trials.right.mean(axis=1), errors(trials, objects).mean(axis=1)[trials.known]
