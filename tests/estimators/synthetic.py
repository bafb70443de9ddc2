"""What tests share beside the synthetic readings of the contract: trials, scores, estimators that have learned."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan, compose, invert
from tactsim.estimators import Estimate, Estimator, create
from tactsim.estimators.contract.checks import BarForward, fit, make_scan, paper_poses, pressures, square_pad
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.cells import bins_of, middles
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.likelihood import Likelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps

__all__ = [
    "BarForward", "draw_trial", "field_of", "fit", "fitted", "fitted_anew", "follow", "make_scan", "model_of",
    "of_all_bins", "paper_poses", "placement_error", "pressures", "quick_first", "scores", "square_pad", "started",
    "two_taxel_scan",
]  # fmt: skip


def placement_error(
    estimate: NDArray[np.float64], truth: NDArray[np.float64], symmetry: int, inertia_over_mass: float
) -> float:
    """Measure the distance (mm, rms over the object) of two placements; paper, ref. [24] and eq. 17 to 20.

    Both are robot_in_object of an object whose centre of mass is its origin. symmetry: order, 0 for a disc.
    """
    ours, theirs = invert(estimate), invert(truth)
    turn = 0.0
    if symmetry:
        period = 2 * np.pi / symmetry
        turn = (ours[2] - theirs[2] + period / 2) % period - period / 2
    shift = ours[:2] - theirs[:2]
    return float(np.sqrt(shift @ shift + inertia_over_mass * 2 * (1 - np.cos(turn))))


# Options that make an estimator cheaper to fit, for tests of what does not depend on them.
CHEAPER: dict[str, dict[str, object]] = {
    "synthesis": {"spacing": 2.5, "angles": 8, "modes": 100},
    **{name: {"cell": 0.8} for name in ("stacked", "refined", "graded", "force-mosaic")},
}


def quick_first(names: Iterable[str]) -> list[Any]:
    """Give estimators as parameters of tests; those that take long, or are `refined` but for a likelihood, are long."""
    slow = ("force-mosaic", "graded", "stacked")
    return [pytest.param(name, marks=pytest.mark.long) if name in slow else name for name in names]


@lru_cache(maxsize=64)
def _fitted(name: str, options: tuple[tuple[str, object], ...], known: _Known) -> Estimator:
    return fitted_anew(name, known.scan, **dict(options))


def fitted_anew(name: str, scan: Scan, **options: object) -> Estimator:
    """Give an estimator of the test's own that has learned a scan."""
    estimator = create(name, **options)
    fit(estimator, scan)
    return estimator


def started(name: str, scan: Scan, **options: object) -> Estimator:
    """Give an estimator of the test's own that has learned a scan and waits for the first reading."""
    estimator = fitted_anew(name, scan, **options)
    estimator.reset(np.random.default_rng(0))
    return estimator


@dataclass(frozen=True)
class _Known:
    """A scan as a key: two that hold the same are the same."""

    digest: str
    scan: Scan = field(compare=False)


def fitted(name: str, scan: Scan, **options: object) -> Estimator:
    """Give an estimator that has learned a scan.

    All tests that ask for the same share it, as a fit takes longer than most of them: reset it before use, leave
    it as it was learned, and do not count on its counters.
    """
    return _fitted(name, tuple(sorted(options.items())), _Known(scan.digest, scan))


def draw_trial(
    scan: Scan, label: str, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Draw a trial by the paper's protocol: readings, sensor_in_robot of each, true robot_in_object."""
    mine = scan.where("test", label)
    truth = np.array([*rng.uniform(-10, 10, 2), rng.uniform(-np.pi, np.pi)])
    chosen = rng.permutation(len(mine))[:count]
    return mine.readings[chosen], compose(invert(truth), mine.poses[chosen]), truth


def two_taxel_scan(readings: ArrayLike, labels: ArrayLike, poses: ArrayLike | None = None) -> Scan:
    """Give training readings (n, 2) kPa of a pad of two taxels, felt at poses (n, 3) or all at one."""
    count = len(readings)
    taxels = np.array([[0.0, 0.0], [1.0, 0.0]])
    at = np.zeros((count, 3)) if poses is None else poses
    return Scan(np.array(readings, float), at, np.array(labels), np.full(count, "train"), taxels)


def model_of(kind: str, scan: Scan, **options: object) -> Likelihood:
    """Give a measurement model of a kind that has learned a scan."""
    model = likelihood.kind_of(kind)
    made = model(model.options_type(**options))
    made.fit(scan, learn_maps(scan))
    return made


def field_of(model: tuple[Likelihood, Scan], grid: StateGrid, finest: float = 0.4) -> TableField:
    """Give the field of a fitted likelihood, with its scan, for the bins of a grid."""
    made, scan = model
    return TableField(made, scan.letters, scan.taxel_xy, grid.spacing[:2], finest)


def of_all_bins(field: TableField, grid: StateGrid) -> NDArray[np.float64]:
    """Replay all readings at the middle of every bin: (letters, angles, rows, columns)."""
    flat, states = np.arange(grid.bins), np.empty((3, grid.bins))
    middles(states, np.empty_like(flat), np.zeros_like(flat), flat, bins_of(grid))
    log_p = [field.log_p(letter, states) for letter in range(len(field.labels))]
    return np.reshape(log_p, (-1, grid.angle, grid.y, grid.x))


def follow(
    estimator: Estimator, readings: NDArray[np.float64], poses: NDArray[np.float64], seed: int = 0
) -> list[Estimate]:
    """Feed a sequence from a reset; the estimate after each reading."""
    estimator.reset(np.random.default_rng(seed))
    estimates = []
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        estimates.append(estimator.estimate())
    return estimates


def scores(
    scan: Scan, estimator: Estimator, trials: int, last: int
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Right (trials a letter x letters, readings), and the error in mm, over trials by the paper's protocol."""
    right, off = [], []
    for trial in range(trials):
        for label in scan.letters:
            rng = np.random.default_rng((trial, ord(label)))
            info = scan.meta["objects"][label]
            readings, poses, truth = draw_trial(scan, label, last, rng)
            estimator.reset(rng)
            for reading, pose in zip(readings, poses, strict=True):
                estimator.update(reading, pose)
                got = estimator.estimate()
                right.append(got.label == label)
                off.append(
                    placement_error(got.robot_in_object, truth, info["symmetry"], info["inertia_over_mass"])
                )
    return np.reshape(right, (-1, last)), np.reshape(off, (-1, last))
