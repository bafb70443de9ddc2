"""Do trials of a run in space again, and keep what the estimator felt and believed after every touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.bench.experiment import silent
from tactsim.bench.score import settled_at
from tactsim.bench.space.pads import pads
from tactsim.bench.space.space_config import SpaceConfig
from tactsim.bench.space.space_plan import SpacePlan
from tactsim.bench.space.space_run import SpaceRun
from tactsim.bench.space.space_runner import gather_in_space
from tactsim.bench.space.space_trials import SpaceTask, SpaceTrials, run_trial
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, PoseSamples

SHOWN = 40  # poses of a belief


@dataclass(frozen=True, eq=False)
class Replayed:
    """One trial of a run, touch by touch, r touches with m pads; poses are in the robot's frame.

    kind: "typical" or "hardest". trials: the trial. readings: (r, m, taxels) kPa. sensors: (r, m, 7). probabilities:
    (r, labels), in the order of `labels`. belief: (r, SHOWN, 7) object_in_robot, drawn evenly by weight from the
    estimator's samples for the label that it names; None if it gives none.
    """

    kind: str
    trials: SpaceTrials
    labels: tuple[str, ...]
    readings: FloatArray
    sensors: FloatArray
    probabilities: FloatArray
    belief: FloatArray | None


def tasks_to_show(trials: SpaceTrials) -> dict[str, SpaceTask]:
    """Choose a typical trial and the hardest, by the touch from which they are and stay right."""
    order = np.argsort(settled_at(trials.right), kind="stable")
    places = {"typical": order[(len(order) - 1) // 2], "hardest": order[-1]}
    if len(order) == 1:
        del places["hardest"]
    return {kind: SpaceTask(str(trials.truth[at]), int(trials.trial[at])) for kind, at in places.items()}


def replay(run: SpaceRun) -> list[Replayed]:
    """Do a typical trial of a run and the hardest again. Raises InputError if its readings cannot be had again."""
    plan = run.plan or _plan_anew(run)
    estimator = plan.fitted()
    press = pads(plan.solids, plan.config)
    found = []
    for kind, task in tasks_to_show(run.trials).items():
        told: list[tuple[Estimate, FloatArray, FloatArray]] = []
        trials = run_trial(
            estimator, press, task, plan.surfaces[task.truth], labels=plan.scan.objects, touches=run.touches,
            seed=plan.config.seed, explore=plan.config.explore, observe=lambda *one, told=told: told.append(one),
        )  # fmt: skip
        estimates = [estimate for estimate, _, _ in told]
        labels = tuple(plan.scan.objects)
        samples = [one.samples for one in estimates if one.samples is not None]
        found.append(
            Replayed(
                kind, trials, labels, np.array([felt for _, felt, _ in told]),
                np.array([sensors for _, _, sensors in told]),
                np.array([[one.probabilities.get(label, 0.0) for label in labels] for one in estimates]),
                np.array([_drawn(one) for one in samples]) if len(samples) == len(estimates) else None,
            )
        )  # fmt: skip
    return found


def _drawn(samples: PoseSamples) -> FloatArray:
    """Draw object_in_robot (SHOWN, 7) evenly by weight."""
    held = np.cumsum(samples.weights)
    at = np.searchsorted(held, (np.arange(SHOWN) + 0.5) / SHOWN * held[-1])
    return rigid.invert(samples.poses[np.minimum(at, len(held) - 1)])


def _plan_anew(run: SpaceRun) -> SpacePlan:
    config = checked(SpaceConfig, run.config, "run")
    scan, _, _ = gather_in_space(config, progress=silent)
    return SpacePlan(config, scan)
