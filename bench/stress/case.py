"""A stress case: one thing varied, the worst deviation that was seen, and the limit for it; and the data of cases."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, lru_cache
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.bench.kinds import PLANE
from tactsim.bench.trials import draw_true_pose, fit
from tactsim.core import InputError, Pad, Scan, compose, invert
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, Estimator, create, names
from tactsim.estimators.registry import load
from tactsim.models import parse_letters
from tactsim.press import ScanOptions, forward_model, scan_letters

QUICK = "quick"


class Worst:
    """Keep the worst value seen and where; a value that is not finite is the worst of all."""

    def __init__(self) -> None:
        self.value = -math.inf
        self.at = ""
        self.seen = 0

    def see(self, values: ArrayLike, at: str) -> None:
        """Note one value or an array of values, all measured `at` one setting."""
        array = np.asarray(values, dtype=float)
        if not array.size:
            return
        worst = float(np.max(array)) if np.isfinite(array).all() else math.inf
        self.seen += array.size
        if worst > self.value:
            self.value, self.at = worst, at

    def holds(self, truth: bool | np.bool_, at: str) -> None:
        """Note a fact that must hold: a deviation of 0 if it does, of 1 if not."""
        self.see(0.0 if truth else 1.0, at)


@dataclass(frozen=True)
class Case:
    """One numerical stress case.

    name: topic and case, "maps.peak-near-one". varied: what is varied, and how far. deviation: what is
    measured. limit: the largest deviation allowed. because: the reason for the limit. measure(worst) does the work and
    tells `worst` each deviation. Any exception in it is a failure.
    """

    name: str
    varied: str
    deviation: str
    limit: float
    because: str
    measure: Callable[[Worst], None]
    quick: bool = True

    @property
    def tags(self) -> tuple[str, ...]:
        """List the tags by which the case can be chosen: its topic, and "quick"."""
        return (self.name.partition(".")[0], *((QUICK,) if self.quick else ()))


@dataclass(frozen=True)
class Outcome:
    """The result of a case: the worst value (infinite if one was not finite), where it was seen, and seconds."""

    case: Case
    worst: float
    at: str
    seconds: float = field(compare=False)

    @property
    def passed(self) -> bool:
        """Tell whether the worst value keeps to the limit."""
        return self.worst <= self.case.limit

    @property
    def verdict(self) -> str:
        """Say in a word whether the case keeps to its limit."""
        return "passes" if self.passed else "FAILS"

    def as_json(self) -> dict[str, Any]:
        """Put the outcome into what `--json` prints; a worst that is not finite is None."""
        stated = ("name", "tags", "varied", "deviation", "limit", "because")
        return {
            **{name: getattr(self.case, name) for name in stated},
            "worst": self.worst if math.isfinite(self.worst) else None,
            "at": self.at,
            "limit_is": "most",
            "verdict": self.verdict,
            "seconds": self.seconds,
        }


def case(
    name: str, *, varied: str, deviation: str, limit: float, because: str, quick: bool = True
) -> Callable[[Callable[[Worst], None]], Case]:
    """Make a `Case` of the function below; a module's cases are the Case objects in it."""

    def make(measure: Callable[[Worst], None]) -> Case:
        return Case(name, varied, deviation, limit, because, measure, quick)

    return make


def run_case(chosen: Case) -> Outcome:
    """Do one case. A RuntimeWarning, such as NumPy's for an overflow, fails it as any exception does."""
    worst, start = Worst(), perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            chosen.measure(worst)
        if not worst.seen:
            worst.see(math.inf, "nothing was measured")
    except Exception as error:
        worst.value, worst.at = math.inf, f"{type(error).__name__}: {error}"
    return Outcome(chosen, worst.value, worst.at, perf_counter() - start)


def run_cases(chosen: Iterable[Case], progress: Callable[[str, int, int], None]) -> list[Outcome]:
    """Do the cases in order; progress("stress", done, total) is called after each."""
    cases = list(chosen)
    outcomes = list[Outcome]()
    progress("stress", 0, len(cases))
    for done, one in enumerate(cases, start=1):
        outcomes.append(run_case(one))
        progress("stress", done, len(cases))
    return outcomes


def refused(call: Callable[..., Any], *args: Any, **options: Any) -> bool:
    """Tell whether a call ends in an InputError of one line; any other exception is raised."""
    try:
        call(*args, **options)
    except InputError as error:
        return "\n" not in str(error)
    return False


USUAL_BUDGET = 1000  # of an estimator, if a case asks for no other


@cache
def pressed(letters: str = "AEIOU", pad: Pad | None = None) -> Scan:
    """Press letters; test readings are at the training poses, some of them at angle 0."""
    options = ScanOptions(letters=parse_letters(letters), pad=pad or Pad(), test_poses="same")
    return scan_letters(options, cache=False)[0]


@cache
def few(scan: Scan, every: int = 16) -> Scan:
    """Keep every n-th reading of a scan."""
    return scan.chosen(np.arange(0, len(scan), every))


@lru_cache(maxsize=40)
def fit_once(name: str, scan: Scan, options: tuple[tuple[str, Any], ...]) -> Estimator:
    """Make an estimator and fit it: once for the cases that follow each other and ask for the same.

    Nobody may feel with it: `fitted` gives copies. `fit_once.cache_clear()` forgets what was fitted by other code.
    """
    estimator = create(name, **dict(options))
    fit(estimator, scan, forward_model)
    return estimator


def fitted(name: str, scan: Scan, **options: Any) -> Estimator:
    """Give an estimator that is fitted to a scan, and begin a sequence with seed 0."""
    estimator = deepcopy(fit_once(name, scan, tuple(options.items())))
    estimator.reset(np.random.default_rng(0))
    return estimator


def every_estimator(
    budget: int = USUAL_BUDGET, *, learning: bool = False
) -> list[tuple[str, dict[str, int]]]:
    """List every estimator of the plane that can be loaded with its budget, by default a moderate one.

    learning: only those that learn from the training readings, and do not press the letters themselves.
    """
    found = []
    for name in names():
        try:
            kind = load(name)
        except InputError:
            continue  # a broken plug-in, of which `bench list` says so
        options = {} if kind.budget is None else {kind.budget: budget}
        if not (kind.KIND != PLANE or (learning and kind.uses_forward_model)):
            found.append((name, options))
    return found


def draws(name: str) -> bool:
    """Tell whether an estimator's answer depends on what it draws."""
    return load(name).draws


def hidden(scan: Scan, label: str, count: int, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hide a letter: (count, taxels) readings, (count, 3) sensor_in_robot, and the true robot_in_object."""
    rng = np.random.default_rng(seed)
    truth = draw_true_pose(rng, offsets(scan.taxel_xy))
    test = scan.where("test", label)
    order = rng.permutation(len(test))[:count]
    return test.readings[order], compose(invert(truth), test.poses[order]), truth


def after(estimator: Estimator, readings: FloatArray, poses: FloatArray, seed: int = 0) -> Estimate:
    """Begin a sequence, take in readings (n, taxels) at poses (n, 3), and give the estimate after the last."""
    estimator.reset(np.random.default_rng(seed))
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
    return estimator.estimate()


def see_sound(worst: Worst, estimator: Estimator, readings: FloatArray, poses: FloatArray, at: str) -> None:
    """Begin a sequence, and see after each of its readings that the probabilities are some: see `flaw`."""
    estimator.reset(np.random.default_rng(0))
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        worst.see(flaw(estimator.estimate()), at)


def probabilities(estimate: Estimate) -> FloatArray:
    """Give the letters' probabilities in the order of their names."""
    return np.array([estimate.probabilities[label] for label in sorted(estimate.probabilities)])


def flaw(estimate: Estimate) -> float:
    """Measure how far the sum of the probabilities is from 1; infinite if any number is invalid."""
    p = probabilities(estimate)
    sound = np.isfinite(p).all() and (p >= 0).all() and np.isfinite(estimate.robot_in_object).all()
    return abs(float(p.sum()) - 1) if sound else np.inf
