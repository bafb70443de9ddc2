"""The checks: each takes a `Case` and raises AssertionError, with what it saw, if the estimator breaks its word."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from tactsim.core import InputError, Scan, compose, invert, transform
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Estimator, check_estimate

# Bars as (centre x, centre y, half length x, half length y) mm, axis-aligned and disjoint.
SHAPES: dict[str, list[tuple[float, float, float, float]]] = {
    "E": [(-6.5, 0, 2.25, 12), (2, 9.75, 6.25, 2.25), (2, 0, 6.25, 2.25), (2, -9.75, 6.25, 2.25)],
    "I": [(0, 0, 2.25, 12)],
    "L": [(-6, 0, 2.25, 12), (2, -9.75, 5.75, 2.25)],
    "T": [(0, -2.25, 2.25, 9.75), (0, 9.75, 10, 2.25)],
}


def square_pad(rows: int = 6, columns: int = 6, pitch: float = 1.9) -> FloatArray:
    """Lay out taxels (rows * columns, 2) mm."""
    x, y = (np.arange(n) * pitch - (n - 1) * pitch / 2 for n in (columns, rows))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def paper_poses(positions: int = 4, angles: int = 12) -> FloatArray:
    """List the paper's sensor_in_object poses (n, 3), or a coarser grid over the same square."""
    steps = np.linspace(-10.2, 10.2, positions)
    turns = np.arange(angles) * 2 * np.pi / angles
    return np.array([[x, y, a] for a in turns for y in steps for x in steps])


def pressures(shape: str, points: FloatArray, blur: float = 1.2) -> FloatArray:
    """Blur a shape's footprint with a Gaussian of `blur` mm: 0 to 1 at points (..., 2) mm."""
    total = np.zeros(points.shape[:-1])
    for *middle, half_x, half_y in SHAPES[shape]:
        ends = _ends(points, middle, (half_x, half_y), blur)
        total += np.prod(erf(ends[0]) - erf(ends[1]), axis=-1) / 4
    return total


def _with_gradient(shape: str, points: FloatArray, blur: float = 1.2) -> tuple[FloatArray, FloatArray]:
    """Give `pressures` at points (..., 2) mm, and its derivatives by x and y: (...), and (..., 2) in mm^-1."""
    total, gradient = np.zeros(points.shape[:-1]), np.zeros(points.shape)
    for *middle, half_x, half_y in SHAPES[shape]:
        ends = _ends(points, middle, (half_x, half_y), blur)
        within = erf(ends[0]) - erf(ends[1])
        slope = np.exp(-(ends[0] ** 2)) - np.exp(-(ends[1] ** 2))
        total += np.prod(within, axis=-1) / 4
        gradient += slope * within[..., ::-1] / 4
    return total, gradient * (2 / np.pi) ** 0.5 / blur


def _ends(
    points: FloatArray, middle: Sequence[float], half: tuple[float, float], blur: float
) -> tuple[FloatArray, FloatArray]:
    """Say how far points (..., 2) are from a bar's left and lower edges, and from the others, in sqrt(2) blurs."""
    away = points - np.array(middle)
    return (away + half) / blur / 2**0.5, (away - half) / blur / 2**0.5


def make_scan(
    shapes: str = "EILT",
    taxel_xy: FloatArray | None = None,
    poses: FloatArray | None = None,
    noise: float = 2.0,
    seed: int = 0,
) -> Scan:
    """Press every shape at every pose (n, 3), once for training and once for testing; noise in kPa."""
    rng = np.random.default_rng(seed)
    pad = square_pad() if taxel_xy is None else taxel_xy
    grid = paper_poses() if poses is None else poses
    readings = [pressures(shape, transform(grid, pad)) * 30 for shape in shapes for _ in range(2)]
    shaken = np.concatenate(readings) + noise * rng.standard_normal((2 * len(shapes) * len(grid), len(pad)))
    return Scan(
        readings=np.round(shaken / 0.7) * 0.7,
        poses=np.tile(grid, (2 * len(shapes), 1)),
        labels=np.repeat(list(shapes), 2 * len(grid)),
        split=np.tile(np.repeat(["train", "test"], len(grid)), len(shapes)),
        taxel_xy=pad,
    )


class BarForward:
    """The forward model of the readings that `make_scan` makes."""

    noise = 2.0
    turns = 1

    def __init__(self, shapes: str, taxel_xy: FloatArray) -> None:
        self.letters = tuple(shapes)
        self.taxel_xy, self.taxels = taxel_xy, len(taxel_xy)
        self.reach: Mapping[str, float] = dict.fromkeys(shapes, 18.0 + float(np.hypot(*taxel_xy.T).max()))
        self.symmetry: Mapping[str, int] = dict.fromkeys(shapes, 1)

    def readings(self, letter: str, sensor_in_object: FloatArray) -> FloatArray:
        """Predict readings (..., taxels) kPa at poses (..., 3)."""
        return 30 * pressures(letter, transform(sensor_in_object, self.taxel_xy))

    def linearised(
        self,
        letter: str,
        sensor_in_object: FloatArray,
        off: FloatArray | None = None,
        load: FloatArray | None = None,
    ) -> Linearised:
        """Predict; nothing is unknown of a press but its load, so `off` has no columns."""
        mean, slope = _with_gradient(letter, transform(sensor_in_object, self.taxel_xy))
        cosine, sine = np.cos(sensor_in_object[:, 2, None]), np.sin(sensor_in_object[:, 2, None])
        # Along the pad's own axes, as moves of the sensor are counted.
        by_x = cosine * slope[..., 0] + sine * slope[..., 1]
        by_y = cosine * slope[..., 1] - sine * slope[..., 0]
        turning = by_y * self.taxel_xy[:, 0] - by_x * self.taxel_xy[:, 1]
        share = 30 * (np.ones(len(mean)) if load is None else load)
        mean, by_pose = share[:, None] * mean, share[:, None, None] * np.stack([by_x, by_y, turning], axis=1)
        return Linearised(mean, by_pose, mean[:, None] if load is not None else mean[:, None][:, :0])


def fit(estimator: Estimator, scan: Scan) -> None:
    """Fit an estimator to a scan of `make_scan`, and bring it a forward model if it asks for one."""
    if estimator.uses_forward_model:
        estimator.bring(BarForward("".join(scan.letters), scan.taxel_xy))
    estimator.fit(scan)


# label, probabilities, robot_in_object: an estimate as it can be compared
Answer = tuple[str, dict[str, float], list[float]]

TAXELS = 36
_POSES = paper_poses(positions=4, angles=6)


class Case:
    """An estimator to check: how it is made, what it learns from, and one that has learned."""

    def __init__(self, make: Callable[[], Estimator]) -> None:
        """Take a function that makes a new estimator each time, as `lambda: create("my-estimator")` does."""
        self.make = make
        self.scan = make_scan("EIL", poses=_POSES)

    @cached_property
    def learned(self) -> Estimator:
        """Give an estimator that is fitted to the scan, the same one for all checks."""
        estimator = self.make()
        fit(estimator, self.scan)
        return estimator

    @property
    def labels(self) -> tuple[str, ...]:
        """List the objects that were learned."""
        return self.scan.letters

    def trial(self, label: str | None = None, count: int = 4, seed: int = 5) -> tuple[FloatArray, FloatArray]:
        """Draw a hidden object by the paper's protocol: readings (count, 36) and sensor_in_robot (count, 3)."""
        return draw(self.scan, label or self.labels[0], count, seed)

    def still(self, count: int, far: float = 0.0) -> FloatArray:
        """Give poses sensor_in_robot (count, 3), all the same one, `far` mm away along x and y."""
        return np.tile([far, -far, 0.0], (count, 1))


def draw(scan: Scan, label: str, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Hide an object somewhere, and touch it: readings (count, taxels) kPa and sensor_in_robot (count, 3)."""
    rng = np.random.default_rng(seed)
    test = scan.where("test", label)
    robot_in_object = np.array([*rng.uniform(-10, 10, 2), rng.uniform(-np.pi, np.pi)])
    chosen = rng.permutation(len(test))[:count]
    return test.readings[chosen], compose(invert(robot_in_object), test.poses[chosen])


def answers(
    estimator: Estimator, readings: Iterable[ArrayLike], poses: Iterable[ArrayLike], seed: int = 0
) -> list[Answer]:
    """Run a sequence from a reset; the estimate after each reading."""
    estimator.reset(np.random.default_rng(seed))
    estimates = []
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        estimates.append(_answer(estimator.estimate()))
    return estimates


def _answer(estimate: Estimate) -> Answer:
    return estimate.label, dict(estimate.probabilities), np.asarray(estimate.robot_in_object).tolist()


def _hold(held: object, message: str) -> None:
    if not held:
        raise AssertionError(message)


def _refused(call: Callable[[], object], *words: str) -> None:
    """Raise AssertionError unless the call raises InputError with all these words."""
    try:
        call()
    except InputError as error:
        for word in words:
            _hold(word in str(error), f"InputError should say {word!r}; it says {error}")
        return
    raise AssertionError(f"it should raise InputError that says {' and '.join(words)}; it raises nothing")


def _normalised(probabilities: dict[str, float]) -> bool:
    return abs(sum(probabilities.values()) - 1) < 1e-6


def calls_out_of_order_are_refused(case: Case) -> None:
    """Name what is missing in `reset`, `update`, `estimate` before `fit`, and in the last two before `reset`."""
    readings, poses = case.trial()
    estimator = case.make()
    _refused(lambda: estimator.reset(np.random.default_rng(0)), "fit")
    _refused(lambda: estimator.update(readings[0], poses[0]), "fit")
    _refused(estimator.estimate, "fit")
    fit(estimator, case.scan.where(label=case.labels[0]))
    _refused(lambda: estimator.update(readings[0], poses[0]), "reset")
    _refused(estimator.estimate, "reset")


def a_scan_without_training_readings_is_refused(case: Case) -> None:
    """Say in `fit` that there is nothing to train on."""
    _refused(lambda: fit(case.make(), case.scan.where("test")), "train")


def options_are_described(case: Case) -> None:
    """Describe every option; `bench list estimators NAME` shows it."""
    for name, field in type(case.make()).options_type.model_fields.items():
        _hold(field.description, f"the option {name} has no description")


def estimates_are_probabilities_and_poses(case: Case) -> None:
    """Give every letter a probability before and after each reading, summing to 1, and a finite pose."""
    case.learned.reset(np.random.default_rng(0))
    for reading, pose in zip(*case.trial(), strict=True):
        estimate = case.learned.estimate()
        check_estimate(estimate, case.learned, (*case.labels, "none"))
        missing = set(case.labels) - set(estimate.probabilities)
        _hold(not missing, f"no probability for {missing}")
        case.learned.update(reading, pose)


def a_bad_reading_is_refused_and_leaves_no_trace(case: Case) -> None:
    """Refuse a NaN, an infinity and a wrong length by name; the estimates that follow are as if it had not been."""
    spoilt: list[tuple[Callable[[FloatArray, FloatArray], tuple[ArrayLike, ArrayLike]], str]] = [
        (lambda z, p: (np.where(np.arange(len(z)) == 3, np.nan, z), p), "reading[3]"),
        (lambda z, p: (np.where(np.arange(len(z)) == 0, np.inf, z), p), "reading[0]"),
        (lambda z, p: (z[:-1], p), f"{TAXELS} taxels"),
        (lambda z, p: (z.reshape(6, 6), p), f"{TAXELS} taxels"),
        (lambda z, p: (z, p[:2]), "sensor_in_robot"),
        (lambda z, p: (z, np.where(np.arange(len(p)) == 1, np.nan, p)), "sensor_in_robot"),
    ]
    readings, poses = case.trial()
    clean = answers(case.learned, readings, poses)
    for spoil, words in spoilt:
        case.learned.reset(np.random.default_rng(0))
        after_bad = []
        for reading, pose in zip(readings, poses, strict=True):
            bad = spoil(reading, pose)
            _refused(lambda bad=bad: case.learned.update(*bad), words)  # type: ignore[misc]
            case.learned.update(reading, pose)
            after_bad.append(_answer(case.learned.estimate()))
        _hold(after_bad == clean, f"a reading that was refused ({words}) changed the estimates")


def the_same_seed_gives_the_same_answer(case: Case) -> None:
    """Take all randomness from the rng of `reset`."""
    first, second = (answers(case.learned, *case.trial(), seed=3) for _ in range(2))
    _hold(first == second, f"two sequences from one seed differ: {first[-1]} and {second[-1]}")


def an_estimator_that_says_it_draws_nothing_draws_nothing(case: Case) -> None:
    """Give the same answer for another seed if `draws` is False."""
    if not case.learned.draws:
        first, second = (answers(case.learned, *case.trial(), seed=seed) for seed in (3, 4))
        _hold(first == second, "`draws` is False, but the seed changes the estimates")


def reset_forgets_the_sequence_and_keeps_the_maps(case: Case) -> None:
    """Recognise an object after another one as before it."""
    first = answers(case.learned, *case.trial())
    answers(case.learned, *case.trial(case.labels[1], count=7, seed=6), seed=8)
    again = answers(case.learned, *case.trial())
    _hold(again == first, "what was felt before `reset` changes the estimates after it")


def looking_changes_nothing(case: Case) -> None:
    """Leave the estimates as they are when `estimate` and `belief_over_plane` are called between readings."""
    readings, poses = case.trial()
    plain = answers(case.learned, readings, poses)
    case.learned.reset(np.random.default_rng(0))
    looked = []
    for reading, pose in zip(readings, poses, strict=True):
        case.learned.update(reading, pose)
        plane = case.learned.belief_over_plane()
        if plane is not None:
            shape = len(plane.labels), len(plane.y), len(plane.x)
            _hold(plane.probability.shape == shape, f"the belief over the plane should have shape {shape}")
            _hold(abs(plane.probability.sum() - 1) < 1e-6, "the belief over the plane does not sum to 1")
        case.learned.estimate()
        looked.append(_answer(case.learned.estimate()))
    _hold(looked == plain, "looking at the belief changed the estimates")


def inputs_are_not_written_to(case: Case) -> None:
    """Take readings and poses that cannot be written to, and leave them as they are."""
    readings, poses = (np.array(array) for array in case.trial())
    kept = readings.copy(), poses.copy()
    for array in (readings, poses):
        array.setflags(write=False)
    answers(case.learned, readings, poses)
    _hold((readings == kept[0]).all() and (poses == kept[1]).all(), "an input was changed")


def readings_may_come_as_lists_and_as_whole_numbers(case: Case) -> None:
    """Look at the numbers, and not at the type that they come in."""
    readings, poses = case.trial()
    whole = np.round(readings).astype(np.int32)
    listed = answers(case.learned, whole.tolist(), poses.tolist())
    _hold(listed == answers(case.learned, whole, poses), "lists and arrays of the same numbers differ")


def readings_without_contrast_are_taken(case: Case) -> None:
    """Give probabilities also for pressures all zero, below zero or far above all that was trained."""
    for pressure in (0.0, -3.0, 1e6):
        for _, probabilities, _ in answers(case.learned, np.full((3, TAXELS), pressure), case.still(3)):
            _hold(_normalised(probabilities), f"readings of {pressure:g} kPa: {probabilities}")


def a_pose_far_away_is_taken(case: Case) -> None:
    """Give probabilities also for a touch where no object can be."""
    readings, poses = case.trial()
    for far in (1e2, 1e5, 9e8):
        for _, probabilities, _ in answers(case.learned, readings, case.still(len(poses), far)):
            _hold(_normalised(probabilities), f"a touch {far:g} mm away: {probabilities}")


def work_is_counted(case: Case) -> None:
    """Count work as JSON; a count grows if the estimator counts at all, and none is negative."""
    before, done = dict(case.learned.work), "likelihood_evaluations"
    _hold({done, "skipped"} <= set(before), f"work lacks one of its two counts: {before}")
    answers(case.learned, *case.trial())
    work = case.learned.work
    _hold(json.loads(json.dumps(work)) == work, f"work is no JSON: {work}")
    if type(case.learned).work is not Estimator.work:
        _hold(work[done] > before[done], f"{done} did not grow")
    _hold(all(count >= 0 for count in work["skipped"].values()), f"a count is negative: {work['skipped']}")


def a_proposal_is_a_candidate(case: Case) -> None:
    """Choose one of the readings that are offered, if the estimator proposes any."""
    readings, poses = case.trial()
    answers(case.learned, readings, poses)
    if case.learned.proposes:
        try:
            index = case.learned.propose(poses[:3])
        except InputError:
            return  # its options say that it explores at random
        _hold(index in range(3), f"of three candidates it chose number {index}")


def many_trials_at_once_are_as_one_by_one(case: Case) -> None:
    """Answer many trials at once as one after another, to 1e-5, if the estimator answers so at all."""
    if not case.learned.answers_together:
        return
    _hold(not case.learned.draws, "it answers many trials at once, and says that it draws: draws = False")
    trials = [case.trial(label, seed=seed) for seed, label in enumerate(case.labels)]
    readings, poses = (np.array(part) for part in zip(*trials, strict=True))
    for together, trial in zip(case.learned.estimates(readings, poses), trials, strict=True):
        for one, (label, probabilities, pose) in zip(together, answers(case.learned, *trial), strict=True):
            same = one.label == label and np.allclose(one.robot_in_object, pose, atol=1e-5)
            same &= all(abs(one.probabilities[name] - p) < 1e-5 for name, p in probabilities.items())
            _hold(same, f"of many trials at once it says {one}; alone {label} {probabilities} at {pose}")


def readings_to_test_with_teach_nothing(case: Case) -> None:
    """Learn the same from two scans that differ in their test readings alone."""
    other = make_scan("EIL", poses=_POSES, seed=1)
    test = case.scan.split == "test"
    swapped = Scan(
        np.where(test[:, None], other.readings, case.scan.readings), case.scan.poses, case.scan.labels,
        case.scan.split, case.scan.taxel_xy,
    )  # fmt: skip
    theirs = case.make()
    fit(theirs, swapped)
    same = answers(case.learned, *case.trial()) == answers(theirs, *case.trial())
    _hold(same, "what was learned depends on the test readings")


def any_pad_will_do_and_a_new_fit_replaces_the_old(case: Case) -> None:
    """Learn pads of one and of many taxels one after the other, each alone."""
    estimator, old = case.make(), "E"
    pads = square_pad(9, 8, 1.2), square_pad(5, 5, 2.3), square_pad(1, 1), square_pad(3, 7) * [1, -1]
    for pad, new in zip(pads, "TITI", strict=True):
        scan = make_scan("L" + new, pad, paper_poses(positions=2, angles=4))
        fit(estimator, scan)
        for _, probabilities, _ in answers(estimator, *draw(scan, new, 4, 5)):
            _hold({"L", new} <= set(probabilities), f"after a fit to L and {new}: {probabilities}")
            _hold(old not in probabilities, f"{old} was learned before, and not now")
            _hold(_normalised(probabilities), f"a pad of {len(pad)} taxels: {probabilities}")
        old = new


def a_single_object_can_be_localised(case: Case) -> None:
    """Recognise the letter that alone was learned."""
    estimator = case.make()
    fit(estimator, case.scan.where(label="E"))
    label = answers(estimator, *case.trial())[-1][0]
    _hold(label == "E", f"E alone was learned, and {label} recognised")


def objects_are_recognised(case: Case) -> None:
    """Recognise four of six objects after twelve readings; guessing gets there once in ten."""
    right = 0
    for seed in range(6):
        label = case.labels[seed % len(case.labels)]
        right += answers(case.learned, *case.trial(label, count=12, seed=seed), seed=seed)[-1][0] == label
    _hold(right >= 4, f"{right} of 6 objects were recognised after 12 readings")


def a_letter_can_be_left_out_of_what_was_learned(case: Case) -> None:
    """Give by `without` what a fit to the other letters gives, and leave the estimator as it was."""
    readings, poses = case.trial()
    before = answers(case.learned, readings, poses)
    anew = case.make()
    fit(anew, case.scan.untrained("E"))
    left_out = answers(case.learned.without("E", case.scan), readings, poses)
    for (label, p, _), (label_anew, p_anew, _) in zip(left_out, answers(anew, readings, poses), strict=True):
        same = p.keys() == p_anew.keys() and all(abs(p[k] - p_anew[k]) <= 1e-6 for k in p)
        _hold(label == label_anew and same, f"left out: {p}; never learned: {p_anew}")
    _hold(answers(case.learned, readings, poses) == before, "`without` changed the estimator itself")


def letters_that_are_one_share_its_probability(case: Case) -> None:
    """Know nothing of which label it is where three have the same training readings, whatever is felt and drawn."""
    if case.learned.uses_forward_model:
        return  # it knows the letters by their shapes
    train = case.scan.where("train", "E")
    three = Scan(
        np.tile(train.readings, (3, 1)), np.tile(train.poses, (3, 1)), np.repeat(list("ABC"), len(train)),
        np.full(3 * len(train), "train"), train.taxel_xy,
    )  # fmt: skip
    estimator = case.make()
    estimator.fit(three)
    for seed in (0, 1):
        for _, probabilities, _ in answers(estimator, *case.trial(count=6), seed):
            even = all(abs(p - 1 / 3) < 1e-9 for p in probabilities.values())
            message = f"three labels of the same readings are not equally probable: {probabilities}"
            _hold(set(probabilities) == set("ABC") and even, message)


CHECKS: tuple[Callable[[Case], Any], ...] = (
    calls_out_of_order_are_refused,
    a_scan_without_training_readings_is_refused,
    options_are_described,
    estimates_are_probabilities_and_poses,
    a_bad_reading_is_refused_and_leaves_no_trace,
    the_same_seed_gives_the_same_answer,
    an_estimator_that_says_it_draws_nothing_draws_nothing,
    reset_forgets_the_sequence_and_keeps_the_maps,
    looking_changes_nothing,
    inputs_are_not_written_to,
    readings_may_come_as_lists_and_as_whole_numbers,
    readings_without_contrast_are_taken,
    a_pose_far_away_is_taken,
    work_is_counted,
    a_proposal_is_a_candidate,
    many_trials_at_once_are_as_one_by_one,
    readings_to_test_with_teach_nothing,
    any_pad_will_do_and_a_new_fit_replaces_the_old,
    a_single_object_can_be_localised,
    objects_are_recognised,
    a_letter_can_be_left_out_of_what_was_learned,
    letters_that_are_one_share_its_probability,
)
