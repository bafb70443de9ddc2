"""Synthetic readings: bars pressed on any layout of taxels, blurred and noisy, without physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import erf

from tactsim.core import Scan, transform
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimator

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
        self, letter: str, sensor_in_object: FloatArray, off: FloatArray | None = None
    ) -> Linearised:
        """Predict; nothing is unknown of a press, so `off` has no columns."""
        mean, slope = _with_gradient(letter, transform(sensor_in_object, self.taxel_xy))
        cosine, sine = np.cos(sensor_in_object[:, 2, None]), np.sin(sensor_in_object[:, 2, None])
        # Along the pad's own axes, as moves of the sensor are counted.
        by_x = cosine * slope[..., 0] + sine * slope[..., 1]
        by_y = cosine * slope[..., 1] - sine * slope[..., 0]
        turning = by_y * self.taxel_xy[:, 0] - by_x * self.taxel_xy[:, 1]
        by_pose = 30 * np.stack([by_x, by_y, turning], axis=1)
        return Linearised(30 * mean, by_pose, np.empty((len(mean), 0, self.taxels)))


def fit(estimator: Estimator, scan: Scan) -> None:
    """Fit an estimator to a scan of `make_scan`, and bring it a forward model if it asks for one."""
    if estimator.uses_forward_model:
        estimator.bring(BarForward("".join(scan.letters), scan.taxel_xy))
    estimator.fit(scan)
