"""Synthetic readings for tests: bars and rings pressed on any layout, blurred and noisy, without physics."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from tactsim.core import Scan, compose, invert, transform
from tactsim.core.forward import Linearised
from tactsim.estimators import Estimator, create

# Bars as (centre x, centre y, half length x, half length y) mm, axis-aligned and disjoint.
SHAPES = {
    "E": [(-6.5, 0, 2.25, 12), (2, 9.75, 6.25, 2.25), (2, 0, 6.25, 2.25), (2, -9.75, 6.25, 2.25)],
    "I": [(0, 0, 2.25, 12)],
    "L": [(-6, 0, 2.25, 12), (2, -9.75, 5.75, 2.25)],
    "T": [(0, -2.25, 2.25, 9.75), (0, 9.75, 10, 2.25)],
}


def square_pad(rows: int = 6, columns: int = 6, pitch: float = 1.9) -> NDArray[np.float64]:
    """Lay out taxels (rows * columns, 2) mm."""
    x, y = (np.arange(n) * pitch - (n - 1) * pitch / 2 for n in (columns, rows))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def paper_poses(positions: int = 4, angles: int = 12) -> NDArray[np.float64]:
    """List the paper's sensor_in_object poses, or a coarser grid over the same square."""
    steps = np.linspace(-10.2, 10.2, positions)
    turns = np.arange(angles) * 2 * np.pi / angles
    return np.array([[x, y, a] for a in turns for y in steps for x in steps])


def pressures(shape: str, points: NDArray[np.float64], blur: float = 1.2) -> NDArray[np.float64]:
    """Blur a shape's footprint with a Gaussian: 0 to 1 at points (..., 2) mm."""
    total = np.zeros(points.shape[:-1])
    for *centre, half_x, half_y in SHAPES[shape]:
        away = points - np.array(centre)
        sides = [
            erf((away[..., i] + half) / blur / 2**0.5) - erf((away[..., i] - half) / blur / 2**0.5)
            for i, half in enumerate((half_x, half_y))
        ]
        total += sides[0] * sides[1] / 4
    return total


def make_scan(
    shapes: str = "EILT",
    taxel_xy: NDArray[np.float64] | None = None,
    poses: NDArray[np.float64] | None = None,
    noise: float = 2.0,
    seed: int = 0,
) -> Scan:
    """Press every shape at every pose, once for training and once for testing."""
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


class SyntheticForward:
    """The forward model of the readings that `make_scan` makes, with derivatives by differences."""

    noise = 2.0
    turns = 1

    def __init__(self, shapes: str, taxel_xy: NDArray[np.float64]) -> None:
        self.letters = tuple(shapes)
        self.taxel_xy, self.taxels = taxel_xy, len(taxel_xy)
        self.reach = dict.fromkeys(shapes, 18.0 + float(np.hypot(*taxel_xy.T).max()))
        self.symmetry = dict.fromkeys(shapes, 1)

    def readings(self, letter: str, sensor_in_object: NDArray[np.float64]) -> NDArray[np.float64]:
        return 30 * pressures(letter, transform(sensor_in_object, self.taxel_xy))

    def linearised(
        self, letter: str, sensor_in_object: NDArray[np.float64], off: NDArray[np.float64] | None = None
    ) -> Linearised:
        """Predict; nothing is unknown of a press, so `off` has no columns."""
        mean = self.readings(letter, sensor_in_object)
        steps = 1e-3 * np.eye(3)
        by_pose = [(self.readings(letter, compose(sensor_in_object, step)) - mean) / 1e-3 for step in steps]
        return Linearised(mean, np.stack(by_pose, axis=1), np.empty((len(mean), 0, self.taxels)))


def fit(estimator: Estimator, scan: Scan) -> None:
    """Fit an estimator to a scan of `make_scan`, and bring it a forward model if it asks for one."""
    if estimator.uses_forward_model:
        estimator.bring(SyntheticForward("".join(scan.letters), scan.taxel_xy))
    estimator.fit(scan)


@lru_cache(maxsize=64)
def _fitted(name: str, options: tuple[tuple[str, object], ...], known: _Known) -> Estimator:
    estimator = create(name, **dict(options))
    fit(estimator, known.scan)
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
