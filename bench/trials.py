"""The paper's protocol (section IV): hide an object at a random pose, feed readings, note every estimate."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from time import process_time
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.certainty import certainty
from tactsim.bench.offered_touches import Press, RecordedTouches
from tactsim.bench.placement_error import Properties
from tactsim.bench.slip import STILL, Slip
from tactsim.bench.work_counts import flatten_work
from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.core.lengths import OFFSET, offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimate, Estimator
from tactsim.estimators.estimator import check_estimate

Explore = Literal["random", "information", "blind"]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class OneTrial:
    """One trial to be done: which letter, and its number among that letter's trials."""

    truth: str
    trial: int


@dataclass(frozen=True, eq=False)
class Trials:
    """What was estimated after every reading of n trials of r readings: the raw result of a run.

    truth: (n,) letters. known: (n,) whether the estimator was trained on that letter; if not, NONE is the right
    label. trial: (n,) number within the letter. true_pose: (n, r, 3) robot_in_object at each touch.
    reading: (n, r) which of the letter's test readings, or of the trial's touches, was taken. label: (n, r) the
    estimate (eq. 9, 14). p_truth, p_label: (n, r) probabilities given to the right and to the estimated label. pose:
    (n, r, 3) estimated robot_in_object. credibility, radius_90: (n, r) how sure the estimator was of the pose, see
    `certainty.Certainty`; NaN where it did not say. evaluations: (n, r) likelihood evaluations of that update.
    update_s, estimate_s, propose_s: (n, r) seconds of processor time.
    """

    truth: NDArray[np.str_]
    known: NDArray[np.bool_]
    trial: NDArray[np.int64]
    true_pose: FloatArray
    reading: NDArray[np.int64]
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
    def answer(self) -> NDArray[np.str_]:
        """Give the right labels (n,): the true letters, or NONE where they are not known."""
        return np.where(self.known, self.truth, NONE)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether the estimated label is the right one."""
        return self.label == self.answer[:, None]

    @property
    def named(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether the letter is known and right: only then is a placement error counted."""
        return self.right & self.known[:, None]

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether the letter is known and right, and the estimator said how sure it is of the pose."""
        return self.named & ~np.isnan(self.credibility)

    @property
    def seconds(self) -> FloatArray:
        """Give the seconds of each reading (n, r): its choice, the update and the estimate."""
        return self.update_s + self.estimate_s + self.propose_s

    @classmethod
    def joined(cls, parts: Iterable[Trials]) -> Trials:
        """Put trials together in the order given."""
        parts = list(parts)
        return cls(
            **{
                field.name: np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            }
        )


def draw_true_pose(rng: np.random.Generator, offsets: float = OFFSET) -> FloatArray:
    """Draw robot_in_object: x, y uniform in [-offsets, offsets] mm, theta uniform on the circle (section IV)."""
    x, y = rng.uniform(-offsets, offsets, size=2)
    return np.array([x, y, rng.uniform(-np.pi, np.pi)])


def generator(seed: int, task: OneTrial, stream: int) -> np.random.Generator:
    """Make the generator of one trial; stream 0 draws pose and order, 1 is the estimator's, 2 moves the object.

    It depends on its arguments alone. So the trials are the same in any order, in any number of processes and
    for any estimator.
    """
    return np.random.default_rng([seed, zlib.crc32(task.truth.encode()), task.trial, stream])


def check_labels(labels: Iterable[str]) -> None:
    """Raise InputError if a letter is called as an estimator says that it is none of them."""
    if NONE in labels:
        raise InputError(f"a letter is called {NONE!r}, which means none of the known letters; rename it")


def check_readings(scan: Scan, letters: Iterable[str], readings: int, hold_out: Iterable[str] = ()) -> None:
    """Raise InputError unless every letter has `readings` test readings and, if not held out, training readings."""
    for letter in letters:
        for split in ("test",) if letter in hold_out else ("train", "test"):
            if not len(scan.where(split, letter)):
                here = ", but for others" if len(scan.where(split)) else ""
                raise InputError(
                    f"the scan has no {split} readings of letter {letter!r}{here}; record them (`bench record --split "
                    f"{split}`), or take them from another scan (`bench run --scan TEST --train-scan TRAIN`)"
                )
        check_count(letter, len(scan.where("test", letter)), readings)


def check_count(letter: str, count: int, readings: int) -> None:
    """Raise InputError if a letter has fewer test readings, `count`, than a trial takes."""
    if readings > count:
        raise InputError(
            f"{readings} readings a trial: letter {letter!r} has {count} test readings, drawn without "
            f"replacement; ask for at most {count}"
        )


def run_trial(
    estimator: Estimator,
    test: Scan,
    task: OneTrial,
    *,
    letters: Sequence[str],
    readings: int,
    seed: int,
    of: Properties,
    explore: Explore = "random",
    press: Press | None = None,
    slip: Slip = STILL,
    observe: Callable[[Estimate, FloatArray, FloatArray], None] | None = None,
    clock: Callable[[], float] = process_time,
) -> Trials:
    """Recognise one hidden object: present `readings` readings of it, estimate after each.

    `test` holds the letter's test readings only; `letters` are those that the estimator was trained on; `of` are
    the letter's properties, for the metric of its placement.
    Touches come in random order without replacement, or, with explore="information", as the estimator proposes.
    They are the test readings, or, with `press`, touches in the robot's frame that are pressed on demand. slip: how
    the object moves between touches; the poses of test readings, candidates too, are those that go with the object's
    pose at that touch. observe(estimate, reading, sensor_in_robot) is called after each touch, with the last image of a
    sequence, and its time does not count. clock: gives the seconds that times are differences of. It is this process's
    processor time, so that other programs on the machine do not count either, unless the estimator works in another
    process.

    Raises InputError that names the estimator if its answer is not a valid estimate or proposal, and if the presses
    that are left do not come to rest.
    """
    rng = generator(seed, task, 0)
    first = draw_true_pose(rng, offsets(test.taxel_xy))
    touches = (
        RecordedTouches(test, estimator.takes_sequences)
        if press is None
        else press.touches(task.truth, task.trial, seed)
    )
    left = rng.permutation(len(touches))
    if explore == "information":
        left.sort()
    true_pose = np.tile(first, (readings, 1))
    if not slip.still:
        true_pose = slip.poses(first, readings, generator(seed, task, 2))
    sensor_in_robot = touches.sensor_in_robot(first)
    estimator.reset(generator(seed, task, 1))

    known = task.truth in letters
    right, label = task.truth if known else NONE, []
    taken = np.empty(readings, dtype=np.int64)
    measured = ("p_truth", "p_label", "credibility", "radius_90", "update_s", "estimate_s")
    numbers = {name: np.empty(readings) for name in measured}
    propose_s = np.zeros(readings)
    evaluations = np.empty(readings, dtype=np.int64)
    pose = np.empty((readings, 3))
    before = _evaluations(estimator)
    for k in range(readings):
        if not slip.still:
            sensor_in_robot = touches.sensor_in_robot(true_pose[k])
        reading = None
        while reading is None:
            if not len(left):
                raise InputError(
                    f"{readings} readings a trial: no other press of {task.truth!r} comes to rest"
                )
            chosen = 0
            if explore == "information":
                start = clock()
                chosen = estimator.propose(sensor_in_robot[left])
                propose_s[k] += clock() - start
                _check_proposal(chosen, len(left), estimator)
            taken[k], left = left[chosen], np.concatenate([left[:chosen], left[chosen + 1 :]])
            reading = touches.reading(int(taken[k]), true_pose[k])
        start = clock()
        estimator.update(reading, sensor_in_robot[taken[k]])
        updated = clock()
        estimate = estimator.estimate()
        numbers["estimate_s"][k] = clock() - updated
        numbers["update_s"][k] = updated - start
        check_estimate(estimate, estimator, (*letters, NONE))
        label.append(estimate.label)
        numbers["p_truth"][k] = estimate.probabilities.get(right, 0.0)
        numbers["p_label"][k] = estimate.probabilities[estimate.label]
        pose[k] = estimate.robot_in_object
        sure = certainty(estimate, true_pose[k], of)
        numbers["credibility"][k], numbers["radius_90"][k] = sure.credibility, sure.radius
        after = _evaluations(estimator)
        evaluations[k], before = after - before, after
        if observe is not None:
            observe(estimate, np.atleast_2d(reading)[-1], sensor_in_robot[taken[k]])
    return Trials(
        truth=np.array([task.truth]), known=np.array([known]), trial=np.array([task.trial]), true_pose=true_pose[None],
        reading=taken[None], label=np.array([label]), pose=pose[None], evaluations=evaluations[None],
        propose_s=propose_s[None], **{name: values[None] for name, values in numbers.items()},
    )  # fmt: skip


def _check_proposal(chosen: object, count: int, estimator: Estimator) -> None:
    if not (isinstance(chosen, int | np.integer) and 0 <= chosen < count):
        raise InputError(
            f"the estimator {type(estimator).__name__} is broken: it proposed {short(chosen)} of {count}"
        )


def _evaluations(estimator: Estimator) -> int:
    return flatten_work(estimator.work).get("likelihood_evaluations", 0)
