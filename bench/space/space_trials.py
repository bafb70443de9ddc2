"""The trials in space: hide a solid at a random pose, touch it from random sides, note every estimate."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from time import process_time
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.space.draws import draw_true_pose
from tactsim.bench.space.pads import Touching
from tactsim.bench.space.surface_distance import Surface, surface_distance
from tactsim.core import rigid
from tactsim.core.errors import InputError, short
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, Estimator
from tactsim.estimators.estimator import check_estimate, flatten_work

Explore = Literal["random", "information"]
OFFERED = 40  # touches among which an estimator may choose the next
_SAMPLES = 200  # of a belief about the pose, for its certainty


@dataclass(frozen=True)
class SpaceTask:
    """One trial to be done: which object, and its number among that object's trials."""

    truth: str
    trial: int


@dataclass(frozen=True, eq=False)
class SpaceTrials:
    """What was estimated after every touch of n trials of r touches: the raw result of a run.

    truth: (n,) objects. trial: (n,) number within the object. true_pose: (n, 7) robot_in_object. start: (n, r, 7) where
    each touch began, sensor_in_robot (of a hand: hand_in_robot). met: (n, r) how many pads met the object. label: (n,
    r) the estimate. p_truth, p_label: (n, r) probabilities given to the right and to the estimated label. pose: (n, r,
    7) estimated robot_in_object. credibility: (n, r) the share of the belief that is nearer to the estimate than the
    truth is, radius_90: (n, r) mm about the estimate that holds 90 % of the belief, both in mean surface distance; NaN
    where the estimator did not say or the label is wrong. evaluations: (n, r) likelihood evaluations of that update.
    update_s, estimate_s, propose_s: (n, r) seconds of processor time.
    """

    truth: NDArray[np.str_]
    trial: NDArray[np.int64]
    true_pose: FloatArray
    start: FloatArray
    met: NDArray[np.int64]
    label: NDArray[np.str_]
    p_truth: FloatArray
    p_label: FloatArray
    pose: FloatArray
    credibility: FloatArray
    radius_90: FloatArray
    evaluations: NDArray[np.int64]
    update_s: FloatArray
    estimate_s: FloatArray
    propose_s: FloatArray

    @property
    def right(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether the estimated label is the right one."""
        return self.label == self.truth[:, None]

    @classmethod
    def joined(cls, parts: Iterable[SpaceTrials]) -> SpaceTrials:
        """Put trials together in the order given."""
        parts = list(parts)
        return cls(
            **{one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)}
        )


def tasks_of(objects: Sequence[str], trials: int) -> list[SpaceTask]:
    """Share `trials` among the objects, which take turns; in the order of the objects."""
    return [
        SpaceTask(label, number)
        for place, label in enumerate(objects)
        for number in range((trials - place + len(objects) - 1) // len(objects))
    ]


def generator(seed: int, task: SpaceTask, stream: int) -> np.random.Generator:
    """Make a generator of one trial, the same whatever else is tried.

    Stream 0 hides the object, 1 is the estimator's, 2 draws the touches that are offered, 3 moves and disturbs the pad.
    """
    return np.random.default_rng([seed, zlib.crc32(task.truth.encode()), task.trial, stream])


def run_trial(
    estimator: Estimator,
    press: Touching,
    task: SpaceTask,
    of: Surface,
    *,
    labels: Sequence[str],
    touches: int,
    seed: int,
    explore: Explore = "random",
    observe: Callable[[Estimate, FloatArray, FloatArray], None] | None = None,
    clock: Callable[[], float] = process_time,
) -> SpaceTrials:
    """Recognise one hidden object: touch it `touches` times, estimate after each.

    of: the true object's surface, for the certainty of the pose. At each touch OFFERED starts are drawn. The estimator
    chooses one with explore="information", else the first is taken, so both are offered the same.
    observe(estimate, readings, sensors_in_robot) is called after each touch; its time does not count.

    Raises InputError that names the estimator if its answer is not a valid estimate or proposal.
    """
    true_pose = draw_true_pose(generator(seed, task, 0))
    offer, disturb = generator(seed, task, 2), generator(seed, task, 3)
    estimator.reset(generator(seed, task, 1))
    label = []
    measured = ("p_truth", "p_label", "credibility", "radius_90", "update_s", "estimate_s")
    numbers = {name: np.empty(touches) for name in measured}
    propose_s = np.zeros(touches)
    evaluations, met = np.empty(touches, dtype=np.int64), np.empty(touches, dtype=np.int64)
    pose, start = np.empty((touches, 7)), np.empty((touches, 7))
    before = _evaluations(estimator)
    for k in range(touches):
        offered = press.starts(OFFERED, offer)
        chosen = 0
        if explore == "information":
            began = clock()
            chosen = estimator.propose(offered)
            propose_s[k] = clock() - began
            _check_proposal(chosen, estimator)
        start[k] = offered[chosen]
        readings, stated, touched = press.touch(
            task.truth, rigid.compose(true_pose, start[k]), np.random.default_rng(disturb.integers(2**63))
        )
        sensors_in_robot = rigid.compose(rigid.invert(true_pose), stated)
        met[k] = np.count_nonzero(touched)
        began = clock()
        estimator.update(readings, sensors_in_robot)
        updated = clock()
        estimate = estimator.estimate()
        numbers["estimate_s"][k] = clock() - updated
        numbers["update_s"][k] = updated - began
        check_estimate(estimate, estimator, labels)
        label.append(estimate.label)
        numbers["p_truth"][k] = estimate.probabilities.get(task.truth, 0.0)
        numbers["p_label"][k] = estimate.probabilities[estimate.label]
        pose[k] = estimate.robot_in_object
        numbers["credibility"][k], numbers["radius_90"][k] = (
            certainty(estimate, true_pose, of) if estimate.label == task.truth else (np.nan, np.nan)
        )
        after = _evaluations(estimator)
        evaluations[k], before = after - before, after
        if observe is not None:
            observe(estimate, readings, sensors_in_robot)
    return SpaceTrials(
        truth=np.array([task.truth]), trial=np.array([task.trial]), true_pose=true_pose[None], start=start[None],
        met=met[None], label=np.array([label]), pose=pose[None], evaluations=evaluations[None],
        propose_s=propose_s[None], **{name: values[None] for name, values in numbers.items()},
    )  # fmt: skip


def certainty(estimate: Estimate, true_pose: FloatArray, of: Surface) -> tuple[float, float]:
    """Give the share of the belief that is nearer to the estimate than the truth is, and the radius mm of 90 % of it.

    Distances are mean surface distances; of a belief of more than 200 samples, so many are drawn evenly by weight.
    Both are NaN if the estimator does not say how sure it is of the pose.
    """
    if estimate.samples is None:
        return np.nan, np.nan
    weights = estimate.samples.weights
    held = np.cumsum(weights)
    at = np.searchsorted(held, (np.arange(_SAMPLES) + 0.5) / _SAMPLES * held[-1])
    poses = estimate.samples.poses[np.minimum(at, len(weights) - 1)]
    others = np.concatenate([poses, true_pose[None]])
    about = np.broadcast_to(rigid.invert(estimate.robot_in_object), others.shape)
    away = surface_distance(rigid.invert(others), about, of.thinned)
    return float((away[:-1] < away[-1]).mean()), float(np.quantile(away[:-1], 0.9))


def _check_proposal(chosen: object, estimator: Estimator) -> None:
    if not (isinstance(chosen, int | np.integer) and 0 <= chosen < OFFERED):
        raise InputError(
            f"the estimator {type(estimator).__name__} is broken: it proposed {short(chosen)} of {OFFERED}"
        )


def _evaluations(estimator: Estimator) -> int:
    return flatten_work(estimator.work).get("likelihood_evaluations", 0)
