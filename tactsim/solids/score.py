"""What a run with objects in space keeps, and its metrics: mean distance of surface points, and angle.

A solid with symmetry looks the same in several poses, so both are the least over its symmetry group. The mean distance
of corresponding points, the least over the group, is the error of Hodan et al. 2020 (MSSD) with the mean for the
maximum; without symmetry it is the ADD of Hinterstoisser et al. 2012.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.bench.intervals import FEWEST_PAIRS
from tactsim.bench.score import Curve, Metric, Scored, averaged, errors, mean_where, nones
from tactsim.bench.trials import Trials
from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.files import write_bytes
from tactsim.core.finite import finite
from tactsim.core.npz import read_npz
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.estimators.estimator import PoseSamples

if TYPE_CHECKING:
    from tactsim.models import Solid


POINTS = 256  # on a solid's surface; the mean of so many differs from the surface's by some 1 %
_ARRAYS = ("vertices", "faces", "points")  # of objects.npz
DRAWN = 200  # samples of a belief that stand for it
_AT_ONCE = 1 << 21  # numbers of one array
_GOLDEN = (np.sqrt(5) - 1) / 2
_HALVINGS = 20  # of the interval in which the turn about an axis is sought, by the golden section
_STARTS = 8  # turns about an axis from which the least is sought


@dataclass(frozen=True, eq=False)
class Surface:
    """What a run keeps of a solid: what the distance needs, and its mesh for pictures. See `placement.Placement`.

    points: (s, 3) mm in the object frame, even over its surface. rotations: (k, 4) its finite symmetry group, with the
    identity. axis: (3,) unit vector if every turn about it leaves the solid as it is; `rotations` are then those
    beside it. vertices: (v, 3) mm. faces: (f, 3) numbers of vertices, counter-clockwise from outside.
    """

    points: FloatArray
    rotations: FloatArray
    axis: FloatArray | None = None
    vertices: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    faces: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), dtype=np.int64))

    @classmethod
    def of(cls, solid: Solid) -> Surface:
        """Take what a run keeps of a solid; the points are the same whatever else is tried."""
        points, _ = solid.sample_surface(POINTS, stream(0, solid.name, "surface distance"))
        symmetry = solid.symmetry
        return cls(points, np.asarray(symmetry.rotations), symmetry.axis, solid.vertices, solid.faces)

    def alike(self, poses: FloatArray, near: FloatArray) -> FloatArray:
        """Turn the solid by its symmetry until it lies as `near` (7,): poses (n, 7); see `placement.Placement`."""
        turned = rigid.multiply(self.rotations, poses[:, None, 3:])  # (n, k, 4)
        left = rigid.multiply(near[3:], rigid.conjugate(turned))
        along = 0.0 if self.axis is None else left[..., 1:] @ self.axis
        best = np.hypot(left[..., 0], along).argmax(axis=1)
        turn = self.rotations[best]
        if self.axis is not None:  # what the best turn about the axis is
            about = 2 * np.arctan2(along, left[..., 0])[np.arange(len(best)), best]
            turn = rigid.multiply(rigid.from_vector(about[:, None] * self.axis), turn)
        return rigid.compose(np.concatenate([np.zeros((len(turn), 3)), turn], axis=1), poses)

    def error(self, estimated: ArrayLike, true: ArrayLike) -> FloatArray:
        """Measure the mean surface distance between poses robot_in_object (..., 7): (...,) mm."""
        estimated, true = np.broadcast_arrays(rigid.invert(estimated), rigid.invert(true))
        away = surface_distance(estimated.reshape(-1, 7), true.reshape(-1, 7), self)
        return away.reshape(estimated.shape[:-1])

    def angle(self, estimated: ArrayLike, true: ArrayLike) -> FloatArray:
        """Measure the angle between poses robot_in_object (..., 7): (...,) rad."""
        estimated, true = np.broadcast_arrays(rigid.invert(estimated), rigid.invert(true))
        return turn_between(estimated.reshape(-1, 7), true.reshape(-1, 7), self).reshape(estimated.shape[:-1])

    def spread(
        self, samples: PoseSamples, estimated: FloatArray, true: FloatArray
    ) -> tuple[FloatArray, float, FloatArray]:
        """Measure how far a belief and the truth lie from an estimated pose; see `Placement`.

        It is asked after every touch: `DRAWN` of the samples, drawn evenly by weight, and a quarter of the points do.
        """
        rough = replace(self, points=self.points[::4])
        others = np.concatenate([drawn_evenly(samples, DRAWN), true[None]])
        away = rough.error(others, estimated)
        return away[:-1], float(away[-1]), np.ones(DRAWN)


def drawn_evenly(samples: PoseSamples, count: int) -> FloatArray:
    """Draw poses (count, 7) of a belief, evenly by weight."""
    held = np.cumsum(samples.weights)
    chosen = np.searchsorted(held, (np.arange(count) + 0.5) / count * held[-1])
    return samples.poses[np.minimum(chosen, len(held) - 1)]


def surface_distance(estimated: ArrayLike, true: ArrayLike, of: Surface) -> FloatArray:
    """Compute the mean distance (n,) mm of corresponding surface points between object poses (n, 7).

    Both are object_in_robot, or object_in_anything if it is the same frame. The least over the symmetry group counts;
    the least over turns about an axis is found to 1e-3 rad.
    """
    between = rigid.compose(rigid.invert(true), np.asarray(estimated, dtype=float))
    size = max(1, _AT_ONCE // (of.points.size * len(of.rotations)))
    parts = [_least(between[first : first + size], of) for first in range(0, len(between), size)]
    return np.concatenate([np.empty(0), *parts])


def turn_between(estimated: ArrayLike, true: ArrayLike, of: Surface) -> FloatArray:
    """Compute the angle (n,) rad between object poses (n, 7), the least over the symmetry group."""
    between = rigid.multiply(rigid.conjugate(np.asarray(true)[..., 3:]), np.asarray(estimated)[..., 3:])
    beside = rigid.multiply(between[:, None], rigid.conjugate(of.rotations))
    if of.axis is None:
        cosine = np.abs(beside[..., 0])
        sine = np.linalg.norm(beside[..., 1:], axis=-1)
    else:  # what is left when the best turn about the axis has been taken off
        along = beside[..., 1:] @ of.axis
        cosine = np.hypot(beside[..., 0], along)
        sine = np.linalg.norm(beside[..., 1:] - along[..., None] * of.axis, axis=-1)
    return np.asarray(2 * np.arctan2(sine, cosine).min(axis=1), dtype=float)


def _least(between: FloatArray, of: Surface) -> FloatArray:
    """Compute the distance (n,) for poses (n, 7) of the estimated in the true object's frame."""
    placed = rigid.transform(between, of.points)[:, None]  # (n, 1, s, 3)
    alike = rigid.turned(of.rotations[:, None], of.points)  # (k, s, 3)
    if of.axis is None:
        return _mean(placed - alike).min(axis=1)
    return _least_about_axis(placed, alike, of.axis)


def _mean(difference: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", difference, difference)).mean(axis=-1))


def _least_about_axis(placed: FloatArray, alike: FloatArray, axis: FloatArray) -> FloatArray:
    """Find the least distance (n,) over the rotations and every turn about the axis, by golden sections."""
    along = (alike @ axis)[..., None] * axis
    across, beside = alike - along, np.cross(axis, alike)

    def distance(turn: FloatArray) -> FloatArray:
        turned = along + np.cos(turn)[..., None, None] * across + np.sin(turn)[..., None, None] * beside
        return _mean(placed - turned)

    shape = (len(placed), len(alike))
    starts = np.arange(_STARTS) * (2 * np.pi / _STARTS)
    found = np.stack([distance(np.full(shape, start)) for start in starts])
    low = starts[found.argmin(axis=0)] - 2 * np.pi / _STARTS
    width = np.full(shape, 4 * np.pi / _STARTS)
    best = found.min(axis=0)
    for _ in range(_HALVINGS):
        left, right = low + (1 - _GOLDEN) * width, low + _GOLDEN * width
        at_left, at_right = distance(left), distance(right)
        best = np.minimum(best, np.minimum(at_left, at_right))
        low = np.where(at_left < at_right, low, left)
        width = _GOLDEN * width
    return np.asarray(best.min(axis=1))


def symmetries_of(surfaces: Mapping[str, Any]) -> dict[str, Any]:
    """Give what run.json says of each solid: its symmetry."""
    return {
        label: {"rotations": of.rotations.tolist(), "axis": None if of.axis is None else of.axis.tolist()}
        for label, of in surfaces.items()
    }


def save_surfaces(surfaces: Mapping[str, Any], path: Path) -> None:
    """Write points and meshes as .npz, numbered in the order of the names."""
    arrays: dict[str, NDArray[Any]] = {}
    for number, label in enumerate(sorted(surfaces)):  # as JSON sorts them
        for name in _ARRAYS:
            arrays[f"{name}_{number}"] = getattr(surfaces[label], name)
    content = BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    write_bytes(path, content.getvalue())


def load_surfaces(symmetries: Mapping[str, Any], path: Path) -> dict[str, Surface]:
    """Read what `save_surfaces` wrote. Raises InputError if something is missing, or a number is not finite."""
    arrays = read_npz(path, tuple(f"{name}_{n}" for n in range(len(symmetries)) for name in _ARRAYS))
    found = {}
    for number, label in enumerate(sorted(symmetries)):
        of = symmetries[label]
        if not {"rotations", "axis"} <= set(of):
            raise InputError(f"run.json: symmetries.{label} lacks rotations or axis")
        found[label] = Surface(
            finite(arrays[f"points_{number}"], "points"),
            finite(of["rotations"], "rotations"),
            None if of["axis"] is None else finite(of["axis"], "axis"),
            finite(arrays[f"vertices_{number}"], "vertices"),
            arrays[f"faces_{number}"].astype(np.int64),
        )
    return found


_DRAWS = 1000  # of a bootstrap


@dataclass(frozen=True, eq=False)
class SpaceTrials(Trials):
    """Trials with objects in space: poses are (7,), and touches, which are drawn as they come, are numbered from 0.

    start: (n, r, 7) where each touch began, sensor_in_robot (of a hand: hand_in_robot). met: (n, r) how many pads met
    the object.
    """

    kind: ClassVar[str] = "solids"
    start: FloatArray
    met: NDArray[np.int64]


def angle(scored: Scored) -> FloatArray:
    """Compute the angle (n, r) in degrees between estimated and true rotation, the least over the symmetry."""
    return np.degrees(errors(scored.trials, scored.objects, "angle"))


def by_object(scored: Scored) -> dict[str, dict[str, float | None]]:
    """Give accuracy, mean surface distance and angle of each object in space after the last touch."""
    trials = scored.trials
    figures = {
        "accuracy": (trials.right.astype(float), np.ones_like(trials.right)),
        "error_mm": (scored.error, trials.named),
        "angle_deg": (angle(scored), trials.named),
    }
    rows: dict[str, dict[str, float | None]] = {}
    for truth in dict.fromkeys(trials.truth.tolist()):
        own = trials.truth == truth
        means = {
            name: mean_where(values[own][:, -1:], chosen[own][:, -1:])[0]
            for name, (values, chosen) in figures.items()
        }
        rows[truth] = {name: None if mean is None else float(mean) for name, mean in means.items()}
    return rows


def met(scored: Scored) -> FloatArray:
    """Give the share of the touches in space (r,) that met the object."""
    assert isinstance(scored.trials, SpaceTrials)
    return (scored.trials.met > 0).mean(axis=0)


# Beside those of every run: the objects have no shape in common, so a few poses may be far off.
METRICS: dict[str, Metric] = {
    "error_low_mm": Metric(
        "Lower end of the 95 % interval of `error_mm`, by a bootstrap over trials.",
        lambda scored: _bootstrap(scored.error, scored.trials.named)[0],
    ),
    "error_high_mm": Metric(
        "Upper end of the 95 % interval of `error_mm`, by a bootstrap over trials.",
        lambda scored: _bootstrap(scored.error, scored.trials.named)[1],
    ),
    "error_median_mm": Metric(
        "Median surface distance of the trials whose object is right: a few poses that are far off do not move it.",
        lambda scored: _median(scored.error, scored.trials.named),
        heading="median error after {}, mm",
        digits=2,
        better=-1,
        section="curves",
    ),
    "angle_deg": averaged(
        "Mean angle between estimated and true rotation where the object is right, the least over its symmetry.",
        angle,
        "angle after {}, degrees",
        lambda scored: scored.trials.named,
        digits=1,
        better=-1,
        section="curves",
    ),
    "angle_low_deg": Metric(
        "Lower end of the 95 % interval of `angle_deg`, by a bootstrap over trials.",
        lambda scored: _bootstrap(angle(scored), scored.trials.named)[0],
    ),
    "angle_high_deg": Metric(
        "Upper end of the 95 % interval of `angle_deg`, by a bootstrap over trials.",
        lambda scored: _bootstrap(angle(scored), scored.trials.named)[1],
    ),
    "angle_median_deg": Metric(
        "Median angle where the object is right.",
        lambda scored: _median(angle(scored), scored.trials.named),
        heading="median angle after {}, degrees",
        digits=1,
        better=-1,
        section="curves",
    ),
    "met": Metric("Share of the touches that met the object with one pad at least.", met),
    "by_object": Metric(
        "Give accuracy, mean surface distance and angle of each object after the last touch.",
        by_object,
        table=True,
    ),
}


def _median(values: FloatArray, chosen: NDArray[np.bool_]) -> Curve:
    """Take the median of the chosen entries of each column; None where there is none."""
    columns = zip(values.T, chosen.T, strict=True)
    return nones(np.array([np.median(column[some]) if some.any() else np.nan for column, some in columns]))


def _bootstrap(values: FloatArray, chosen: NDArray[np.bool_]) -> tuple[Curve, Curve]:
    """Bound the mean of the chosen entries of each column: percentiles of a bootstrap over rows, (r,) each.

    None where fewer than `FEWEST_PAIRS` are chosen: draws of so few are too much alike.
    """
    drawn = np.random.default_rng(0).multinomial(len(values), np.full(len(values), 1 / len(values)), _DRAWS)
    chosen = chosen & (chosen.sum(axis=0) >= FEWEST_PAIRS)
    count = drawn @ chosen.astype(float)
    with np.errstate(invalid="ignore"):
        means = drawn @ np.where(chosen, values, 0.0) / np.where(count > 0, count, np.nan)
    bounds = np.full((2, values.shape[1]), np.nan)
    some = ~np.isnan(means).all(axis=0)
    bounds[:, some] = np.nanpercentile(means[:, some], (2.5, 97.5), axis=0)
    return nones(bounds[0]), nones(bounds[1])
