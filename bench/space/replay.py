"""Do trials of a run in space again, and keep what the estimator felt and believed after every touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactsim.bench.runner import silent
from tactsim.bench.score import settled_at
from tactsim.bench.space.config import SpaceConfig
from tactsim.bench.space.pads import pads
from tactsim.bench.space.plan import SpacePlan
from tactsim.bench.space.run import SpaceRun
from tactsim.bench.space.runner import gather_in_space
from tactsim.bench.space.trials import SpaceTask, SpaceTrials, outside_of, run_trial
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


def replay(run: SpaceRun, kinds: Sequence[str] = ("typical", "hardest")) -> list[Replayed]:
    """Do chosen trials of a run again. Raises InputError if its readings cannot be had again."""
    plan = run.plan or _plan_anew(run)
    estimator = plan.fitted()
    press = pads(plan.solids, plan.config)
    outside = outside_of(max(one.radius for one in plan.solids))
    found = []
    for kind, task in tasks_to_show(run.trials).items():
        if kind not in kinds:
            continue
        estimates: list[Estimate] = []
        felt: list[FloatArray] = []
        sensors: list[FloatArray] = []

        def keep(
            estimate: Estimate, readings: FloatArray, poses: FloatArray,
            to: tuple[list[Estimate], list[FloatArray], list[FloatArray]] = (estimates, felt, sensors),
        ) -> None:  # fmt: skip
            for values, value in zip(to, (estimate, readings, poses), strict=True):
                values.append(value)  # type: ignore[arg-type]

        trials = run_trial(
            estimator, press, task, plan.surfaces[task.truth], labels=plan.scan.objects, touches=run.touches,
            seed=plan.config.seed, outside=outside, explore=plan.config.explore, observe=keep,
        )  # fmt: skip
        labels = tuple(plan.scan.objects)
        samples = [one.samples for one in estimates if one.samples is not None]
        found.append(
            Replayed(
                kind, trials, labels, np.array(felt), np.array(sensors),
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
