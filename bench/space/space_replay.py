"""Do trials of a run in space again, and keep what the estimator felt and believed after every touch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from tactsim.bench.experiment import gather, plan_of, silent
from tactsim.bench.report.recognition import trials_to_show
from tactsim.bench.results import Run
from tactsim.bench.space.space_config import SpaceConfig
from tactsim.bench.space.surface_distance import drawn_evenly
from tactsim.bench.trials import SpaceTrials, Touch, TrialPlan, run_trial
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate
from tactsim.estimators.estimator import no_exit

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


def replay(run: Run) -> list[Replayed]:
    """Do a typical trial of a run and the hardest again. Raises InputError if its readings cannot be had again."""
    plan = run.plan or _plan_anew(run)
    estimator = plan.fitted()
    labels = plan.scan.letters
    found = []
    for kind, task in trials_to_show([run.trials]).items():
        seen: list[tuple[Estimate, Touch]] = []
        with no_exit(estimator):
            trials = run_trial(
                estimator, plan.scan.where("test", task.truth), task, letters=labels, readings=run.readings,
                seed=plan.seed, of=run.objects[task.truth], explore=plan.explore, press=plan.press,
                observe=partial(_keep, seen),
            )  # fmt: skip
        assert isinstance(trials, SpaceTrials)
        estimates, touches = zip(*seen, strict=True)
        samples = [one.samples for one in estimates if one.samples is not None]
        found.append(
            Replayed(
                kind, trials, labels, np.array([touch.reading for touch in touches]),
                np.array([touch.sensor_in_robot for touch in touches]),
                np.array([[one.probabilities.get(label, 0.0) for label in labels] for one in estimates]),
                np.array([rigid.invert(drawn_evenly(one, SHOWN)) for one in samples])
                if len(samples) == len(estimates)
                else None,
            )
        )  # fmt: skip
    return found


def _keep(seen: list[tuple[Estimate, Touch]], estimate: Estimate, touch: Touch) -> None:
    seen.append((estimate, touch))


def _plan_anew(run: Run) -> TrialPlan:
    config = checked(SpaceConfig, run.config, "run")
    gathered = gather(config, jobs=1, cache=True, progress=silent)
    return plan_of(config, gathered.scan, solids=gathered.solids)
