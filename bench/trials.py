"""Trials, the paper's protocol (section IV): hide an object at a random pose, feed readings, note every estimate.

`run_trial` does one. `TrialPlan` is all that a process needs to do trials, and `run_trials` does many.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import groupby
from time import process_time
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tactsim.bench import kinds
from tactsim.bench.config import STILL, Slip
from tactsim.bench.kinds import PLANE
from tactsim.bench.placement import Placement, certainty, properties
from tactsim.core import InputError, Scan, compose, invert
from tactsim.core.compiling import compile_waiting
from tactsim.core.errors import short
from tactsim.core.pad import OFFSET
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import poses_unknown
from tactsim.core.source_digest import source_digest
from tactsim.estimators import NONE, Estimate, Estimator
from tactsim.estimators.estimator import check_estimate, flatten_work, name_of, no_exit, unflatten_work
from tactsim.estimators.registry import load

if TYPE_CHECKING:
    from tactsim.core.forward import ForwardModel

# Columns of an answer that are numbers
_ANSWERED = "p_truth", "p_label", "credibility", "radius_90", "nees"
_FAR = 100.0  # times the usual offset: beyond what an estimator takes for near


class Touch(NamedTuple):
    """One touch of a trial.

    number: which of the trial's touches. reading: (taxels,) kPa, or its images (frames, taxels), or those of m pads (m,
    taxels). sensor_in_robot: (3,), or of m pads (m, 7). more: what trials of its kind hold of a touch beside that.
    """

    number: int
    reading: FloatArray
    sensor_in_robot: FloatArray
    more: Mapping[str, Any] = {}


class Touches(Protocol):
    """The touches of one trial, among which the next is chosen; `ListedTouches` are those in the plane."""

    def shuffle(self, rng: np.random.Generator) -> None:
        """Take them in random order, where it is not random anyway."""

    def offer(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses (n, 3 or 7) sensor_in_robot of those that can be taken now, the object being where it is."""

    def take(self, chosen: int, robot_in_object: FloatArray) -> Touch | None:
        """Take one of those just offered; None if it gives no reading."""


class Press(Protocol):
    """What presses the touches of a trial on demand; `OnDemand` does in the plane."""

    def touches(self, truth: str, trial: int, seed: int) -> Touches:
        """Offer the touches of one trial."""


class ListedTouches:
    """Touches in the plane that are known before the first is taken, numbered from 0.

    Each is taken once, in their order unless they are shuffled; see `Touches`.
    """

    def __init__(self, count: int) -> None:
        self._left = np.arange(count)
        self._where = b""  # the object at `_poses`, as bytes: arrays take longer to compare

    def sensor_in_robot(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses (n, 3) of all touches, the object being where it is."""
        raise NotImplementedError

    def reading(self, index: int, robot_in_object: FloatArray) -> FloatArray | None:
        """Give one reading: (taxels,) kPa, or its images (frames, taxels), or None if there is none."""
        raise NotImplementedError

    def shuffle(self, rng: np.random.Generator) -> None:
        """Take them in random order."""
        self._left = rng.permutation(len(self._left))

    def offer(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses (n, 3) of those that were not taken yet."""
        where = robot_in_object.tobytes()
        if where != self._where:
            self._where, self._poses = where, self.sensor_in_robot(robot_in_object)
        return self._poses[self._left]

    def take(self, chosen: int, robot_in_object: FloatArray) -> Touch | None:
        """Take one of those just offered; None if it gives no reading."""
        number = int(self._left[chosen])
        self._left = np.delete(self._left, chosen)
        reading = self.reading(number, robot_in_object)
        return None if reading is None else Touch(number, reading, self._poses[number])


class RecordedTouches(ListedTouches):
    """The test readings of a scan, around the object."""

    def __init__(self, test: Scan) -> None:
        super().__init__(len(test))
        self._test = test

    def sensor_in_robot(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses (n, 3) at which the readings were taken, moved with the object."""
        return compose(invert(robot_in_object), self._test.poses)

    def reading(self, index: int, robot_in_object: FloatArray) -> FloatArray | None:
        """Give the reading of this index, wherever the object is."""
        return self._test.readings[index]


def _counted_presses(scan: Scan) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give the press of each reading (n,), and how many readings that has (n,)."""
    press = scan.press_numbers
    _, which, count = np.unique(press, return_inverse=True, return_counts=True)
    return press, count[which.reshape(-1)]


def presses_with(scan: Scan, readings: int) -> NDArray[np.int64]:
    """List the presses of a scan, by number, that have so many readings: (n,)."""
    press, count = _counted_presses(scan)
    return np.unique(press[count >= readings])


Explore = Literal["random", "information", "blind"]
Progress = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Report no progress."""


@dataclass(frozen=True)
class OneTrial:
    """One trial to be done: which letter, and its number among that letter's trials."""

    truth: str
    trial: int


def sure_enough(p_label: FloatArray | float, stop_at: float) -> NDArray[np.bool_]:
    """Tell where a recognition may end: where the most probable label has at least the probability `stop_at`."""
    return np.asarray(p_label) >= stop_at


@dataclass(frozen=True)
class TrialRules:
    """The rules of a trial, made once from a run's configuration and handed on whole.

    readings: touches at most. seed: of all trials. explore: in which order touches come. moving: how the object moves
    between them. press: what presses on demand; None if the readings are those of the scan. measured: whether those
    were measured for the trials, for each letter those of its first trial, then the next. each_held_out: whether the
    letter of a trial is left out of what the estimator knows. stop_at: the probability of the most probable label at
    which a trial ends before it has all its touches; None if it does not.
    """

    readings: int
    seed: int
    explore: Explore = "random"
    moving: Slip = STILL
    press: Press | None = None
    measured: bool = False
    each_held_out: bool = False
    stop_at: float | None = None

    @classmethod
    def of(cls, config: Any, press: Press | None) -> TrialRules:
        """Take from a run's configuration all rules that it states, each under the rule's own name."""
        stated = {one.name: getattr(config, one.name) for one in fields(cls) if hasattr(config, one.name)}
        return cls(**stated, press=press)


NOT_TAKEN = -2  # what `Trials.touch_index` says of touches that an ended trial did not take


@dataclass(frozen=True, eq=False)
class Trials:
    """What was estimated after every reading of n trials of r readings: the raw result of a run.

    truth: (n,) letters. known: (n,) whether the estimator was trained on that letter; if not, NONE is the right
    label. trial: (n,) number within the letter. true_pose: (n, r, 3 or 7) robot_in_object at each touch.
    touch_index: (n, r) which of the letter's test readings, or of the trial's touches, was taken, and NOT_TAKEN after
    the trial had ended, from where on all else repeats what was answered last. label: (n, r) the estimate (eq. 9, 14).
    p_truth, p_label: (n, r) probabilities given to the right and to the estimated label. pose: (n, r, 3 or 7)
    estimated robot_in_object. credibility, radius_90, nees: (n, r) how sure the estimator was of the pose, see
    `placement.Certainty`; NaN where it did not say. evaluations: (n, r) likelihood evaluations of that update.
    update_s, estimate_s, propose_s: (n, r) seconds of processor time. kind: of the run (`tactsim.bench.kinds`).
    """

    kind: ClassVar[str] = PLANE
    truth: NDArray[np.str_]
    known: NDArray[np.bool_]
    trial: NDArray[np.int64]
    true_pose: FloatArray
    touch_index: NDArray[np.int64]
    label: NDArray[np.str_]
    p_truth: FloatArray
    p_label: FloatArray
    pose: FloatArray
    credibility: FloatArray
    radius_90: FloatArray
    nees: FloatArray
    evaluations: NDArray[np.int64]
    update_s: FloatArray
    estimate_s: FloatArray
    propose_s: FloatArray

    @property
    def ids(self) -> list[tuple[str, int]]:
        """Name each trial: its letter, and its number within the letter."""
        return list(zip(self.truth.tolist(), self.trial.tolist(), strict=True))

    @property
    def taken(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether that touch was taken: means of costs count no other."""
        return self.touch_index != NOT_TAKEN

    @property
    def touches(self) -> NDArray[np.int64]:
        """Count the touches that each trial took (n,)."""
        return self.taken.sum(axis=1)

    @property
    def answer(self) -> NDArray[np.str_]:
        """Give the right labels (n,): the true letters, or NONE where they are not known."""
        return np.where(self.known, self.truth, NONE)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Tell for (n, r) whether the estimated label is the right one."""
        return self.label == self.answer[:, None]

    @property
    def places(self) -> bool:
        """Tell whether any estimate says where the object lies, and not the middle of the prior."""
        return bool(self.pose[..., :2].any())

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

    @staticmethod
    def joined(parts: Iterable[Trials]) -> Trials:
        """Put trials of one kind together in the order given."""
        parts = list(parts)
        kind = type(parts[0])
        return kind(*(np.concatenate([getattr(part, of.name) for part in parts]) for of in fields(kind)))


def draw_true_pose(
    rng: np.random.Generator, offsets: float = OFFSET, *, poses_unknown: bool = False
) -> FloatArray:
    """Draw robot_in_object: x, y uniform in [-offsets, offsets] mm, theta uniform on the circle (section IV).

    Where poses are unknown the robot stands a hundred times as far away as else, in any direction: it knows how its
    touches lie to the first, and nothing of where that is on the object.
    """
    x, y = rng.uniform(-offsets, offsets, size=2)
    if poses_unknown:
        direction = np.arctan2(y, x)
        x, y = _FAR * offsets * np.cos(direction), _FAR * offsets * np.sin(direction)
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
                    f"{split}`), name them when you import (`bench import --split`, or the column split of a CSV), or "
                    "take them from another scan (`bench run --scan TEST --train-scan TRAIN`)"
                )
        test = scan.where("test", letter)
        if poses_unknown(scan.meta) and readings > (most := int(_counted_presses(test)[1].max())):
            raise InputError(
                f"{readings} readings a trial: poses are unknown, so a trial takes the readings of one press, and no "
                f"test press of {letter!r} has more than {most}; ask for at most {most} (--readings {most})"
            )
        check_count(letter, len(test), readings)


def check_count(letter: str, count: int, readings: int) -> None:
    """Raise InputError if a letter has fewer test readings, `count`, than a trial takes."""
    if readings > count:
        raise InputError(
            f"{readings} readings a trial: letter {letter!r} has {count} test readings, drawn without "
            f"replacement; ask for at most {count}"
        )


class _UnderWay:
    """A trial that is under way: where the object is at each touch, which touches were taken, what was answered."""

    def __init__(
        self, test: Scan, task: OneTrial, rules: TrialRules, *, letters: Sequence[str], of: Placement
    ) -> None:
        """Hide the object; see `run_trial`."""
        rng, press, readings = generator(rules.seed, task, 0), rules.press, rules.readings
        self._kind = kinds.load(test.kind)
        first = self._kind.hide(test, rng)
        self._touches: Touches = RecordedTouches(test)
        if press is not None:
            self._touches = press.touches(task.truth, task.trial, rules.seed)
        if rules.explore != "information":
            self._touches.shuffle(rng)
        self._true_pose = np.tile(first, (readings, 1))
        if not rules.moving.still:
            self._true_pose = rules.moving.poses(first, readings, generator(rules.seed, task, 2))
        self.readings, self._stop_at = readings, rules.stop_at
        self._task, self._letters, self._of = task, letters, of
        self._taken: list[Touch] = []
        self._label: list[str] = []
        measured = (*_ANSWERED, "update_s", "estimate_s", "propose_s")
        self._numbers = {name: np.zeros(readings) for name in measured}
        self._evaluations = np.zeros(readings, dtype=np.int64)
        self._pose = np.empty((readings, len(first)))

    @property
    def ended(self) -> bool:
        """Tell whether all touches were answered, or the last answer was sure enough."""
        k = len(self._label)
        if k == self.readings or self._stop_at is None or not k:
            return k == self.readings
        return bool(sure_enough(self._numbers["p_label"][k - 1], self._stop_at))

    def touch(self, choose: Callable[[FloatArray], int] | None = None) -> Touch:
        """Take the next touch that gives a reading, or that `choose` names of sensor_in_robot (n, 3 or 7)."""
        k, touch = len(self._taken), None
        while touch is None:
            candidates = self._touches.offer(self._true_pose[k])
            if not len(candidates):
                more = f"no other press of {self._task.truth!r} comes to rest"
                raise InputError(f"{self.readings} readings a trial: {more}")
            chosen = 0
            if choose is not None:
                start = process_time()
                chosen = choose(candidates)
                self._numbers["propose_s"][k] += process_time() - start
            touch = self._touches.take(chosen, self._true_pose[k])
        self._taken.append(touch)
        return touch

    def record(
        self, estimator: Estimator, estimate: Estimate, update_s: float, estimate_s: float, evaluations: int
    ) -> None:
        """Note what was estimated after the next of the touches, checked, with the time that it took."""
        check_estimate(estimate, estimator, (*self._letters, NONE))
        k, numbers = len(self._label), self._numbers
        self._label.append(estimate.label)
        right = self._task.truth if self._task.truth in self._letters else NONE
        numbers["p_truth"][k] = estimate.probabilities.get(right, 0.0)
        numbers["p_label"][k] = estimate.probabilities[estimate.label]
        self._pose[k] = estimate.robot_in_object
        sure = certainty(estimate, self._true_pose[k], self._of)
        numbers["credibility"][k], numbers["radius_90"][k] = sure.credibility, sure.radius
        numbers["nees"][k] = sure.nees
        numbers["update_s"][k], numbers["estimate_s"][k] = update_s, estimate_s
        self._evaluations[k] = evaluations

    def finished(self) -> Trials:
        """Give the trial; what came after it ended repeats the last answer and cost nothing."""
        task, k, rest = self._task, len(self._label), self.readings - len(self._label)
        taken = self._taken[:k]
        for name in _ANSWERED:
            self._numbers[name][k:] = self._numbers[name][k - 1]
        self._pose[k:], self._true_pose[k:] = self._pose[k - 1], self._true_pose[k - 1]
        columns: dict[str, Any] = {
            "truth": np.array([task.truth]), "known": np.array([task.truth in self._letters]),
            "trial": np.array([task.trial]), "true_pose": self._true_pose[None],
            "touch_index": np.array([[touch.number for touch in taken] + [NOT_TAKEN] * rest]),
            "label": np.array([self._label + self._label[-1:] * rest]),
            "pose": self._pose[None], "evaluations": self._evaluations[None],
            **{name: values[None] for name, values in self._numbers.items()},
        }  # fmt: skip
        for field in fields(self._kind.trials)[len(fields(Trials)) :]:
            columns[field.name] = np.array([[touch.more[field.name] for touch in taken + taken[-1:] * rest]])
        return self._kind.trials(**columns)


def run_trial(
    estimator: Estimator,
    test: Scan,
    task: OneTrial,
    rules: TrialRules,
    *,
    letters: Sequence[str],
    of: Placement,
    observe: Callable[[Estimate, Touch], None] | None = None,
) -> Trials:
    """Recognise one hidden object: present readings of it by the rules, estimate after each.

    `test` holds the letter's test readings only; `letters` are those that the estimator was trained on; `of` are
    the letter's properties, for the metric of its placement.
    Touches come in random order without replacement, or, with explore="information", as the estimator proposes.
    They are the test readings, or those of `rules.press`. Where the object moves between touches, the poses of test
    readings, candidates too, are those that go with its pose at that touch. observe(estimate, touch) is called after
    each touch, and its time does not count. Times are of this process's processor time, so that other programs on the
    machine do not count.

    Raises InputError that names the estimator if its answer is not a valid estimate or proposal, and if the presses
    that are left do not come to rest.
    """
    trial = _UnderWay(test, task, rules, letters=letters, of=of)
    estimator.reset(generator(rules.seed, task, 1))
    before = _evaluations(estimator)
    choose = partial(proposed, estimator) if rules.explore == "information" else None
    while not trial.ended:
        touch = trial.touch(choose)
        start = process_time()
        estimator.update(touch.reading, touch.sensor_in_robot)
        updated = process_time()
        estimate = estimator.estimate()
        answered, after = process_time(), _evaluations(estimator)
        trial.record(estimator, estimate, updated - start, answered - updated, after - before)
        before = after
        if observe is not None:
            observe(estimate, touch)
    return trial.finished()


def _run_together(estimator: Estimator, trials: Sequence[_UnderWay]) -> list[Trials]:
    """Recognise the objects of several trials at once; time and evaluations are shared among all readings."""
    touches = [[trial.touch() for _ in range(trial.readings)] for trial in trials]
    seen = np.array([[touch.reading for touch in of_trial] for of_trial in touches])
    poses = np.array([[touch.sensor_in_robot for touch in of_trial] for of_trial in touches])
    start, before = process_time(), _evaluations(estimator)
    estimates = estimator.estimates(seen, poses)
    seconds = (process_time() - start) / seen[..., 0].size
    evaluations = (_evaluations(estimator) - before) // seen[..., 0].size
    if [len(of_trial) for of_trial in estimates] != [len(of_trial) for of_trial in touches]:
        raise InputError(
            f"the estimator {type(estimator).__name__} is broken: `estimates` gave no estimate for each of "
            f"{len(touches[0])} readings of each of {len(touches)} trials"
        )
    for trial, of_trial in zip(trials, estimates, strict=True):
        for estimate in of_trial:
            if not trial.ended:
                trial.record(estimator, estimate, seconds, 0.0, evaluations)
    return [trial.finished() for trial in trials]


def proposed(estimator: Estimator, candidates: FloatArray) -> int:
    """Let an estimator choose among touches sensor_in_robot (n, 3 or 7): its index.

    Raises InputError that names the estimator if it proposes no touches, or something that is none of them.
    """
    chosen = estimator.propose(candidates)
    if not (isinstance(chosen, int | np.integer) and 0 <= chosen < len(candidates)):
        raise InputError(
            f"the estimator {type(estimator).__name__} is broken: it proposed {short(chosen)} of {len(candidates)}"
        )
    return int(chosen)


def _evaluations(estimator: Estimator) -> int:
    return flatten_work(estimator.work).get("likelihood_evaluations", 0)


def compile_for(kind: type[Estimator]) -> None:
    """Compile the inner loops of the room that an estimator is of: none is compiled in the middle of a trial."""
    compile_waiting("tactsim.estimators")
    compile_waiting(".".join(kind.__module__.split(".")[:2]))


def fit(estimator: Estimator, scan: Scan, forward: Callable[[Scan], ForwardModel] | None) -> None:
    """Fit an estimator to the training readings of a scan; one that asks for it gets `forward` of the scan first.

    Raises InputError if the estimator needs a forward model, and there is none, or nothing says how it presses.
    """
    compile_for(type(estimator))
    with no_exit(name_of(estimator)):
        if forward is not None and estimator.uses_forward_model:
            estimator.bring(forward(scan))
        estimator.fit(scan)


@dataclass(frozen=True, eq=False)
class TrialPlan:
    """All that a worker needs to do trials: the estimator, the scan, and the rules.

    forward: what makes the forward model of a scan, for an estimator that asks for one. given: an estimator made in
    Python, as it is or pickled for a worker; None if `estimator` is a registered name. objects: what the error needs of
    each; by default what the scan says of them.
    """

    estimator: str
    options: Mapping[str, Any]
    scan: Scan
    rules: TrialRules
    forward: Callable[[Scan], ForwardModel] | None = None
    given: Estimator | bytes | None = None
    objects: Mapping[str, Placement] | None = None

    def test_readings(self, task: OneTrial) -> Scan:
        """Give the test readings of a letter that a trial may take.

        Those measured for the trials are its own. Where nobody knows how the presses lie to each other, but how the
        windows of one do, they are those of one press: the presses that have enough in turn, from any of them on.
        """
        test, readings = self.scan.where("test", task.truth), self.rules.readings
        if self.rules.measured:
            return test.chosen(np.arange(task.trial * readings, (task.trial + 1) * readings))
        if not poses_unknown(self.scan.meta):
            return test
        enough = presses_with(test, readings)
        first = generator(self.rules.seed, OneTrial(task.truth, 0), 4).integers(len(enough))
        return test.chosen(_counted_presses(test)[0] == enough[(first + task.trial) % len(enough)])

    def fitted_for(self, truth: str, estimator: Estimator) -> tuple[Estimator, tuple[str, ...]]:
        """Give what the trials of a letter need: the fitted `estimator`, and the letters that it knows.

        Where each letter is held out, both are without this one.
        """
        trained = self.scan.where("train").letters
        if not self.rules.each_held_out:
            return estimator, trained
        return estimator.without(truth, self.scan), tuple(letter for letter in trained if letter != truth)


def source_of_trials(estimator: str | Estimator) -> str:
    """Hash the source code that trials of an estimator may depend on: tactsim's, and that of the estimator's packages.

    Raises InputError if no estimator has that name.
    """
    kinds = [load(estimator)] if isinstance(estimator, str) else _kinds(estimator)
    return source_digest(*(kind.__module__ for kind in kinds))


def _kinds(estimator: Estimator) -> list[type[Estimator]]:
    """List the class of an estimator and of those that it wraps."""
    inner = [value for value in vars(estimator).values() if isinstance(value, Estimator)]
    return [type(estimator), *(kind for one in inner for kind in _kinds(one))]


def run_trials(
    plan: TrialPlan, estimator: Estimator, tasks: Sequence[OneTrial], *, progress: Progress
) -> tuple[Trials, dict[str, Any]]:
    """Do trials here with a fitted estimator; returns them in the order of `tasks`, and the estimator's work.

    progress("trials", done, total) is called after each.
    """
    objects = plan.objects or properties(plan.scan)
    work: Counter[str] = Counter()
    done: list[Trials] = []
    progress("trials", 0, len(tasks))
    with no_exit(plan.estimator):
        for truth, of_letter in groupby(tasks, key=lambda task: task.truth):
            fitted, letters = plan.fitted_for(truth, estimator)
            before = Counter(flatten_work(fitted.work))
            words: dict[str, Any] = {"rules": plan.rules, "letters": letters, "of": objects[truth]}
            hidden = ((plan.test_readings(task), task) for task in of_letter)
            if fitted.answers_together and plan.rules.explore != "information":
                done += _run_together(fitted, [_UnderWay(test, task, **words) for test, task in hidden])
                progress("trials", len(done), len(tasks))
            for test, task in hidden:
                done.append(run_trial(fitted, test, task, **words))
                progress("trials", len(done), len(tasks))
            work.update(flatten_work(fitted.work))
            work.subtract(before)
    return Trials.joined(done), unflatten_work(work)
