"""Touch objects in space: the pad comes from any side along its normal until it carries the set force.

The touches of a scan are those that teach it, even over an object's surface, and touches from anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tactsim import models
from tactsim.core.checking import Settings, checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import InputError, unknown
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import OWN_LICENCE
from tactsim.core.rigid import (
    checked_poses,
    compose,
    from_vector,
    matrix,
    multiply,
    random_rotations,
    turn_from_z,
    turned,
)
from tactsim.core.scan import SPLITS
from tactsim.core.seeds import stream
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import check_names
from tactsim.press.sensor import gains, sense
from tactsim.press.spread import felt_along
from tactsim.solids.scan import SpaceOptions, SpaceScan
from tactsim.solids.touch_kernels import COARSE, STATE, Lattice, Layer, Mesh, Starts, touch_all

_KPA = 1e3  # kPa in a N/mm^2
_PARTS = 4  # of a cell along each axis, over which what a taxel feels is averaged
_EDGE = 1e-9  # mm by which a point may lie beside the pad and still be on it


@dataclass(frozen=True, eq=False)
class PadLattice:
    """The points of the pad's surface, and its taxels.

    kpa: what a taxel reads of 1 N. taxel_points, taxel_normals: (taxels, 3) mm and unit vectors, where the taxels'
    middles are and look.
    """

    points: Lattice
    kpa: float
    taxel_points: FloatArray
    taxel_normals: FloatArray


def pad_lattice(options: SpaceOptions) -> PadLattice:
    """Lay the options' pad on its body.

    Raises InputError if the pad reaches further round the body than a pad can.
    """
    pad, sigma = options.pad, options.sensor.psf_sigma
    x_low, x_high, y_low, y_high = pad.load_bounds
    low, high = np.array([x_low, y_low]), np.array([x_high, y_high])
    if options.radius is None:
        start, end = low, high
    else:
        start, end = _shadow(low, options), _shadow(high, options)
    count = COARSE * np.ceil((end - start) / options.spacing / COARSE - _EDGE).astype(int)
    columns, rows = int(count[0]), int(count[1])
    step = (end - start) / count
    x, y = start[0] + step[0] * (np.arange(columns) + 0.5), start[1] + step[1] * (np.arange(rows) + 0.5)
    at = np.stack([np.tile(x, rows), np.repeat(y, columns)], 1)
    taxels = pad.taxel_xy
    if options.radius is None:
        surface, facing = np.zeros(len(at)), np.ones(len(at))
        taxel_points = np.column_stack([taxels, np.zeros(len(taxels))])
        normals = np.tile((0.0, 0.0, 1.0), (len(taxels), 1))
    else:
        at, surface, facing, taxel_points, normals = _laid(
            at, taxels, low, high, options.radius, options.body
        )
    cell = np.clip(np.floor((at - low) / (high - low) * count), 0, count - 1).astype(np.int64)
    felt_u = _felt(x_low, x_high, columns, pad.column_edges, sigma)
    felt_v = _felt(y_low, y_high, rows, pad.row_edges, sigma)
    kpa = _KPA / (pad.taxel_width * pad.taxel_height)
    bounds = np.array(pad.load_bounds) if options.radius is None else np.full(4, np.nan)
    points = Lattice(start + step / 2, step, columns, rows, bounds, surface, facing, cell, felt_u, felt_v)
    return PadLattice(points, kpa, taxel_points, normals)


def _shadow(edge: FloatArray, options: SpaceOptions) -> FloatArray:
    """Tell where edges (2,) mm along the pad's surface lie along its x and y, mm."""
    assert options.radius is not None
    round_x, round_y = options.radius * np.sin(edge / options.radius)
    return np.array([round_x, round_y if options.body == "sphere" else edge[1]])


def _laid(
    at: FloatArray, taxels: FloatArray, low: FloatArray, high: FloatArray, radius: float, body: str
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lay the lattice and the taxels on a cylinder or sphere.

    at: (points, 2) mm along x and y. taxels: (taxels, 2) mm and low, high: (2,) mm, along the surface.
    Returns the points (points, 2) mm along the surface, their z mm, NaN beside the pad, and the normals' part along z;
    and of the taxels the points (taxels, 3) mm and normals. Raises InputError if the pad reaches too far round.
    """
    import mujoco

    from tactsim.attach.pad_surface import pad_axes, pad_surface

    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{body.upper()}")
    half_length = float(np.abs([low[1], high[1]]).max())
    surface = pad_surface(
        kind, np.array([radius, half_length, 0]) / 1e3, pad_axes(np.array([1.0, 0, 0])), np.zeros(2), body
    )
    beyond = np.maximum(surface.face.low - low, high - surface.face.high).max()
    if beyond > _EDGE:
        reach = float(np.abs([low, high]).max() if body == "sphere" else np.abs([low[0], high[0]]).max())
        least = radius * reach / float(surface.face.high[0])
        raise InputError(
            f"radius is {radius:g} mm, and the pad reaches too far round such a {body}: it needs {least:.2f} mm or more"
        )
    across = at[:, 0] ** 2 + (at[:, 1] ** 2 if body == "sphere" else 0)
    on = across < radius**2
    z = np.sqrt(np.where(on, radius**2 - across, 0.0)) - radius
    laid = surface.place(np.column_stack([at, z]))
    on &= (laid > low - _EDGE).all(axis=1) & (laid < high + _EDGE).all(axis=1)
    facing = np.where(on, (z + radius) / radius, 1.0)
    lines = surface.lines(*np.ascontiguousarray(taxels.T))
    return laid, np.where(on, z, np.nan), facing, lines.points, lines.normals


def _felt(low: float, high: float, count: int, edges: FloatArray, sigma: float) -> FloatArray:
    """Tell which share of a force on one of `count` cells falls on each taxel along one axis: (2, count, taxels).

    The force is even over a cell, and over COARSE cells about it.
    """
    width = (high - low) / count
    middle = low + width * (np.arange(count) + 0.5)
    felt = []
    for wide in (width, COARSE * width):
        if sigma == 0:
            ends = middle[:, None, None] + wide / 2 * np.array([-1.0, 1.0])
            felt.append(np.diff(np.clip(ends, edges[:, :1], edges[:, 1:]), axis=-1)[..., 0] / wide)
        else:
            parts = wide * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
            felt.append(felt_along(middle[:, None] + parts, edges, sigma).mean(axis=1))
    return np.array(felt)


@dataclass(frozen=True, eq=False)
class Touched:
    """What n touches of one object came to; poses are sensor_in_object.

    stated, true: (n, 7), where the robot says that the pad rests, and where it does. travel: (n,) mm along the pad's z.
    met: (n,), whether the pad met the object; one that met nothing rests at the end of its stroke and reads 0.
    force: (n,) N that the pad carries: the set force, or less where the stroke ended before.
    readings: (n, taxels) kPa at rest.
    """

    stated: FloatArray
    true: FloatArray
    travel: FloatArray
    met: NDArray[np.bool_]
    force: FloatArray
    readings: FloatArray


class SpacePress:
    """A pad that touches objects at rest, under force control.

    solids: the objects, by their names. Of `options` the objects' names and the numbers of touches do not count.
    A pad is held rigidly and comes along its z axis from outside the object, whatever lies behind `start`. Its layer is
    a bed of independent springs (Winkler): pressure = stiffness * depth, never below 0, both along the pad's normal.
    Only the pad's own surface touches (`Pad.load_bounds`); its sides and what carries it do not.
    Raises InputError if the pad does not fit its body.
    """

    def __init__(self, solids: Iterable[models.Solid], options: SpaceOptions) -> None:
        self.options = options
        self.solids = {solid.name: solid for solid in solids}
        self.lattice = pad_lattice(options)
        self._gain = gains(ScanOptions(pad=options.pad, sensor=options.sensor, seed=options.seed))

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator | None = None) -> Touched:
        """Touch an object from stated starts (n, 7), sensor_in_object; the readings have no imperfections.

        rng: draws how far the stated pose at rest is off the true one (`placement_mm`, `placement_rad`); none if it is
        None. Drawn at the start, an error in angle would grow sideways with the way that the pad goes.
        A layer that the force would press by more than its thickness is just so stiff that it gives way by that.
        Raises InputError if there is no such object or a start is no pose.
        """
        start = checked_poses(start, "start")
        touched = self.touch_from(label, start, start, np.full(start.shape[:-1], self.options.stroke))
        if rng is None:
            return touched
        return replace(touched, stated=misplaced(touched.true, self.options, rng))

    def touch_from(self, label: str, start: FloatArray, true: FloatArray, stroke: FloatArray) -> Touched:
        """Touch an object from starts (n, 7) that are truly at `true` (n, 7), each over its own stroke (n,) mm."""
        if label not in self.solids:
            raise unknown("object", label, list(self.solids))
        if start.ndim != 2:
            raise InputError(f"start has shape {start.shape}; it is a table of poses, (n, 7)")
        solid, options, lattice = self.solids[label], self.options, self.lattice
        states = np.empty((len(start), STATE))
        images = np.empty((len(start), options.pad.taxels))
        touch_all(
            Mesh(solid.vertices.astype(float), solid.faces.astype(np.int64)),
            Starts(np.ascontiguousarray(true[:, :3]), np.ascontiguousarray(matrix(true[:, 3:])), stroke),
            lattice.points,
            Layer(1e-3 * options.stiffness, float(options.thickness)),
            options.force,
            states,
            images,
        )
        images *= lattice.kpa
        travel, force = states[:, 0], states[:, 1]
        return Touched(advanced(start, travel), advanced(true, travel), travel, force > 0, force, images)

    def sensed(self, touched: Touched, rng: np.random.Generator) -> Touched:
        """Give the touches with what the pad reports of them, one after the other: noise, steps and its other faults.

        A touch that met nothing has them too.
        """
        sensor, rows = self.options.sensor, self.options.pad.rows
        return replace(touched, readings=sense(touched.readings, sensor, self._gain, rng, rows=rows))


def advanced(pose: FloatArray, distance: FloatArray) -> FloatArray:
    """Move poses (n, 7) by distances (n,) mm along their own z axes."""
    moved = pose.copy()
    moved[:, :3] += distance[:, None] * matrix(pose[:, 3:])[:, :, 2]
    return moved


def misplaced(pose: FloatArray, options: SpaceOptions, rng: np.random.Generator) -> FloatArray:
    """Draw poses (..., 7) that are off the given ones by a placement error in the pads' own frames."""
    error = rng.standard_normal((*pose.shape[:-1], 6))
    turn = from_vector(options.placement_rad * error[..., 3:])
    return compose(pose, np.concatenate([options.placement_mm * error[..., :3], turn], axis=-1))


_APART = 0.5  # mm that pads of one hand keep from each other


class HandPad(Settings):
    """One pad of a hand."""

    pose: tuple[float, float, float, float, float, float, float] = Field(
        description="[x, y, z, qw, qx, qy, qz] of the pad in the hand's frame, mm, where its stroke begins"
    )
    stroke: float = Field(60.0, gt=0, le=1000, description="mm that the pad goes along its normal at most")

    @model_validator(mode="after")
    def _turned(self) -> HandPad:
        try:
            checked_poses(self.pose, "pose")
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class Hand(Settings):
    """A hand of two to five pads, all of one kind: an estimator learns how one pad feels an object."""

    name: str = Field("hand", min_length=1, max_length=100)
    body: Literal["flat", "cylinder", "sphere"] = Field("flat", description="what every pad is laid on")
    radius: float | None = Field(None, gt=0, le=1e6, description="mm of the cylinders or spheres")
    pads: tuple[HandPad, ...] = Field(min_length=2, max_length=5)

    @classmethod
    def load(cls, path: str | Path) -> Hand:
        """Read a hand from a TOML file. Raises InputError if it cannot be read or a value is wrong."""
        return checked(cls, read_toml(path, "hand"), f"hand {path}")

    def options(self, options: SpaceOptions) -> SpaceOptions:
        """Give the options with the hand's pads: with them a scan teaches what such a pad feels.

        Raises InputError if a radius is missing or given for flat pads.
        """
        values = options.model_dump() | {"body": self.body, "radius": self.radius}
        return checked(SpaceOptions, values, f"hand {self.name}")


class HandPress:
    """A hand that touches objects: all pads close at once, each along its z axis until it carries the force.

    A pad that carries the force, ends its stroke or would run into another pad of the hand stops; the others go on. The
    hand is stiff: where it is off its stated pose, all its pads are.
    Raises InputError if two pads overlap where their strokes begin, or a pad does not fit its body.
    """

    def __init__(self, solids: Iterable[models.Solid], hand: Hand, options: SpaceOptions) -> None:
        self.hand, self.options = hand, hand.options(options)
        self.press = SpacePress(solids, self.options)
        self._pads = checked_poses([pad.pose for pad in hand.pads], "pads")
        self._strokes = np.array([pad.stroke for pad in hand.pads])
        lattice = pad_lattice(self.options)
        x_low, x_high, y_low, y_high = options.pad.load_bounds
        back = float(np.nanmin(lattice.points.surface)) - options.thickness
        self._box = np.array([[x_low, y_low, back], [x_high, y_high, 0.0]])
        for first, second in combinations(range(len(self._pads)), 2):
            if _overlap(self._pads[[first]], self._pads[[second]], self._box, 0.0)[0]:
                raise InputError(
                    f"hand {hand.name}: pads {first + 1} and {second + 1} overlap where their strokes begin; "
                    "move them apart"
                )

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator | None = None) -> Touched:
        """Touch an object with all pads from a stated start (7,), hand_in_object: one touch for each pad.

        rng: draws how far the true start is off the stated one; without it it is not.
        Raises InputError if there is no such object or the start is no pose.
        """
        start = checked_poses(start, "start")
        if start.shape != (7,):
            raise InputError(f"start has shape {start.shape}; it is one pose, (7,)")
        true = start if rng is None else misplaced(start, self.options, rng)
        stated, true = compose(start, self._pads), compose(true, self._pads)
        touched = self.press.touch_from(label, stated, true, self._strokes)
        stops = self._stops(touched.travel)
        if (stops == touched.travel).all():
            return touched
        return self.press.touch_from(label, stated, true, np.minimum(stops, self._strokes))

    def sensed(self, touched: Touched, rng: np.random.Generator) -> Touched:
        """Give the touches with what the pads report of them; see `SpacePress.sensed`."""
        return self.press.sensed(touched, rng)

    def _stops(self, travel: FloatArray) -> FloatArray:
        """Tell how far pads go (pads,) mm that would go `travel` if no other were in the way: all at one speed."""
        stops = travel.copy()
        times = np.arange(min(0.0, float(travel.min())), float(travel.max()) + _APART, _APART / 2)
        while True:
            met = []
            for first, second in combinations(range(len(stops)), 2):
                one, other = (
                    advanced(np.repeat(self._pads[[pad]], len(times), 0), np.minimum(times, stops[pad]))
                    for pad in (first, second)
                )
                moving = (times < stops[first]) | (times < stops[second])
                at = np.flatnonzero(_overlap(one, other, self._box, _APART) & moving)
                if len(at):
                    met.append((times[at[0]], first, second))
            if not met:
                return stops
            time, first, second = min(met)
            stops[[first, second]] = np.minimum(stops[[first, second]], time)


def _overlap(first: FloatArray, second: FloatArray, box: FloatArray, apart: float) -> NDArray[np.bool_]:
    """Tell of n pairs of equal boxes (2, 3) mm at poses (n, 7) each whether they are less than `apart` mm apart: (n,).

    Two boxes are apart if they are along a normal of a side of one, or across an edge of both (Gottschalk et al. 1996).
    """
    turn_a, turn_b = matrix(first[:, 3:]), matrix(second[:, 3:])
    middle, half = box.mean(axis=0), (box[1] - box[0]) / 2
    between = (second[:, :3] + turn_b @ middle) - (first[:, :3] + turn_a @ middle)
    edges_a, edges_b = np.swapaxes(turn_a, 1, 2), np.swapaxes(turn_b, 1, 2)
    across = np.cross(edges_a[:, :, None], edges_b[:, None]).reshape(-1, 9, 3)
    length = np.linalg.norm(across, axis=2, keepdims=True)
    across = np.divide(across, length, out=np.zeros_like(across), where=length > 1e-9)
    axes = np.concatenate([edges_a, edges_b, across], axis=1)
    reach = np.abs(axes @ turn_a) @ half + np.abs(axes @ turn_b) @ half
    gaps = np.abs(np.einsum("nai,ni->na", axes, between)) - reach
    gaps[:, 6:][length[..., 0] <= 1e-9] = -np.inf  # edges that are parallel
    return np.asarray(gaps.max(axis=1) < apart)


_CANDIDATES = 8  # points drawn for each that is kept
_CLEAR = 1.0  # mm between an object's bounding sphere and the pads that start outside


def scan_solids(
    options: SpaceOptions, *, progress: Callable[[int, int], None] | None = None
) -> tuple[SpaceScan, dict[str, Any]]:
    """Touch every object: `touch_grid` to train, touches from anywhere to test.

    progress(done, total): called as touches are done. Returns the scan and its work: `presses`, and of those `misses`.
    The same options give the same bits, and an object's readings do not depend on the other objects.

    Raises InputError for an object or mesh that does not exist, or is none that can be touched.
    """
    solids = solids_of(options)
    press = SpacePress(solids, options)
    done, total = 0, len(solids) * (options.points * options.turns + options.tests)
    batches, labels, splits = [], [], []
    for solid in solids:
        for split in SPLITS:
            draw = stream(options.seed, solid.name, split, "touches")
            starts = (
                touch_grid(solid, options.points, options.turns, options.lean, draw)
                if split == "train"
                else random_starts(solid, options.tests, draw)
            )
            touched = press.touch(solid.name, starts, stream(options.seed, solid.name, split, "placement"))
            batches.append(press.sensed(touched, stream(options.seed, solid.name, split, "sense")))
            labels += [solid.name] * len(starts)
            splits += [split] * len(starts)
            done += len(starts)
            if progress is not None:
                progress(done, total)
    scan = SpaceScan(
        readings=np.concatenate([batch.readings for batch in batches]),
        poses=np.concatenate([batch.stated for batch in batches]),
        labels=np.array(labels),
        split=np.array(splits),
        taxel_points=press.lattice.taxel_points,
        taxel_normals=press.lattice.taxel_normals,
        touch=np.arange(len(labels)),
        meta={
            "source": "simulated",
            "options": options.model_dump(mode="json"),
            "stroke": options.stroke,
            **({"load_bounds": options.pad.load_bounds} if options.radius is None else {}),
            "objects": {solid.name: solid.facts() for solid in solids},
            "versions": {"numpy": np.__version__, "tactsim": version("tactsim")},
            # Whose a user's own meshes are is not ours to say.
            **({} if options.meshes else {"licence": OWN_LICENCE}),
        },
    )
    misses = sum(int(np.count_nonzero(~batch.met)) for batch in batches)
    return scan, {"presses": len(scan), "misses": misses, "skipped": {}}


def solids_of(options: SpaceOptions) -> list[models.Solid]:
    """Build the objects and read the meshes that a scan touches, in its order.

    Raises InputError for one that does not exist or is none, and if two have the same name.
    """
    solids = [models.solid(name) for name in options.objects]
    solids += [models.read_solid_file(path) for path in options.meshes]
    check_names([solid.name for solid in solids], "objects", "touch: name an object or a mesh")
    return solids


def touch_grid(
    solid: models.Solid, points: int, turns: int, lean: float, rng: np.random.Generator
) -> FloatArray:
    """Choose where touches that teach an object start: (points * turns, 7) sensor_in_object, outside the object.

    The points lie even in area over the surface: each is the one farthest from those before, of many drawn evenly. The
    pad aims at each along its inward normal, turned about it by `turns` even angles from one drawn at random. All but
    the first of these touches lean: the pad is turned about the point by up to `lean` rad, to any side, so that edges
    and corners are touched as well as faces. Where something else of the object is in the way, that is touched.
    """
    drawn, normals = solid.sample_surface(_CANDIDATES * points, rng)
    chosen = np.empty(points, dtype=np.intp)
    away = np.full(len(drawn), np.inf)
    chosen[0] = 0
    for number in range(1, points):
        away = np.minimum(away, np.sum((drawn - drawn[chosen[number - 1]]) ** 2, axis=1))
        chosen[number] = away.argmax()
    first = rng.uniform(0, 2 * math.pi, points)
    angles = (first[:, None] + 2 * math.pi * np.arange(turns) / turns).ravel()
    about_z = from_vector(np.stack([np.zeros_like(angles), np.zeros_like(angles), angles], axis=1))
    rotations = multiply(np.repeat(turn_from_z(-normals[chosen]), turns, axis=0), about_z)
    # Even over the directions of a cone.
    tilt = np.arccos(1 - rng.random(points * turns) * (1 - math.cos(lean)))
    tilt[::turns] = 0.0
    side = rng.uniform(0, 2 * math.pi, points * turns)
    leaning = from_vector(np.stack([tilt * np.cos(side), tilt * np.sin(side), np.zeros_like(side)], axis=1))
    return _starts(np.repeat(drawn[chosen], turns, axis=0), multiply(rotations, leaning), solid.radius)


def random_starts(solid: models.Solid, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw where touches from anywhere start: (count, 7) sensor_in_object, outside the object.

    All rotations are alike, and the points aimed at are even in the box that holds the object.
    """
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    return _starts(rng.uniform(low, high, (count, 3)), random_rotations(count, rng), solid.radius)


def _starts(aim: FloatArray, rotations: FloatArray, radius: float) -> FloatArray:
    """Go back from points (n, 3) mm along the pad's normal until the whole pad is outside a sphere about the origin."""
    normal = turned(rotations, np.array([0.0, 0.0, 1.0]))
    back = radius + _CLEAR + np.einsum("ij,ij->i", aim, normal)
    return np.concatenate([aim - back[:, None] * normal, rotations], axis=1)
