"""How far a geom is from a surface: along each of the surface's normals, the distance to where the geom begins.

A geom is convex, as MuJoCo's collision takes it: a mesh is its convex hull. Each line along a normal enters it
at one point, ahead of the surface or, where the two overlap, behind it.

Where the geom has an edge, the gap jumps. Facets that stand steeply on the surface (walls) therefore do not make
gaps; they bound the part of the surface that the geom covers, and a cell of the lattice on such a bound is covered
in part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.press.pad_kernels import SMALL, STEEP, cut_all, enter, unite
from tactsim.press.pad_surface import Lines

_MM = 1e3  # mm in a metre


@dataclass(frozen=True, eq=False)
class Facets:
    """The flat faces of a convex body, {x: normals x <= offsets}: (f, 3) and (f,) mm in the body's frame.

    middles (f, 3) mm and radii (f,) mm: balls that hold each face, where the faces are many.
    """

    normals: FloatArray
    offsets: FloatArray
    middles: FloatArray | None = None
    radii: FloatArray | None = None

    def near(self, points: FloatArray) -> Facets:
        """Leave out faces that are further from points (n, 3) mm than the body is, by more than the points' spread.

        The faces that are left rise above the points in all directions by that spread, far more than a layer gives way.
        """
        if self.middles is None or self.radii is None:
            return self
        middle = points.mean(axis=0)
        spread = 1.5 * np.sqrt(((points - middle) ** 2).sum(axis=1).max())
        away = np.sqrt(((self.middles - middle) ** 2).sum(axis=1)) - self.radii
        some = away <= max(away.min(), 0.0) + spread
        return Facets(self.normals[some], self.offsets[some])


@dataclass(frozen=True, eq=False)
class Round:
    """A sphere or an ellipsoid by its half-axes, (3,) mm."""

    half: FloatArray


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, by its radius and half its length, mm."""

    radius: float
    half: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z with half a sphere at each end, by its radius and half the cylinder's length, mm."""

    radius: float
    half: float


Body = Facets | Round | Cylinder | Capsule


def body_of(model: mujoco.MjModel, geom: int) -> Body:
    """Describe a geom of a model in its own frame.

    Raises InputError, naming the geom, if it is a height field or a signed distance field.
    """
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom] * _MM
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return Facets(np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Facets(np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([size, size]))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return Round(np.full(3, size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return Round(size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Cylinder(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return Capsule(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _hull(model, model.geom_dataid[geom])
    what = kind.name.removeprefix("mjGEOM_").lower()
    raise InputError(
        f"geom {model.geom(geom).name!r} (number {geom}) is a {what}, which a pad cannot feel: make it of "
        "primitives or meshes, or keep it from touching the pad's geom by contype and conaffinity"
    )


def _hull(model: mujoco.MjModel, mesh: int) -> Facets:
    """Find the facets of a mesh's convex hull, which MuJoCo collides with in its place."""
    from scipy.spatial import ConvexHull

    first = model.mesh_vertadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float) * _MM
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    middles = corners.mean(axis=1)
    radii = np.sqrt(((corners - middles[:, None]) ** 2).sum(axis=2).max(axis=1))
    return Facets(np.ascontiguousarray(hull.equations[:, :3]), -hull.equations[:, 3], middles, radii)


class Cover(NamedTuple):
    """What of a surface a body covers, seen from n cells of a lattice.

    gap: (n,) mm from the surface to the body along the normal, in the middle of the covered part of the cell;
    below 0 where the two overlap, infinite where the line misses the body. share: (n,) of the cell that is
    covered. shift: (2, n) in cells, from the cell's middle to the middle of the covered part along u and v, or
    (2, 1) zeros. Of a body of several geoms there is one row for each covered part of a cell.
    """

    gap: FloatArray
    share: FloatArray
    shift: FloatArray


class Part(NamedTuple):
    """One geom of a rigid body, and its frame in that of the lines: rotation (3, 3) and position (3,) mm."""

    body: Body
    rotation: FloatArray
    position: FloatArray


def union_gaps(
    parts: list[Part], lines: Lines, steps: tuple[float, float], depth: float
) -> tuple[NDArray[np.intp], Cover]:
    """Measure from a surface to a body of several geoms, which may overlap: to the nearest of them at each point.

    depth: mm below the surface, where nothing begins. Returns the k covered parts of cells, at most one for each cell
    and geom, and the cell of each, (k,). Not more than the whole of a cell is covered. `steps` as in `gaps`.
    """
    covers = [gaps(*part, lines, steps) for part in parts]
    if len(parts) == 1:  # the same, sooner
        gap, share, shift = covers[0]
        cell = np.flatnonzero((share > 0) & (gap > -depth) & (gap < np.inf))
        return cell, Cover(gap[cell], share[cell], shift[:, cell] if shift.shape[1] > 1 else shift)
    cells = len(covers[0].gap)
    gap, share = np.array([cover.gap for cover in covers]), np.array([cover.share for cover in covers])
    shift = np.array([np.broadcast_to(cover.shift, (2, cells)) for cover in covers])
    share[(gap <= -depth) | (gap == np.inf)] = 0
    if len(parts) > 1:
        unite(gap, share, shift)
    some = share > 0
    cell = np.nonzero(some)[1]
    return cell, Cover(gap[some], share[some], shift.transpose(1, 0, 2)[:, some])


def gaps(
    body: Body, rotation: FloatArray, position: FloatArray, lines: Lines, steps: tuple[float, float]
) -> Cover:
    """Measure from each point of a surface along its normal to where a body begins.

    rotation (3, 3), position (3,) mm: the body's frame in that of the lines. steps: mm in u and v from
    line to line of the lattice.
    """
    points, normals = (lines.points - position) @ rotation, lines.normals @ rotation
    if isinstance(body, Round):
        return _whole(_round_entry(points / body.half, normals / body.half))
    if isinstance(body, Capsule):
        ends = [np.array([0, 0, sign * body.half]) for sign in (-1.0, 1.0)]
        entries = [_round_entry((points - end) / body.radius, normals / body.radius) for end in ends]
        side = _side_entry(points, normals, body.radius)
        height = points[:, 2] + np.where(np.isfinite(side), side, 0) * normals[:, 2]
        side = np.where(np.abs(height) <= body.half, side, np.inf)
        return _whole(np.minimum(np.minimum(*entries), side))
    spans = np.stack([lines.along_u @ rotation * steps[0], lines.along_v @ rotation * steps[1]])
    if isinstance(body, Cylinder):
        return _cylinder(body, points, normals, spans)
    return _faceted(body.near(points), points, normals, spans)


def _whole(gap: FloatArray) -> Cover:
    return Cover(gap, np.ones(len(gap)), np.zeros((2, 1)))


def _round_entry(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Find where lines enter the unit sphere: (n,), infinite where they miss it."""
    a, b = np.einsum("ij,ij->i", normals, normals), np.einsum("ij,ij->i", points, normals)
    inside = b * b - a * (np.einsum("ij,ij->i", points, points) - 1)
    return np.where(inside >= 0, (-b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)


def _side_entry(points: FloatArray, normals: FloatArray, radius: float) -> FloatArray:
    """Find where lines enter an endless cylinder along z: (n,), infinite where they miss it."""
    a = np.maximum(normals[:, 0] ** 2 + normals[:, 1] ** 2, SMALL)
    b = points[:, 0] * normals[:, 0] + points[:, 1] * normals[:, 1]
    inside = b * b - a * (points[:, 0] ** 2 + points[:, 1] ** 2 - radius**2)
    return np.where(inside >= 0, (-b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)


def _cylinder(body: Cylinder, points: FloatArray, normals: FloatArray, spans: FloatArray) -> Cover:
    caps = Facets(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), np.full(2, body.half))
    upright = np.hypot(normals[:, 0], normals[:, 1]) < STEEP  # then the side is a wall
    if not upright.all():
        side = np.where(upright, -np.inf, _side_entry(points, normals, body.radius))
        return _faceted(caps, points, normals, spans, before=side)
    gap = _faceted(caps, points, normals, spans).gap
    entry = points + gap[:, None] * normals
    distance = np.maximum(np.hypot(entry[:, 0], entry[:, 1]), SMALL)
    # The rim is a wall that turns with the point: its part along each side of a cell.
    across = np.einsum("kij,ij->ki", spans[..., :2], entry[:, :2]) / distance
    share, shift = np.empty_like(gap), np.empty_like(across)
    cut_all(distance - body.radius, across, share, shift)
    return Cover(gap, share, shift)


def _faceted(
    body: Facets, points: FloatArray, normals: FloatArray, spans: FloatArray, before: FloatArray | None = None
) -> Cover:
    """Enter a body of flat faces: the last face that a line passes inwards, within the walls.

    before: (n,) mm, where the line enters what else bounds the body.
    """
    cells = len(points)
    gap, share, shift = np.empty(cells), np.empty(cells), np.empty((2, cells))
    before = np.empty(0) if before is None else before
    cuts = enter(body.normals, body.offsets, points, normals, spans[0], spans[1], before, gap, share, shift)
    return Cover(gap, share, shift if cuts else np.zeros((2, 1)))
