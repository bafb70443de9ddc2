"""The surface of a geom that carries a pad: flat, or curved as a cylinder, a sphere or an ellipsoid is.

The pad's frame has its origin at the pad's middle, z along the surface's outward normal there, columns of
taxels along +x and rows along +y. (u, v) are the pad's own coordinates on the surface, mm: the length along
the surface from the middle, as on a foil that is laid around it, except on an ellipsoid, where they are x and y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from tactsim.core.compiling import Reals1D, Reals2D, Reals3D, compiled
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_ROUND = 1.5  # rad from the middle to which a pad may reach around a sphere's or a cylinder's surface
_OVER_END = math.pi / 3  # rad from a capsule's side over its end, where a circle around it is half as long
_FLATTENED = 0.67  # share of an ellipsoid's half-axes to which a pad may reach, corners within 0.95
_PARALLEL = 1e-6
_SMALL = 1e-12
FLAT, AROUND, OVER, PROJECTED, RELIEF = range(5)


class Face(NamedTuple):
    """A surface as the compiled loops take it.

    kind: FLAT, AROUND a cylinder along y, OVER a sphere, PROJECTED on an ellipsoid, or RELIEF. size: (3,) mm, the
    radius first, or an ellipsoid's half-axes; of a cylinder then where a round end begins, from its middle along y, and
    where the pad's middle is from there. grid: (4,) mm, where a relief's grid begins along x and y and how far its
    points are apart. relief: (columns, rows, 6), height mm, slopes along x and y, 1 where there is a surface, and
    how often it jumps between geoms along x, and along y, up to there in both.
    low, high: (2,) mm, where the face ends in (u, v). depth: mm of the geom below the face; no contact reaches deeper.
    """

    kind: int
    size: Reals1D
    grid: Reals1D
    relief: Reals3D
    low: Reals1D
    high: Reals1D
    depth: float


class Lines(NamedTuple):
    """Points of a surface and the lines along its normals there, n of them, in the pad's frame.

    points, normals: (n, 3) mm and unit vectors. span_u, span_v: (n, 3) mm, the sides of a cell of the surface. area:
    (n,) mm^2 of surface for a mm^2 of (u, v). Where all lines are parallel, normals and spans have one row.
    """

    points: Reals2D
    normals: Reals2D
    span_u: Reals2D
    span_v: Reals2D
    area: Reals1D


@dataclass(frozen=True, eq=False)
class PadSurface:
    """The face of a geom that carries a pad.

    origin: (3,) mm and axes: (3, 3), columns x, y, z, the pad's frame in the geom's.
    """

    origin: FloatArray
    axes: FloatArray
    face: Face

    def lines(self, u: FloatArray, v: FloatArray) -> Lines:
        """Lay lines along the normals at u and v, (n,) mm, with spans for cells of 1 x 1 mm."""
        return lay_lines(self.face, u, v, 1.0, 1.0)

    def place(self, points: FloatArray) -> FloatArray:
        """Give the (u, v) of the surface below points (k, 3) mm of the pad's frame: (k, 2) mm."""
        return place(self.face, np.ascontiguousarray(points))


def _face(kind: int, size: FloatArray | float, low: FloatArray, high: FloatArray, depth: float) -> Face:
    """Describe a face that is no relief."""
    half = np.full(3, float(size)) if isinstance(size, float) else np.array(size, dtype=float)
    grid, relief = np.zeros(4), np.zeros((1, 1, 6))
    return Face(kind, half, grid, relief, low.astype(float), high.astype(float), float(depth))


def pad_surface(
    kind: int, size: FloatArray, axes: FloatArray, at: FloatArray, name: str, *, over_ends: bool = False
) -> PadSurface:
    """Find the face of a primitive geom on which a pad lies with these axes, (3, 3) in the geom's frame.

    kind: mujoco.mjtGeom. size: (3,) m, as in mjModel.geom_size. axes: columns x, y, z, as `pad_axes` lays them; z is
    the outward normal at the pad's middle. at: (2,) mm, the pad's middle from the face's middle along the pad's x and
    y. over_ends: a capsule's side goes on over its ends, true to length along y.
    Raises InputError, which begins with `name`, where the geom has no such face.
    """
    size = np.asarray(size) * _MM
    normal = axes[:, 2]
    along = normal[2]
    geom = mujoco.mjtGeom
    if kind == geom.mjGEOM_PLANE:
        _require(along > 1 - _PARALLEL, name, "is a plane, whose pad looks along +z: give normal=(0, 0, 1)")
        half = np.where(size[:2] > 0, size[:2], np.inf)
        return PadSurface(axes @ [*at, 0], axes, _face(FLAT, 0.0, -half - at, half - at, np.inf))
    if kind == geom.mjGEOM_BOX:
        half = np.abs(axes).T @ size
        _require(
            np.abs(normal).max() > 1 - _PARALLEL, name, "is a box: its pad looks along an axis of the box"
        )
        face = _face(FLAT, 0.0, -half[:2] - at, half[:2] - at, 2 * half[2])
        return PadSurface(axes @ [*at, half[2]], axes, face)
    if kind in (geom.mjGEOM_CYLINDER, geom.mjGEOM_CAPSULE) and abs(along) < _PARALLEL:
        radius, half_length = size[:2]
        angle = at[0] / radius  # around the axis, from the middle
        turned = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        axes = axes @ turned
        over = _OVER_END * radius if over_ends else 0.0
        edge = np.array([_ROUND * radius, half_length + over])
        middle = np.array([0, at[1]])
        around = np.array([radius, half_length if over_ends else np.inf, at[1]])
        face = _face(AROUND, around, -edge - middle, edge - middle, radius)
        return PadSurface(axes @ [0, at[1], radius], axes, face)
    if kind == geom.mjGEOM_CYLINDER:
        raise InputError(f"{name} is a cylinder: its pad lies on its side, with a normal across its axis z")
    _require(not at.any(), name, "is round: turn the pad's normal instead of giving `at`")
    if kind == geom.mjGEOM_SPHERE or (kind == geom.mjGEOM_CAPSULE and abs(along) > 1 - _PARALLEL):
        radius, beyond = size[0], size[1] if kind == geom.mjGEOM_CAPSULE else 0.0
        edge = np.full(2, _ROUND / np.sqrt(2) * radius)
        return PadSurface(normal * (radius + beyond), axes, _face(OVER, float(radius), -edge, edge, radius))
    if kind == geom.mjGEOM_ELLIPSOID:
        _require(
            np.abs(normal).max() > 1 - _PARALLEL, name, "is an ellipsoid: its pad looks along one of its axes"
        )
        half = np.abs(axes).T @ size
        edge = _FLATTENED * half[:2]
        return PadSurface(normal * half[2], axes, _face(PROJECTED, half, -edge, edge, half.min()))
    if kind == geom.mjGEOM_CAPSULE:
        raise InputError(f"{name} is a capsule: its pad's normal lies across its axis z or along it")
    what = geom(kind).name.removeprefix("mjGEOM_").lower()
    raise InputError(f"{name} is a {what}: a pad lies on a primitive or a mesh")


def matrix(quat: FloatArray) -> FloatArray:
    """Write a unit quaternion (4,), the real part first, as a rotation (3, 3)."""
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, quat)
    return turned.reshape(3, 3)


def pad_axes(normal: FloatArray) -> FloatArray:
    """Lay a pad's axes into a frame in which it looks along `normal` (3,): (3, 3), columns x, y, z.

    y is the frame's z axis, or its y axis where the pad looks along z; x is y cross normal.
    """
    normal = normal / np.linalg.norm(normal)
    y = np.array([0.0, 1.0, 0.0]) if abs(normal[2]) > 1 - _PARALLEL else np.array([0.0, 0.0, 1.0])
    y = y - (y @ normal) * normal
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, normal), y, normal])


def _require(holds: bool, name: str, message: str) -> None:
    if not holds:
        raise InputError(f"{name} {message}")


@compiled(called_from_python=False)
def dot(left: Reals2D, row: int, right: Reals2D, other: int) -> float:
    """Multiply a row of left (n, 3) with one of right (m, 3)."""
    return left[row, 0] * right[other, 0] + left[row, 1] * right[other, 1] + left[row, 2] * right[other, 2]


@compiled()
def lay_lines(face: Face, u: Reals1D, v: Reals1D, du: float, dv: float) -> Lines:
    """Lay n lines along the normals at u and v (n,) mm of a face, in the middles of cells of du x dv mm."""
    count = 1 if face.kind == FLAT else len(u)
    points, area = np.zeros((len(u), 3)), np.ones(len(u))
    normals, span_u, span_v = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    before, sine, cosine = np.nan, 0.0, 1.0
    for i in range(len(u)):
        if face.kind == AROUND:
            radius, side = face.size[0], v[i] + face.size[2]
            if u[i] != before:  # a lattice comes column by column
                before, sine, cosine = u[i], math.sin(u[i] / radius), math.cos(u[i] / radius)
            over = max(abs(side) - face.size[1], 0.0) / radius
            up, out = 0.0, 1.0
            if over > 0:  # on a round end the normal leans: so much along y, and so much across it
                up, out = math.copysign(math.sin(over), side), math.cos(over)
            points[i, 0], points[i, 1], points[i, 2] = radius * out * sine, v[i], radius * (out * cosine - 1)
            if over > 0:
                points[i, 1] = math.copysign(face.size[1], side) + radius * up - face.size[2]
            normals[i, 0], normals[i, 1], normals[i, 2] = out * sine, up, out * cosine
            span_u[i, 0], span_u[i, 2] = du * out * cosine, -du * out * sine
            span_v[i, 0], span_v[i, 1], span_v[i, 2] = -dv * up * sine, dv * out, -dv * up * cosine
            area[i] = out
            continue
        if face.kind == OVER:
            # True to length along each line through the pole, which is at x, y from the middle.
            radius, distance = face.size[0], max(math.hypot(u[i], v[i]), _SMALL)
            x, y, angle = u[i] / distance, v[i] / distance, distance / radius
            sine, cosine = math.sin(angle), math.cos(angle)
            narrowed = sine / angle  # a circle about the pole over one in the plane
            points[i, 0], points[i, 1] = radius * sine * x, radius * sine * y
            points[i, 2] = radius * (cosine - 1)
            normals[i, 0], normals[i, 1], normals[i, 2] = sine * x, sine * y, cosine
            span_u[i, 0] = du * (cosine * x * x + narrowed * y * y)
            span_u[i, 1], span_v[i, 0] = du * (cosine - narrowed) * x * y, dv * (cosine - narrowed) * x * y
            span_v[i, 1] = dv * (cosine * y * y + narrowed * x * x)
            span_u[i, 2], span_v[i, 2] = -du * sine * x, -dv * sine * y
            area[i] = narrowed
            continue
        points[i, 0], points[i, 1] = u[i], v[i]
        slope_u = slope_v = 0.0
        if face.kind == PROJECTED:
            a, b, c = face.size[0], face.size[1], face.size[2]
            height = math.sqrt(1 - (u[i] / a) ** 2 - (v[i] / b) ** 2)
            slope_u, slope_v = -c * u[i] / (a * a * height), -c * v[i] / (b * b * height)
            points[i, 2] = c * (height - 1)
        elif face.kind == RELIEF:
            x, y, step_x, step_y = face.grid[0], face.grid[1], face.grid[2], face.grid[3]
            column = min(max(int(np.rint((u[i] - x) / step_x)), 0), face.relief.shape[0] - 1)
            row = min(max(int(np.rint((v[i] - y) / step_y)), 0), face.relief.shape[1] - 1)
            slope_u, slope_v = face.relief[column, row, 1], face.relief[column, row, 2]
            points[i, 2] = face.relief[column, row, 0]
            points[i, 2] += slope_u * (u[i] - x - column * step_x) + slope_v * (v[i] - y - row * step_y)
            area[i] = face.relief[column, row, 3]
        if i < count:
            slanted = math.sqrt(1 + slope_u * slope_u + slope_v * slope_v)
            area[i] *= slanted
            normals[i, 0], normals[i, 1], normals[i, 2] = -slope_u / slanted, -slope_v / slanted, 1 / slanted
            span_u[i, 0], span_u[i, 2], span_v[i, 1], span_v[i, 2] = du, du * slope_u, dv, dv * slope_v
    return Lines(points, normals, span_u, span_v, area)


@compiled(called_from_python=False)
def steps(face: Face, low: Reals1D, high: Reals1D, along: int) -> bool:
    """Tell whether a relief jumps along x or y (0, 1) within low and high, (2,) mm: by its jumps before the corners."""
    if face.kind != RELIEF:
        return False
    jumps = face.relief[:, :, 4 + along]
    first, last = np.empty(2, dtype=np.int64), np.empty(2, dtype=np.int64)
    for i in range(2):
        most = jumps.shape[i] - 1
        first[i] = min(max(math.floor((low[i] - face.grid[i]) / face.grid[2 + i]), 0), most)
        last[i] = min(max(math.ceil((high[i] - face.grid[i]) / face.grid[2 + i]), 0), most)
    far = jumps[last[0], last[1]] - jumps[first[0], last[1]]
    return far > jumps[last[0], first[1]] - jumps[first[0], first[1]]


@compiled()
def place(face: Face, points: Reals2D) -> Reals2D:
    """Give (u, v), (k, 2) mm, of a face below points (k, 3) mm of the pad's frame."""
    placed = points[:, :2].copy()
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if face.kind == AROUND:
            radius, side = face.size[0], y + face.size[2]
            placed[i, 0] = radius * math.atan2(x, z + radius)
            over = abs(side) - face.size[1]
            if over > 0:
                angle = math.atan2(over, math.hypot(x, z + radius))
                placed[i, 1] = math.copysign(face.size[1] + radius * angle, side) - face.size[2]
        elif face.kind == OVER:
            away = math.hypot(x, y)
            placed[i] *= face.size[0] * math.atan2(away, z + face.size[0]) / max(away, _SMALL)
    return placed
