"""Surfaces in space: learned from training touches, and how likely further touches are over objects and their poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import ndimage
from scipy.special import erf

from tactsim.core import InputError, rigid
from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Options
from tactsim.solids.agreement_kernels import AHEAD, Touching, agreements
from tactsim.solids.feeling_kernels import add_log_p, climb, feel_all, foresee_touches
from tactsim.solids.scan import SpaceScan
from tactsim.solids.voxels import (
    INSIDE,
    OUTSIDE,
    UNKNOWN,
    HeightMaps,
    Voxels,
    carve,
    merge,
    redistance,
    settle,
    sparse,
)

_PARTS = 8  # of a ray's cell along each axis, over which what a taxel feels is averaged


@dataclass(frozen=True, eq=False)
class Rays:
    """A lattice of rays along the pad's z axis, over the taxels and the rim beside them that carries load too.

    x: (columns,) and y: (rows,) mm. base: (rows, columns) mm, z of the pad's unloaded surface. to_rays: (rays, taxels)
    interpolates what taxels read at the rays. to_taxels: (taxels, rays) sums the pressure at rays to what taxels
    read: the point spread over the taxel's own area. What spreads past the pad's edge is lost: rows sum to at most 1.
    """

    x: FloatArray
    y: FloatArray
    base: FloatArray
    to_rays: FloatArray
    to_taxels: FloatArray

    @property
    def frame(self) -> FloatArray:
        """Give [x of the first ray, y of the first ray, spacing] mm."""
        return np.array([self.x[0], self.y[0], self.x[1] - self.x[0]])

    @property
    def xy(self) -> FloatArray:
        """Give the rays' places, (rays, 2) mm, x fastest."""
        x, y = np.meshgrid(self.x, self.y)
        return np.column_stack([x.ravel(), y.ravel()])


def rays_over(points: FloatArray, per_taxel: int, spread: float, bounds: FloatArray | None = None) -> Rays:
    """Lay rays over taxels at (taxels, 3) mm, `per_taxel` along a side of each.

    spread: mm, the standard deviation of the pad's point spread. bounds: (4,) mm, x low, x high, y low, y high of the
    surface that carries load; without it that is the taxels' own.
    """
    xy = points[:, :2]
    apart = pitch(xy) or 2.0  # mm, of a single taxel
    low, high = xy.min(axis=0) - apart / 2, xy.max(axis=0) + apart / 2
    if bounds is not None:
        low, high = np.minimum(low, bounds[::2]), np.maximum(high, bounds[1::2])
    step = apart / per_taxel
    counts = np.maximum(np.rint((high - low) / step).astype(int), 2)
    middle = (low + high) / 2
    x, y = (middle[axis] + step * (np.arange(counts[axis]) - (counts[axis] - 1) / 2) for axis in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    squared = ((places[:, None] - xy[None]) ** 2).sum(axis=-1)
    near = (squared - squared.min(axis=1, keepdims=True)) / (2 * (0.5 * apart) ** 2)
    to_rays = _local_linear(places, xy, np.exp(-near))
    along_x, along_y = _felt(x, step, xy[:, 0], apart, spread), _felt(y, step, xy[:, 1], apart, spread)
    to_taxels = (along_y[:, :, None] * along_x[:, None, :]).reshape(len(xy), -1)
    to_taxels[to_taxels < 0.003] = 0.0
    base = (to_rays @ points[:, 2]).reshape(len(y), len(x))
    return Rays(x, y, base, to_rays, to_taxels)


def _felt(rays: FloatArray, step: float, taxels: FloatArray, pitch: float, spread: float) -> FloatArray:
    """Give the part along one axis of the mean pressure on taxels by an even pressure on rays' cells: (taxels, rays).

    rays: (rays,) mm, the middles of cells `step` mm wide. taxels: (taxels,) mm, the middles of taxels `pitch` mm wide.
    """
    parts = rays[:, None] + step * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
    edges = taxels[:, None] + pitch / 2 * np.array([-1.0, 1.0])
    away = (edges[:, None, None, :] - parts[None, :, :, None]) / (max(spread, 1e-3) * np.sqrt(2))
    return np.asarray(np.diff(erf(away), axis=-1)[..., 0].mean(axis=-1) / 2 * (step / pitch))


def _local_linear(places: FloatArray, xy: FloatArray, weight: FloatArray) -> FloatArray:
    """Give the matrix of local linear regression (Cleveland 1979) from taxels at xy to places."""
    result = np.empty((len(places), len(xy)))
    for row, (place, near) in enumerate(zip(places, weight, strict=True)):
        design = np.column_stack([np.ones(len(xy)), xy - place])
        normal = (design * near[:, None]).T @ design + 1e-6 * np.diag([0.0, 1.0, 1.0]) * near.max()
        result[row] = np.linalg.solve(normal, (design * near[:, None]).T)[0]
    return result


class Surface(NamedTuple):
    """Points (p, 3) mm, about evenly over a surface, unit normals (p, 3) that point out, and their spacing mm."""

    points: FloatArray
    normals: FloatArray
    spacing: float


def surface_of(
    corner: FloatArray, cell: float, distance: NDArray[np.float32], felt: NDArray[np.bool_], spacing: float
) -> Surface:
    """Take from every cube of `spacing` mm that a surface crosses the point of the surface nearest to its middle.

    corner: (3,) mm of the first voxel. cell: mm. distance: (a, b, c) mm, signed. felt: (a, b, c) where touches met the
    surface; elsewhere it is only where the pad has not been.
    """
    crossed = np.argwhere((np.abs(distance) < 0.75 * cell) & felt)
    crossed = crossed[((crossed > 0) & (crossed < np.array(distance.shape) - 1)).all(axis=1)]
    slope = np.empty((len(crossed), 3))
    for axis in range(3):
        step = np.eye(3, dtype=int)[axis]
        slope[:, axis] = distance[tuple((crossed + step).T)] - distance[tuple((crossed - step).T)]
    steep = np.linalg.norm(slope, axis=1, keepdims=True)
    kept = steep[:, 0] > 0.6 * cell  # less where two surfaces are near
    normals = slope[kept] / steep[kept]
    points = corner + cell * crossed[kept] - distance[tuple(crossed[kept].T)][:, None] * normals
    cubes = np.floor(points / spacing)
    order = np.argsort(((points / spacing - cubes - 0.5) ** 2).sum(axis=1))
    _, first = np.unique(cubes[order], axis=0, return_index=True)
    chosen = order[np.sort(first)]
    return Surface(np.ascontiguousarray(points[chosen]), np.ascontiguousarray(normals[chosen]), spacing)


_BEFORE, _BEHIND = 1.5, 1.5  # mm from a surface, within which a touch says how far away it is
_BAND = 3.0  # mm from the surface, within which voxels are kept
_PART = 0.05  # of the largest piece's volume; smaller pieces are specks that no touch has passed
_SPACING = 2.0  # mm between points of a surface
_MARGIN = 4.0  # mm that the grid is larger than what was touched


@dataclass(frozen=True, eq=False)
class Touches:
    """Training touches of one object. readings: (n, taxels) kPa. places: (n, 3) mm, turns: (n, 3, 3), the sensors."""

    readings: FloatArray
    places: FloatArray
    turns: FloatArray

    @classmethod
    def at(cls, readings: FloatArray, poses: FloatArray) -> Touches:
        """Take touches at poses (n, 7) sensor_in_object."""
        turns = np.ascontiguousarray(rigid.matrix(poses[:, 3:]))
        return cls(np.ascontiguousarray(readings), np.ascontiguousarray(poses[:, :3]), turns)

    def __getitem__(self, those: FloatArray) -> Touches:
        return Touches(self.readings[those], self.places[those], self.turns[those])


class Chart(NamedTuple):
    """What was learned of one object: signed distances to its surface, and the surface where touches met it."""

    voxels: Voxels
    surface: Surface


def depths(voxels: Voxels, touches: Touches, rays: Rays, deepest: float, ahead: float) -> FloatArray:
    """Foresee how deep the surface lies in the layer at each ray: (n, rays) mm, as `feeling_kernels.feel` does."""
    origin = np.column_stack([rays.xy, rays.base.ravel()])
    found = np.empty((len(touches.places), len(origin)))
    feel_all(voxels, origin, touches.places, touches.turns, deepest, ahead, found)
    return found


def learn_surface(touches: Touches, rays: Rays, stiffness: float, cell: float, stroke: float) -> Chart:
    """Learn signed distances to an object's surface from its touches: heights read off the pressures, merged.

    stiffness: kPa/mm of the pad's layer. cell: mm. stroke: mm over which the pad came.
    """
    least = 0.1 * float(np.median(touches.readings.max(axis=1)))  # kPa from which a taxel counts as touched
    pressure = (touches.readings @ rays.to_rays.T).reshape(len(touches.readings), *rays.base.shape)
    # Heights above the pad's plane, (n, rows, columns) mm, and where there is contact.
    heights, touched = rays.base - pressure / stiffness, (pressure > least).astype(float)
    xy = rays.xy.reshape(*rays.base.shape, 2)
    seen = np.concatenate([np.broadcast_to(xy, (*heights.shape, 2)), heights[..., None]], axis=-1)
    world = np.einsum("nij,nrcj->nrci", touches.turns, seen) + touches.places[:, None, None]
    points = world[touched > 0]
    corner = points.min(axis=0) - _MARGIN
    shape = tuple(np.ceil((points.max(axis=0) + _MARGIN - corner) / cell).astype(int) + 1)
    total, weight, free = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    frame = rays.frame
    maps = HeightMaps(touches.places, touches.turns, heights, touched, frame)
    merge(total, weight, corner, cell, maps, _BEFORE, _BEHIND)
    ends = np.where(touched > 0, heights - cell, rays.base)
    carve(free, corner, cell, touches.places, touches.turns, np.ascontiguousarray(ends), frame, stroke)
    known = weight > free  # else a contact that was none: more touches have passed there than felt something
    side = np.where(known, np.where(total < 0, INSIDE, OUTSIDE), np.where(free > 0, OUTSIDE, UNKNOWN)).astype(
        np.int8
    )
    for axis in range(3):  # the grid is larger than the object
        np.moveaxis(side, axis, 0)[[0, -1]] = OUTSIDE
    settle(side)
    pieces, _ = ndimage.label(side == INSIDE)
    volume = np.bincount(pieces.ravel())
    volume[0] = 0
    side[(side == INSIDE) & (volume < _PART * volume.max())[pieces]] = OUTSIDE
    nominal = np.where(side == INSIDE, -cell, cell)
    measured = known & ((total < 0) == (side == INSIDE))
    level = np.where(measured, total / np.maximum(weight, 1e-6), nominal).astype(np.float32)
    distance = np.empty_like(level)
    redistance(distance, level, cell)
    return Chart(
        sparse(corner, cell, distance, _BAND), surface_of(corner, cell, distance, measured, spacing=_SPACING)
    )


_LEFT_OUT = 5  # one in so many touches is left out to be foreseen
_SHOWN = 3  # objects from which the stiffness is learned
_SOFT = 0.5  # mm
_SURPRISE = 0.01  # share of the touches that nothing explains
_FREEDOM = 4.0
_COUNTS = 0.25  # neighbours share errors of the map and of the pad's place: four count as one
_FINEST = 1e-3  # mm, rad or kPa of a width: readings without noise ask for none
_FEWER_TRIES, _TRIES = 150, 400  # of widths, for a stiffness that is tried, and at last
_GROUP, _STEPS = 12, 7  # touches that are left out together, and steps in which they climb
_STIFFNESSES = np.geomspace(10, 1000, 9)  # kPa/mm that are tried first
_MOST_DEEP = 5.0  # mm

# Of each object distances to its surface, and the touches that these were learned without.
_LeftOut = list[tuple[Voxels, Touches]]


def learn_touching(
    touches: Mapping[str, Touches], points: FloatArray, rays: Rays, dense: Rays, cell: float, stroke: float
) -> tuple[Touching, float]:
    """Learn how a pad with taxels at `points` (taxels, 3) mm feels; also the load of a touch, N.

    rays: on which touches will be compared; dense: on which surfaces are learned.
    """
    shown = list(touches.values())[:: max(1, len(touches) // _SHOWN)][:_SHOWN]

    full = float(np.quantile(np.concatenate([mine.readings.sum(axis=1) for mine in touches.values()]), 0.75))

    def tried(stiffness: float) -> float:
        start = _touching(points, rays, stiffness, _deepest(shown, stiffness), stroke, full)
        return _widths(start, *_foreseen(_left_out(shown, start, dense, cell), start, rays), _FEWER_TRIES)[1]

    first = [tried(stiffness) for stiffness in _STIFFNESSES]
    fine = _STIFFNESSES[int(np.argmax(first))] * np.geomspace(0.75, 1 / 0.75, 5)
    stiffness = float(fine[np.argmax([tried(one) for one in fine])])
    everything = list(touches.values())
    start = _touching(points, rays, stiffness, _deepest(everything, stiffness), stroke, full)
    left_out = _left_out(everything, start, dense, cell)
    depth, readings = _foreseen(left_out, start, rays)
    touching, _ = _widths(start, depth, readings, _TRIES)
    log_p = np.empty(len(depth))
    agreements(touching, depth, readings, log_p)
    touching = touching._replace(worst=float(np.quantile(log_p, _SURPRISE)))
    touching = touching._replace(trust=_trust(left_out, touching))
    area = dense.frame[2] ** 2 * dense.base.size / len(points)
    return touching, full * area / 1000


def corners_of(touching: Touching) -> FloatArray:
    """Give the middle of a pad's rays, then their corners and the middles of their sides: (9, 2) mm."""
    edges = [np.array([v.min(), (v.min() + v.max()) / 2, v.max()]) for v in touching.ray[:, :2].T]
    corners = np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(corners[[4, 0, 1, 2, 3, 5, 6, 7, 8]])


def _deepest(touches: list[Touches], stiffness: float) -> float:
    """Give how deep a surface comes into the layer at most, mm, with some room."""
    highest = max(float(np.quantile(mine.readings.max(axis=1), 0.999)) for mine in touches)
    return min(max(1.5, 1.0 + highest / stiffness), _MOST_DEEP)


def _left_out(touches: list[Touches], start: Touching, dense: Rays, cell: float) -> _LeftOut:
    """Leave some touches of each object out, and learn distances to its surface from the others."""
    divided = [_divided(mine) for mine in touches]
    return [
        (learn_surface(learned, dense, start.stiffness, cell, start.stroke).voxels, out)
        for learned, out in divided
    ]


def _foreseen(left_out: _LeftOut, start: Touching, rays: Rays) -> tuple[FloatArray, FloatArray]:
    """Foresee touches left out: depths (n, rays) mm, and their readings (n, taxels) kPa."""
    depth = [depths(voxels, out, rays, start.deepest, start.soft + AHEAD) for voxels, out in left_out]
    return np.concatenate(depth), np.ascontiguousarray(np.concatenate([out.readings for _, out in left_out]))


def _trust(left_out: _LeftOut, touching: Touching) -> float:
    """Weigh touches so that groups of left-out ones are as sure of their poses as they are right, at most 1.

    The best pose near the true one exceeds it in log p, on average by half a nat for each of the pose's six numbers if
    the touches are weighed right (Wilks 1938): by 3.
    """
    excess = []
    for voxels, out in left_out:
        sensors = np.concatenate([out.places, rigid.quaternion(out.turns)], axis=1)
        for first in range(0, len(sensors) - _GROUP + 1, _GROUP):
            readings, at = out.readings[first : first + _GROUP], sensors[first : first + _GROUP]
            reached = []
            for steps in (0, _STEPS):
                pose, information, log_p = rigid.IDENTITY[None].copy(), np.empty((1, 6, 6)), np.empty(1)
                climb(voxels, touching, corners_of(touching), pose, readings, at, steps, information, log_p)
                reached.append(float(log_p[0]))
            excess.append(reached[1] - reached[0])
    return min(1.0, 3 / max(float(np.mean(excess)), 3.0)) if excess else 1.0


def _divided(touches: Touches) -> tuple[Touches, Touches]:
    """Divide touches into those that are learned from and those left out."""
    out = np.arange(len(touches.readings)) % _LEFT_OUT == 0
    return (touches[~out], touches[out]) if out.any() and not out.all() else (touches, touches)


def _touching(
    points: FloatArray, rays: Rays, stiffness: float, deepest: float, stroke: float, full: float
) -> Touching:
    """Set up how a pad feels, before its widths are learned. full: kPa, what taxels read of a touch's load together."""
    taxel, ray = np.nonzero(rays.to_taxels)
    per_taxel = 1 / float(rays.to_taxels.sum(axis=0).max())  # rays
    return Touching(
        ray=np.column_stack([rays.xy, rays.base.ravel()]),
        taxel=np.ascontiguousarray(points[:, :2]),
        start=np.searchsorted(taxel, np.arange(len(points) + 1)).astype(np.int64),
        which=ray.astype(np.int64),
        share=np.ascontiguousarray(rays.to_taxels[taxel, ray]),
        stiffness=float(stiffness), soft=_SOFT, deepest=deepest, stroke=stroke, noise=np.full(len(points), 2.0),
        rough=0.1, aside=0.2, columns=len(rays.x), step=float(rays.frame[2]),
        displaced=np.array([0.2, 0.02, 0.02, 0.3, 0.3]), swept=0.5, freedom=_FREEDOM, counts=_COUNTS, trust=1.0,
        worst=-1e3, full=full * per_taxel, stiffer=0.5, softer=0.2, split=0.1,
    )  # fmt: skip


def _widths(start: Touching, depth: FloatArray, readings: FloatArray, tries: int) -> tuple[Touching, float]:
    """Choose the widths under which touches left out are most probable, and give their mean log p."""
    from scipy.optimize import minimize  # imported here: only a fit needs it

    log_p = np.empty(len(depth))

    def with_widths(logs: FloatArray) -> Touching:
        noise, rough, aside, shift, tilt, slip, stiffer, softer, split = np.maximum(np.exp(logs), _FINEST)
        return start._replace(
            noise=np.full(len(start.taxel), noise),
            rough=float(rough),
            aside=float(aside),
            displaced=np.array([shift, tilt, tilt, slip, slip]),
            stiffer=float(stiffer),
            softer=float(softer),
            split=float(split),
        )

    def cost(logs: FloatArray) -> float:
        agreements(with_widths(logs)._replace(counts=1.0), depth, readings, log_p)
        return -float(log_p.mean())

    noise = 0.02 * float(np.quantile(readings, 0.99))
    found = minimize(
        cost,
        np.log([noise, 0.1, 0.2, 0.2, 0.02, 0.3, 0.3, 0.1, 0.05]),
        method="Nelder-Mead",
        options={"maxfev": tries, "xatol": 0.05},
    )
    return with_widths(found.x), -float(found.fun)


class SpaceMapOptions(Options):
    """How surfaces in space are learned, and how finely touches are compared with them."""

    cell: float = Field(1.0, ge=0.2, le=5, description="side of a voxel, mm")
    rays: int = Field(1, ge=1, le=4, description="rays along each side of a taxel that look for the surface")
    spread: float = Field(1.0, ge=0, le=10, description="standard deviation of the pad's point spread, mm")


class SpaceField:
    """log p(touches | object, object_in_robot) for the touches of a sequence so far, given the object independent.

    labels: the objects. maps: the signed distances to each one's surface. rays: through the pad. touching: how the pad
    feels.
    """

    def __init__(self, charts: Mapping[str, Chart], rays: Rays, touching: Touching, load: float) -> None:
        """Take what was learned of objects, by label. load: N that a touch carries."""
        self.maps = {label: chart.voxels for label, chart in charts.items()}
        self.labels = tuple(charts)
        self.rays, self.touching, self._load = rays, touching, load
        self._corners = corners_of(touching)
        self._surfaces = [chart.surface for chart in charts.values()]
        self.reset()

    @classmethod
    def learn(cls, scan: SpaceScan, options: SpaceMapOptions) -> SpaceField:
        """Learn the surface of every object of a scan's training touches, and how far to trust it.

        Raises InputError if the scan has no training touches, or those of an object met nothing.
        """
        train = scan.where("train")
        if not len(train):
            raise InputError("the scan has no touches with split 'train' to learn maps from")
        stroke = float(scan.meta.get("stroke", 0.0))
        bounds = scan.meta.get("load_bounds")
        rays = rays_over(
            train.taxel_points, options.rays, options.spread, None if bounds is None else np.array(bounds)
        )
        dense = rays_over(train.taxel_points, 2, options.spread)
        touches = {}
        for label in train.objects:
            mine = train.labels == label
            touches[label] = Touches.at(train.readings[mine], train.poses[mine])
        touching, load = learn_touching(touches, train.taxel_points, rays, dense, options.cell, stroke)
        charts = {
            label: learn_surface(mine, dense, touching.stiffness, options.cell, stroke)
            for label, mine in touches.items()
        }
        return cls(charts, rays, touching, load)

    def reset(self) -> None:
        """Forget all touches."""
        self._readings = np.empty((0, len(self.touching.taxel)))
        self._sensors = np.empty((0, 7))

    @property
    def touches(self) -> int:
        """Count the readings so far; several pads that touch at once are as many."""
        return len(self._readings)

    def append(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Add touches: readings (m, taxels) kPa at poses (m, 7), in the robot's frame."""
        self._readings = np.concatenate([self._readings, readings])
        self._sensors = np.concatenate([self._sensors, sensors_in_robot])

    def log_p(
        self, label_index: int, object_in_robot: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(touch | object, pose) over touches first, ..., last - 1, by default all: (n,) nats.

        object_in_robot: (n, 7).
        """
        result = np.zeros(len(object_in_robot))
        last = self.touches if last is None else last
        add_log_p(
            self.maps[self.labels[label_index]], self.touching, self._corners, np.ascontiguousarray(object_in_robot),
            self._readings, self._sensors, first, last, result,
        )  # fmt: skip
        return result

    def climb(
        self, label_index: int, object_in_robot: FloatArray, steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move poses (n, 7) to where the touches agree better, in at most so many steps.

        Returns the poses, the information (n, 6, 6) there, see `feeling_kernels.climb`, and log p (n,).
        """
        moved, log_p = np.array(object_in_robot), np.empty(len(object_in_robot))
        information = np.empty((len(moved), 6, 6))
        climb(
            self.maps[self.labels[label_index]], self.touching, self._corners, moved, self._readings, self._sensors,
            steps, information, log_p,
        )  # fmt: skip
        return moved, information, log_p

    def surface(self, label_index: int) -> Surface:
        """Give points (p, 3) mm about evenly over an object's surface, their outward normals and their spacing mm."""
        return self._surfaces[label_index]

    def reach(self, label_index: int) -> float:
        """Give the radius mm about an object's origin that holds its surface."""
        return float(np.linalg.norm(self._surfaces[label_index].points, axis=1).max())

    def foresee(
        self, label_index: int, object_in_robot: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Foresee touches from `start` (n, 7) of objects at (n, 7): travel (n,) mm and readings (n, taxels) kPa.

        A touch that meets nothing travels the whole stroke and reads 0.
        """
        object_in_robot, start = np.broadcast_arrays(object_in_robot, start)
        travel, image = np.empty(len(start)), np.empty((len(start), len(self.touching.taxel)))
        foresee_touches(
            self.maps[self.labels[label_index]], self.touching, np.ascontiguousarray(object_in_robot),
            np.ascontiguousarray(start), self._load, self.rays.frame[2] ** 2, travel, image,
        )  # fmt: skip
        return travel, image


def surfaces_of(estimator: object) -> Mapping[str, Surface]:
    """Give the surfaces that an estimator has learned, by label; none if it has no field in space."""
    field = getattr(estimator, "field", None)
    if not isinstance(field, SpaceField):
        return {}
    return {label: field.surface(number) for number, label in enumerate(field.labels)}
