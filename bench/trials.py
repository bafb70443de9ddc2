"""The paper's protocol (section IV): hide an object at a random pose, feed readings, note every estimate."""

from __future__ import annotations

import hashlib
import json
import pickle
import zlib
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, fields, replace
from itertools import groupby
from time import process_time
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.certainty import certainty
from tactsim.bench.fitting import fit
from tactsim.bench.offered_touches import Press, RecordedTouches
from tactsim.bench.placement_error import Properties, properties
from tactsim.bench.slip import STILL, Slip
from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import source_digest
from tactsim.core.workers import worker_processes
from tactsim.estimators import NONE, Estimate, Estimator, create
from tactsim.estimators.estimator import check_estimate
from tactsim.estimators.registry import load

TRANSLATION_MM = 10.0  # T_R^O is uniform in [-10, 10] mm and on the circle (section IV)

Explore = Literal["random", "information", "blind"]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Task:
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


def draw_true_pose(rng: np.random.Generator) -> FloatArray:
    """Draw robot_in_object: x, y uniform in [-10, 10] mm, theta uniform on the circle."""
    x, y = rng.uniform(-TRANSLATION_MM, TRANSLATION_MM, size=2)
    return np.array([x, y, rng.uniform(-np.pi, np.pi)])


def generator(seed: int, task: Task, stream: int) -> np.random.Generator:
    """Make the generator of one trial; stream 0 draws pose and order, 1 is the estimator's, 2 moves the object.

    It depends on its arguments alone. So the trials are the same in any order, in any number of processes and
    for any estimator.
    """
    return np.random.default_rng([seed, zlib.crc32(task.truth.encode()), task.trial, stream])


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
        count = len(scan.where("test", letter))
        if readings > count:
            raise InputError(
                f"{readings} readings a trial: letter {letter!r} has {count} test readings, drawn without "
                f"replacement; ask for at most {count}"
            )


def run_trial(
    estimator: Estimator,
    test: Scan,
    task: Task,
    *,
    letters: Sequence[str],
    readings: int,
    seed: int,
    of: Properties,
    explore: Explore = "random",
    press: Press | None = None,
    slip: Slip = STILL,
    observe: Callable[[Estimate, FloatArray, FloatArray], None] | None = None,
) -> Trials:
    """Recognise one hidden object: present `readings` readings of it, estimate after each.

    `test` holds the letter's test readings only; `letters` are those that the estimator was trained on; `of` are
    the letter's properties, for the metric of its placement.
    Touches come in random order without replacement, or, with explore="information", as the estimator proposes.
    They are the test readings, or, with `press`, touches in the robot's frame that are pressed on demand. slip: how
    the object moves between touches; the poses of test readings, candidates too, are those that go with the object's
    pose at that touch. observe(estimate, reading, sensor_in_robot) is called after each reading, and its time does not
    count. Times are this process's processor time, so that other programs on the machine do not count either.

    Raises InputError that names the estimator if its answer is not a valid estimate or proposal, and if the presses
    that are left do not come to rest.
    """
    rng = generator(seed, task, 0)
    first = draw_true_pose(rng)
    touches = RecordedTouches(test) if press is None else press.touches(task.truth, task.trial, seed)
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
                start = process_time()
                chosen = estimator.propose(sensor_in_robot[left])
                propose_s[k] += process_time() - start
                _check_proposal(chosen, len(left), estimator)
            taken[k], left = left[chosen], np.delete(left, chosen)
            reading = touches.reading(int(taken[k]), true_pose[k])
        start = process_time()
        estimator.update(reading, sensor_in_robot[taken[k]])
        updated = process_time()
        estimate = estimator.estimate()
        numbers["estimate_s"][k] = process_time() - updated
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
            observe(estimate, reading, sensor_in_robot[taken[k]])
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


@dataclass(frozen=True, eq=False)
class TrialPlan:
    """All that a worker needs to do trials: the estimator, the scan, and how many readings in which order.

    press: what presses on demand; None if the readings are those of the scan. given: an estimator made in Python, as
    it is or pickled for a worker; None if `estimator` is a registered name. each_held_out: whether the letter of a
    trial is left out of what the estimator knows.
    """

    estimator: str
    options: Mapping[str, Any]
    scan: Scan
    readings: int
    seed: int
    explore: Explore = "random"
    slip: Slip = STILL
    press: Press | None = None
    given: Estimator | bytes | None = None
    each_held_out: bool = False

    def letters_known(self, truth: str) -> tuple[str, ...]:
        """List the letters that an estimator knows in the trials of the letter `truth`."""
        trained = self.scan.where("train").letters
        return tuple(letter for letter in trained if not (self.each_held_out and letter == truth))

    def fitted_for(self, truth: str, estimator: Estimator) -> Estimator:
        """Give what the trials of a letter need: the fitted `estimator`, without the letter if each is held out."""
        return estimator.without(truth, self.scan) if self.each_held_out else estimator

    def make(self) -> Estimator:
        """Make the estimator, which is not fitted yet.

        Raises InputError if it does not exist, or was given and cannot be made in another process.
        """
        if self.given is None:
            return create(self.estimator, **self.options)
        if not isinstance(self.given, bytes):
            return self.given
        try:
            return pickle.loads(self.given)
        except Exception as error:  # a user's class may raise anything when it is unpickled
            raise _not_portable(self.estimator, error) from error

    def portable(self) -> TrialPlan:
        """Return a plan that can be sent to worker processes. Raises InputError if the estimator cannot be."""
        if self.given is None or isinstance(self.given, bytes):
            return self
        try:
            return replace(self, given=pickle.dumps(self.given))
        except Exception as error:  # a user's class may raise anything when it is pickled
            raise _not_portable(self.estimator, error) from error

    @property
    def source(self) -> str:
        """Hash the source code that the trials depend on, without that which makes readings."""
        given = self.given if isinstance(self.given, Estimator) else self.estimator
        return source_of_trials(given, on_demand=self.press is not None)

    @property
    def digest(self) -> str:
        """Identify the fitted estimator by what it depends on: its name, its options, the scan."""
        options = json.dumps(self.options, sort_keys=True, default=str)
        given = hashlib.sha256(self.given).hexdigest() if isinstance(self.given, bytes) else ""
        return f"{self.estimator} {options} {self.scan.digest} {given}"


def source_of_trials(estimator: str | Estimator, *, on_demand: bool = False) -> str:
    """Hash the source code that trials of an estimator depend on.

    on_demand: whether they press themselves; what makes the readings of a scan does not count.
    Raises InputError if no estimator has that name.
    """
    kinds = [load(estimator)] if isinstance(estimator, str) else _kinds(estimator)
    pressing = ["tactsim.bench.touching"] if on_demand else []
    return source_digest(__name__, *pressing, *(kind.__module__ for kind in kinds))


def _kinds(estimator: Estimator) -> list[type[Estimator]]:
    """List the class of an estimator and of those that it wraps."""
    inner = [value for value in vars(estimator).values() if isinstance(value, Estimator)]
    return [type(estimator), *(kind for one in inner for kind in _kinds(one))]


def _not_portable(name: str, error: Exception) -> InputError:
    return InputError(
        f"a worker process cannot make the estimator {name} ({type(error).__name__}: {error}); "
        "define its class in a module that can be imported, or use jobs=1"
    )


def run_trials(
    plan: TrialPlan, estimator: Estimator, tasks: list[Task], *, jobs: int = 1, progress: Progress
) -> tuple[Trials, dict[str, Any]]:
    """Do all trials, here with the fitted `estimator` or in `jobs` processes that fit their own.

    Returns the trials in the order of `tasks` and the estimators' work, summed. The results do not
    depend on `jobs`.
    """
    progress("trials", 0, len(tasks))
    if jobs == 1 or len(tasks) == 1:
        return _run_here(plan, estimator, tasks, lambda done: progress("trials", done, len(tasks)))
    plan = plan.portable()
    chunks = np.array_split(np.arange(len(tasks)), min(len(tasks), 8 * jobs))
    parts: list[Trials | None] = [None] * len(chunks)
    work: Counter[str] = Counter()
    done = 0
    with worker_processes(jobs) as pool:
        futures = {
            pool.submit(run_chunk, plan, [tasks[i] for i in chunk]): place
            for place, chunk in enumerate(chunks)
        }
        for future in as_completed(futures):
            parts[futures[future]], part_work = future.result()
            work.update(part_work)
            done += len(chunks[futures[future]])
            progress("trials", done, len(tasks))
    return Trials.joined(part for part in parts if part is not None), unflatten_work(work)


def _run_here(
    plan: TrialPlan, estimator: Estimator, tasks: list[Task], report: Callable[[int], None]
) -> tuple[Trials, dict[str, Any]]:
    tests = {truth: plan.scan.where("test", truth) for truth in {task.truth for task in tasks}}
    objects = properties(plan.scan)
    work: Counter[str] = Counter()
    parts = []
    for truth, of_letter in groupby(tasks, key=lambda task: task.truth):
        fitted, letters = plan.fitted_for(truth, estimator), plan.letters_known(truth)
        before = Counter(flatten_work(fitted.work))
        for task in of_letter:
            parts.append(
                run_trial(
                    fitted, tests[truth], task, letters=letters,
                    readings=plan.readings, seed=plan.seed, of=objects[truth], explore=plan.explore,
                    slip=plan.slip, press=plan.press,
                )
            )  # fmt: skip
            report(len(parts))
        work.update(flatten_work(fitted.work))
        work.subtract(before)
    return Trials.joined(parts), unflatten_work(work)


def run_chunk(plan: TrialPlan, tasks: list[Task]) -> tuple[Trials, dict[str, int]]:
    """Do some trials in a worker process; an estimator is fitted once for all chunks of a plan.

    Returns the trials in the order of `tasks`, and the flattened work without that of fitting.
    """
    trials, work = _run_here(plan, _fitted(plan), tasks, lambda done: None)
    return trials, flatten_work(work)


_memo: OrderedDict[str, Estimator] = OrderedDict()  # a worker process's fitted estimators, newest last
_MEMO_SIZE = 4


def _fitted(plan: TrialPlan) -> Estimator:
    key = plan.digest
    if key not in _memo:
        estimator = plan.make()
        fit(estimator, plan.scan)
        _memo[key] = estimator
        if len(_memo) > _MEMO_SIZE:
            _memo.popitem(last=False)
    _memo.move_to_end(key)
    return _memo[key]


def flatten_work(work: Mapping[str, Any]) -> dict[str, int]:
    """Turn {"presses": 3, "skipped": {"cached": 1}} into {"presses": 3, "skipped.cached": 1}."""
    try:
        flat = {name: int(count) for name, count in work.items() if name != "skipped"}
        return flat | {f"skipped.{name}": int(count) for name, count in work.get("skipped", {}).items()}
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"an estimator's work is {short(work)}; it must be counts and `skipped`, a table of counts"
        ) from error


def unflatten_work(flat: Mapping[str, int]) -> dict[str, Any]:
    """Undo `flatten_work`."""
    work: dict[str, Any] = {name: count for name, count in flat.items() if not name.startswith("skipped.")}
    skipped = {name.partition(".")[2]: count for name, count in flat.items() if name.startswith("skipped.")}
    return work | {"skipped": skipped}
