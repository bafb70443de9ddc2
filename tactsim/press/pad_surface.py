"""The surface of a geom that carries a pad: flat, or curved as a cylinder, a sphere or an ellipsoid is.

The pad's frame has its origin at the pad's middle, z along the surface's outward normal there, columns of
taxels along +x and rows along +y. (u, v) are the pad's own coordinates on the surface, mm: the length along
the surface from the middle, as on a foil that is laid around it, except on an ellipsoid, where they are x and y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from tactsim.core.errors import InputError, short
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_ROUND = 1.5  # rad from the middle to which a pad may reach around a sphere's or a cylinder's surface
_FLATTENED = 0.67  # share of an ellipsoid's half-axes to which a pad may reach, corners within 0.95
_PARALLEL = 1e-6


class Lines(NamedTuple):
    """Points of a surface and the lines along its normals there, n of them, in the pad's frame.

    points, normals: (n, 3) mm and unit vectors. along_u, along_v: (n, 3) mm a mm, the derivatives of the
    points. area: (n,) mm^2 of surface for a mm^2 of (u, v). Of a flat surface all but the points have one row.
    """

    points: FloatArray
    normals: FloatArray
    along_u: FloatArray
    along_v: FloatArray
    area: FloatArray


@dataclass(frozen=True, eq=False)
class PadSurface:
    """The face of a geom that carries a pad.

    origin: (3,) mm and axes: (3, 3), columns x, y, z, the pad's frame in the geom's. low, high: (2,) mm, where
    the face ends in (u, v). depth: mm of the geom below the face; no contact reaches deeper.
    lines: gives the points at u (n,) and v (n,) mm and the surface's normals there. place: gives (k, 2) mm, the
    (u, v) of the surface below points (k, 3) mm of the pad's frame. stepped: whether it may jump between geoms.
    """

    origin: FloatArray
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    depth: float
    lines: Callable[[FloatArray, FloatArray], Lines]
    place: Callable[[FloatArray], FloatArray]
    stepped: bool = False

    @property
    def curved(self) -> bool:
        """Whether the face is curved."""
        return self.lines is not _flat


def pad_surface(kind: int, size: FloatArray, normal: FloatArray, at: FloatArray, name: str) -> PadSurface:
    """Find the face of a primitive geom whose outward normal at its middle is `normal`, in the geom's frame.

    kind: mujoco.mjtGeom. size: (3,) m, as in mjModel.geom_size. at: (2,) mm, the pad's middle from the face's
    middle along the pad's x and y. The pad's y is the geom's z axis, or its y axis where the face looks along z;
    its x is y cross normal. Raises InputError, naming the geom, where it has no such face.
    """
    size = np.asarray(size) * _MM
    axes = pad_axes(normal)
    normal = axes[:, 2]
    along = normal[2]
    geom = mujoco.mjtGeom
    if kind == geom.mjGEOM_PLANE:
        _require(along > 1 - _PARALLEL, name, "is a plane, whose pad looks along +z: give normal=(0, 0, 1)")
        half = np.where(size[:2] > 0, size[:2], np.inf)
        return PadSurface(axes @ [*at, 0], axes, -half - at, half - at, np.inf, _flat, _across)
    if kind == geom.mjGEOM_BOX:
        half = np.abs(axes).T @ size
        _require(
            np.abs(normal).max() > 1 - _PARALLEL, name, "is a box: its pad looks along an axis of the box"
        )
        return PadSurface(
            axes @ [*at, half[2]], axes, -half[:2] - at, half[:2] - at, 2 * half[2], _flat, _across
        )
    if kind in (geom.mjGEOM_CYLINDER, geom.mjGEOM_CAPSULE) and abs(along) < _PARALLEL:
        radius, half_length = size[:2]
        angle = at[0] / radius  # around the axis, from the middle
        turned = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        axes = axes @ turned
        edge = np.array([_ROUND * radius, half_length])
        middle = np.array([0, at[1]])
        return PadSurface(
            axes @ [0, at[1], radius], axes, -edge - middle, edge - middle, radius, *_cylinder(radius)
        )
    if kind == geom.mjGEOM_CYLINDER:
        raise InputError(
            f"geom {name!r} is a cylinder: its pad lies on its side, with a normal across its axis z"
        )
    _require(not at.any(), name, "is round: turn the pad's normal instead of giving `at`")
    if kind == geom.mjGEOM_SPHERE or (kind == geom.mjGEOM_CAPSULE and abs(along) > 1 - _PARALLEL):
        radius, beyond = size[0], size[1] if kind == geom.mjGEOM_CAPSULE else 0.0
        edge = np.full(2, _ROUND / np.sqrt(2) * radius)
        return PadSurface(normal * (radius + beyond), axes, -edge, edge, radius, *_sphere(radius))
    if kind == geom.mjGEOM_ELLIPSOID:
        _require(
            np.abs(normal).max() > 1 - _PARALLEL, name, "is an ellipsoid: its pad looks along one of its axes"
        )
        half = np.abs(axes).T @ size
        edge = _FLATTENED * half[:2]
        return PadSurface(normal * half[2], axes, -edge, edge, float(half.min()), _ellipsoid(half), _across)
    if kind == geom.mjGEOM_CAPSULE:
        raise InputError(f"geom {name!r} is a capsule: its pad's normal lies across its axis z or along it")
    what = geom(kind).name.removeprefix("mjGEOM_").lower()
    raise InputError(f"geom {name!r} is a {what}: a pad lies on a primitive or a mesh")


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
        raise InputError(f"geom {short(name)} {message}")


_X, _Y, _Z = np.eye(3)[:, None]


def _flat(u: FloatArray, v: FloatArray) -> Lines:
    return Lines(np.stack([u, v, np.zeros_like(u)], 1), _Z, _X, _Y, np.ones(1))


def _across(points: FloatArray) -> FloatArray:
    return points[:, :2]


def _cylinder(
    radius: float,
) -> tuple[Callable[[FloatArray, FloatArray], Lines], Callable[[FloatArray], FloatArray]]:
    """Lay u around a cylinder along y."""

    def lines(u: FloatArray, v: FloatArray) -> Lines:
        sine, cosine, zero = np.sin(u / radius), np.cos(u / radius), np.zeros_like(u)
        return Lines(
            np.stack([radius * sine, v, radius * (cosine - 1)], 1),
            np.stack([sine, zero, cosine], 1),
            np.stack([cosine, zero, -sine], 1),
            np.broadcast_to(_Y, (len(u), 3)),
            np.ones(1),
        )

    def place(points: FloatArray) -> FloatArray:
        x, y, z = points.T
        return np.stack([radius * np.arctan2(x, z + radius), y], 1)

    return lines, place


def _sphere(
    radius: float,
) -> tuple[Callable[[FloatArray, FloatArray], Lines], Callable[[FloatArray], FloatArray]]:
    """Lay (u, v) around a sphere from its pole, true to length along each line through the pole."""

    def lines(u: FloatArray, v: FloatArray) -> Lines:
        distance = np.maximum(np.hypot(u, v), 1e-12)
        x, y, angle = u / distance, v / distance, distance / radius
        sine, cosine = np.sin(angle), np.cos(angle)
        narrowed = sine / angle  # a circle about the pole over one in the plane
        normals = np.stack([sine * x, sine * y, cosine], 1)
        outwards = np.stack([cosine * x, cosine * y, -sine], 1)
        across = np.stack([-y * narrowed, x * narrowed, np.zeros_like(u)], 1)
        return Lines(
            radius * (normals - _Z),
            normals,
            outwards * x[:, None] - across * y[:, None],
            outwards * y[:, None] + across * x[:, None],
            narrowed,
        )

    def place(points: FloatArray) -> FloatArray:
        x, y, z = points.T
        away = np.hypot(x, y)
        return points[:, :2] * (radius * np.arctan2(away, z + radius) / np.maximum(away, 1e-12))[:, None]

    return lines, place


def _ellipsoid(half: FloatArray) -> Callable[[FloatArray, FloatArray], Lines]:
    """Lay (u, v) on an ellipsoid with half-axes (3,) mm as x and y."""
    a, b, c = half

    def lines(u: FloatArray, v: FloatArray) -> Lines:
        height = np.sqrt(1 - (u / a) ** 2 - (v / b) ** 2)
        slope_u, slope_v = -c * u / (a**2 * height), -c * v / (b**2 * height)
        zero, one = np.zeros_like(u), np.ones_like(u)
        area = np.sqrt(1 + slope_u**2 + slope_v**2)
        return Lines(
            np.stack([u, v, c * (height - 1)], 1),
            np.stack([-slope_u, -slope_v, one], 1) / area[:, None],
            np.stack([one, zero, slope_u], 1),
            np.stack([zero, one, slope_v], 1),
            area,
        )

    return lines
