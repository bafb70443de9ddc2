"""The data of the cases: readings of the simulated pad, and estimators fitted to them."""

from __future__ import annotations

from copy import deepcopy
from functools import cache, lru_cache
from typing import Any

import numpy as np

from tactsim.bench.kinds import PLANE
from tactsim.bench.stress.case import Worst
from tactsim.bench.trials import draw_true_pose, fit
from tactsim.core import InputError, Pad, Scan, compose, invert
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, Estimator, create, names
from tactsim.estimators.registry import load
from tactsim.models import parse_letters
from tactsim.press import WORLDS, ScanOptions, forward_model, scan_letters

USUAL_BUDGET = 1000  # of an estimator, if a case asks for no other
# What takes long to train is trained little: a case asks what the estimator takes and answers, not how good it is.


@cache
def pressed(letters: str = "AEIOU", world: str = "default", pad: Pad | None = None) -> Scan:
    """Press letters in one of the ready-made worlds; test readings at the training poses, some of them at angle 0."""
    options = ScanOptions(
        **WORLDS[world], letters=parse_letters(letters), pad=pad or Pad(), test_poses="same"
    )
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
