"""Surfaces in space: learned from training touches, and how likely further touches are over objects and their poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
from tactsim.estimators.filters.states import Weights
from tactsim.estimators.filters.trust import Trust
from tactsim.solids.agreement_kernels import AHEAD, LOUD, Touching, agreements
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
_FEW, _MANY = 4, 16  # touches that are left out together
_JUDGED, _SEQUENCES = 12, 3  # objects whose touches are weighed, and sequences of each
_SHARE = 0.9  # of sequences, whose regions are to hold the true pose
# Poses that stand for a belief near the best one, and their variance beside the belief's
_DRAWN, _WIDER = 300, 2.0
GYRATION = 15.0  # mm, the lever at which an angle counts beside a shift
_BEGUN, _STEPS = 40, 7  # poses near the true one from which better ones are climbed to, in so many steps
_NEAR = 0.7, 0.06  # mm and rad: how far off they are along each axis
_ALONE, _CHOOSING = 2, 2  # touches before any is chosen, and steps to the states that a choice is between
_STATES, _OFFERED = 16, 40  # of a belief, and touches among which it chooses
_STIFFNESSES = np.geomspace(10, 1000, 9)  # kPa/mm that are tried first
_MOST_DEEP = 5.0  # mm

# Of each object what was learned of it, and the touches that this was learned without.
_LeftOut = list[tuple[Chart, Touches]]


def learn_touching(
    touches: Mapping[str, Touches], points: FloatArray, rays: Rays, dense: Rays, cell: float, stroke: float
) -> tuple[Touching, float, _LeftOut]:
    """Learn how a pad with taxels at `points` (taxels, 3) mm feels; also the load of a touch, N, and what was left out.

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
    area = dense.frame[2] ** 2 * dense.base.size / len(points)
    return touching, full * area / 1000, left_out


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
        (learn_surface(learned, dense, start.stiffness, cell, start.stroke), out) for learned, out in divided
    ]


def _foreseen(left_out: _LeftOut, start: Touching, rays: Rays) -> tuple[FloatArray, FloatArray]:
    """Foresee touches left out: depths (n, rays) mm, and their readings (n, taxels) kPa."""
    depth = [depths(chart.voxels, out, rays, start.deepest, start.soft + AHEAD) for chart, out in left_out]
    return np.concatenate(depth), np.ascontiguousarray(np.concatenate([out.readings for _, out in left_out]))


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
        displaced=np.array([0.2, 0.02, 0.02, 0.3, 0.3]), swept=0.5, freedom=_FREEDOM, counts=_COUNTS,
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
    feels. trust: how much touches count where a region of poses is stated, by how many met the object: of touches at
    random, and of chosen ones.
    """

    def __init__(
        self,
        charts: Mapping[str, Chart],
        rays: Rays,
        touching: Touching,
        load: float,
        trust: tuple[Trust, Trust] = (Trust(), Trust()),
    ) -> None:
        """Take what was learned of objects, by label. load: N that a touch carries."""
        self.maps = {label: chart.voxels for label, chart in charts.items()}
        self.labels = tuple(charts)
        self.rays, self.touching, self._load, self.trust = rays, touching, load, trust
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
        touching, load, left_out = learn_touching(
            touches, train.taxel_points, rays, dense, options.cell, stroke
        )
        some = left_out[:: -(-len(left_out) // _JUDGED)]
        fields = [(cls({"": chart}, rays, touching, load), out) for chart, out in some]
        trust = _trust(fields, choose=False), _trust(fields, choose=True)
        charts = {
            label: learn_surface(mine, dense, touching.stiffness, options.cell, stroke)
            for label, mine in touches.items()
        }
        return cls(charts, rays, touching, load, trust)

    def reset(self) -> None:
        """Forget all touches."""
        self._readings = np.empty((0, len(self.touching.taxel)))
        self._sensors = np.empty((0, 7))
        self._contacts, self._chosen = 0, False

    @property
    def touches(self) -> int:
        """Count the readings so far; several pads that touch at once are as many."""
        return len(self._readings)

    def append(self, readings: FloatArray, sensors_in_robot: FloatArray, chosen: bool = False) -> None:
        """Add touches: readings (m, taxels) kPa at poses (m, 7), in the robot's frame.

        chosen: whether they were chosen by what they say; then the sequence is one of chosen touches.
        """
        self._readings = np.concatenate([self._readings, readings])
        self._sensors = np.concatenate([self._sensors, sensors_in_robot])
        loud = readings.sum(axis=1) > LOUD * np.linalg.norm(self.touching.noise)
        self._contacts += int(np.count_nonzero(loud))
        self._chosen |= chosen

    @property
    def too_sure(self) -> float:
        """Give the factor by which the variances of poses, given all touches so far, are to be larger, 1 at least."""
        return 1 / self.trust[self._chosen](self._contacts)

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


_TRAVEL = 1.0  # mm by which a pad's travel may be off what is foreseen
_IMAGE = 0.2  # of the usual largest pressure, by which a taxel may be off; neighbours share errors
_PLACES = 4.0  # taxels that are as good as independent


def information(
    field: SpaceField, label: NDArray[np.int64], pose: FloatArray, candidates: FloatArray
) -> FloatArray:
    """Estimate the expected information (k,) nats of touches that start at sensor_in_robot poses (k, 7).

    label: (states,), pose: (states, 7) object_in_robot, equally probable. It is at most log(states).
    """
    count = len(candidates)
    travel, image = [], []
    for one, place in zip(label.tolist(), pose, strict=True):
        gone, seen = field.foresee(one, np.tile(place, (count, 1)), candidates)
        travel.append(gone)
        image.append(seen)
    gone, seen = np.stack(travel, axis=1), np.stack(image, axis=1)  # (k, states), (k, states, taxels)
    largest = seen.max(axis=2)
    width = _IMAGE * float(np.median(largest[largest > 0])) if (largest > 0).any() else 1.0
    squares = (seen**2).sum(axis=2)
    apart = np.maximum(
        squares[:, :, None] + squares[:, None, :] - 2 * np.einsum("kst,kut->ksu", seen, seen), 0.0
    )
    off = ((gone[:, :, None] - gone[:, None, :]) / _TRAVEL) ** 2
    off += apart * (_PLACES / seen.shape[2] / width**2)
    return np.asarray(-np.log(np.exp(-0.5 * off).mean(axis=2)).mean(axis=1), dtype=float)


def scattered(pose: FloatArray, factor: FloatArray, normal: FloatArray) -> FloatArray:
    """Move poses (n, 7) by normal numbers (n, 6) that lower Cholesky factors of the information (n, 6, 6) scale."""
    off = np.linalg.solve(np.swapaxes(factor, 1, 2), normal[:, :, None])[:, :, 0]
    return moved(pose, np.asarray(off, dtype=float))


def moved(pose: FloatArray, off: FloatArray) -> FloatArray:
    """Move poses (n, 7) by [shift, turn] (n, 6), mm and rad, in their own frames."""
    return rigid.compose(pose, np.concatenate([off[:, :3], rigid.from_vector(off[:, 3:])], axis=1))


def moves(start: FloatArray, pose: FloatArray) -> FloatArray:
    """Give the [shift, turn] (n, 6), mm and rad, in the frame of `start` (7,), that bring it to poses (n, 7)."""
    off = rigid.compose(rigid.invert(start), pose)
    return np.concatenate([off[:, :3], rigid.to_vector(off[:, 3:])], axis=1)


def _trust(left_out: list[tuple[SpaceField, Touches]], choose: bool) -> Trust:
    """Find how much touches count so that 90 % regions hold the true pose in 90 % of sequences of left-out ones.

    Split conformal prediction (Vovk et al. 2005): the score of a sequence is by how many times the radius of its 90 %
    region the mean pose is off, squared, as variances go. It grows with the touches, which share the errors of the map,
    and more so where touches are chosen that should say much, as a filter chooses them: there the map has fine parts,
    and errs. Only the belief near the true pose is looked at.

    left_out: a field of each object, alone, and touches that it was learned without, the object in the robot's frame.
    """
    rng = np.random.default_rng(0)
    begun = scattered(
        np.tile(rigid.IDENTITY, (_BEGUN, 1)), np.tile(np.diag(1 / np.repeat(_NEAR, 3)), (_BEGUN, 1, 1)),
        rng.standard_normal((_BEGUN, 6)),
    )  # fmt: skip
    begun[0] = rigid.IDENTITY
    scores: dict[int, list[float]] = {}
    most = min([_MANY, *(len(out.readings) for _, out in left_out)])
    for field, out in left_out:
        sensors = np.concatenate([out.places, rigid.quaternion(out.turns)], axis=1)
        back = field.reach(0) + np.linalg.norm(out.places, axis=1, keepdims=True)
        starts = np.concatenate([out.places - back * out.turns[:, :, 2], sensors[:, 3:]], axis=1)
        for _ in range(_SEQUENCES if most > _FEW else 0):
            left, pose = rng.permutation(len(sensors)), begun
            field.reset()
            while field.touches < most:
                which = 0
                if choose and field.touches >= _ALONE:
                    pose, bent, log_p = field.climb(0, pose, _CHOOSING)
                    some = Weights(log_p).systematic(_STATES, rng)
                    normal = rng.standard_normal((_STATES, 6))
                    factor = np.asarray(np.linalg.cholesky(bent[some]), dtype=float)
                    states = scattered(pose[some], factor, normal)
                    said = information(
                        field, np.zeros(_STATES, dtype=np.int64), states, starts[left[:_OFFERED]]
                    )
                    which = int(said.argmax())
                field.append(out.readings[left[which], None], sensors[left[which], None])
                left = np.delete(left, which)
                if field.touches in (_FEW, most):
                    scores.setdefault(field.touches, []).append(_wrong(field, begun, rng))
    if not scores:
        return Trust()
    few, many = (conformal(scores[count], _SHARE) for count in (_FEW, most))
    shared = max(0.0, (many - few) / (most - _FEW))
    return Trust(own=max(few - _FEW * shared, 1 - shared), shared=shared)


def _wrong(field: SpaceField, begun: FloatArray, rng: np.random.Generator) -> float:
    """Tell by how many times the radius of its 90 % region the mean pose of the best mode is off, squared.

    begun: (n, 7) poses near the true one, `rigid.IDENTITY`, from which better ones are climbed to.
    """
    reached, bent, log_p = field.climb(0, begun, _STEPS)
    best = int(log_p.argmax())
    normal = rng.standard_normal((_DRAWN, 6))
    factor = np.asarray(np.linalg.cholesky(bent[best]), dtype=float) / math.sqrt(_WIDER)
    drawn = scattered(np.tile(reached[best], (_DRAWN, 1)), np.tile(factor, (_DRAWN, 1, 1)), normal)
    held = Weights(field.log_p(0, drawn) + 0.5 * (normal**2).sum(axis=1)).normalised
    off = moves(reached[best], np.concatenate([drawn, rigid.IDENTITY[None]])) * np.repeat([1.0, GYRATION], 3)
    *far, wrong = np.linalg.norm(off - held @ off[:-1], axis=1).tolist()
    order = np.argsort(far)
    radius = far[order[np.searchsorted(np.cumsum(held[order]), _SHARE)]]
    return float((wrong / radius) ** 2)


def conformal(scores: Sequence[float], share: float) -> float:
    """Give the score that so large a share of further ones does not exceed, if all are exchangeable: split conformal.

    The greatest one if there are too few for that.
    """
    rank = math.ceil(share * (len(scores) + 1))
    return sorted(scores)[min(rank, len(scores)) - 1]
