"""How far the geoms of a body are from a surface: along each of its normals, the distance to where the body begins.

A geom is convex, as MuJoCo's collision takes it: a mesh is its convex hull. Each line along a normal enters it
at one point, ahead of the surface or, where the two overlap, behind it.

Where the geom has an edge, the gap jumps. Facets that stand steeply on the surface (walls) therefore do not make
gaps; they bound the part of the surface that the geom covers, and a cell of the lattice on such a bound is covered
in part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from tactsim.attach.pad_kernels import SMALL, STEEP, cut, enter, unite
from tactsim.attach.pad_surface import Lines
from tactsim.core.compiling import Bools1D, Ints1D, Ints2D, Reals1D, Reals2D, Reals3D, compiled
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_FACES = 1.5  # times as far as points spread, or as far as a geom sinks in, its faces are looked at
FACETED, _ROUND, _CYLINDER, _CAPSULE = range(4)


class Body(NamedTuple):
    """The p geoms of a rigid body, each in its own frame.

    kind: (p,), flat faces, an ellipsoid, a cylinder or a capsule along z. size: (p, 3) mm, half-axes, or the radius and
    half the length of the cylinder. radii: (p,) mm, of the balls about the frames that hold the geoms. faces: (p, 2),
    where each geom's faces begin and end among f. normals (f, 3) and offsets (f,) mm: the geom is {x: normals x <=
    offsets}. balls: (f, 4) mm, a middle and a radius that hold each face.
    """

    kind: Ints1D
    size: Reals2D
    radii: Reals1D
    faces: Ints2D
    normals: Reals2D
    offsets: Reals1D
    balls: Reals2D


class Pose(NamedTuple):
    """The frames of p geoms in the pad's: rotations (p, 3, 3) and positions (p, 3) mm."""

    rotations: Reals3D
    positions: Reals2D


class Cover(NamedTuple):
    """What of a surface a body covers, in k covered parts of cells, at most one for each cell and geom.

    cell, geom: (k,). gap: (k,) mm from the surface to the body along the normal, in the middle of the covered part;
    below 0 where the two overlap. share: (k,) of the cell that is covered. shift: (2, k) in cells, from the cell's
    middle to the middle of the covered part along u and v.
    """

    cell: Ints1D
    geom: Ints1D
    gap: Reals1D
    share: Reals1D
    shift: Reals2D


def body_of(model: mujoco.MjModel, geoms: Sequence[int]) -> Body:
    """Describe geoms of a model.

    Raises InputError, naming the geom, if one is a height field or a signed distance field.
    """
    kinds, faces = [], []
    for geom in geoms:
        kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom] * _MM
        kinds.append(_KINDS.get(kind, FACETED))
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            faces.append(_everywhere(np.array([[0.0, 0.0, 1.0]]), np.zeros(1)))
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            faces.append(_everywhere(np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([size, size])))
        elif kind == mujoco.mjtGeom.mjGEOM_MESH:
            faces.append(_hull(model, model.geom_dataid[geom]))
        elif kind in _KINDS:
            faces.append(np.empty((0, 8)))
        else:
            what = kind.name.removeprefix("mjGEOM_").lower()
            raise InputError(
                f"geom {model.geom(geom).name!r} (number {geom}) is a {what}, which a pad cannot feel: make it of "
                "primitives or meshes, or keep it from touching the pad's geom by contype and conaffinity"
            )
    size = model.geom_size[list(geoms)] * _MM
    balls = model.geom_type[list(geoms)] == mujoco.mjtGeom.mjGEOM_SPHERE
    size[balls] = size[balls, :1]
    radii, ends = model.geom_rbound[list(geoms)] * _MM, np.cumsum([0, *map(len, faces)])
    radii[radii == 0] = np.inf  # a plane's
    spans, every = np.column_stack([ends[:-1], ends[1:]]), np.concatenate(faces)
    parts = (np.ascontiguousarray(every[:, columns]) for columns in (np.s_[:3], 3, np.s_[4:]))
    return Body(np.array(kinds), size, radii, spans, *parts)


_KINDS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: _ROUND,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _ROUND,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _CYLINDER,
    mujoco.mjtGeom.mjGEOM_CAPSULE: _CAPSULE,
}


def _everywhere(normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """List the faces of a body that has few: normal, offset, and a ball without end, (f, 8)."""
    return np.hstack(
        [normals, offsets[:, None], np.zeros((len(normals), 3)), np.full((len(normals), 1), np.inf)]
    )


def _hull(model: mujoco.MjModel, mesh: int) -> FloatArray:
    """Find the facets of a mesh's convex hull, which MuJoCo collides with in its place: as `_everywhere`."""
    from scipy.spatial import ConvexHull

    start, graph = model.mesh_vertadr[mesh], model.mesh_graphadr[mesh]
    listed = np.arange(model.mesh_vertnum[mesh])
    if graph >= 0:  # of the hull: how many vertices and faces, as many addresses, then the vertices
        count = model.mesh_graph[graph]
        listed = model.mesh_graph[graph + 2 + count :][:count]
    vertices = model.mesh_vert[start + listed].astype(float) * _MM
    hull = ConvexHull(vertices)
    _, first, face = np.unique(hull.equations.round(9), axis=0, return_index=True, return_inverse=True)
    face, corners = face.ravel(), vertices[hull.simplices]  # a flat side is many triangles
    sums = [np.bincount(face, corners[..., k].mean(axis=1)) for k in range(3)]
    middles = np.stack(sums, axis=1) / np.bincount(face)[:, None]
    radii = np.zeros(len(first))
    np.maximum.at(radii, face, np.linalg.norm(corners - middles[face, None], axis=2).max(axis=1))
    return np.column_stack([hull.equations[first, :3], -hull.equations[first, 3], middles, radii])


Vector = tuple[float, float, float]


@compiled(called_from_python=False)
def vector(rows: Reals2D, i: int) -> Vector:
    """Take one of vectors (n, 3)."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@compiled(called_from_python=False)
def turned(rotations: Reals3D, geom: int, vector: Vector) -> Vector:
    """Turn a vector of the pad's frame into that of a geom."""
    x, y, z = vector
    turn = rotations[geom]
    return (
        x * turn[0, 0] + y * turn[1, 0] + z * turn[2, 0],
        x * turn[0, 1] + y * turn[1, 1] + z * turn[2, 1],
        x * turn[0, 2] + y * turn[1, 2] + z * turn[2, 2],
    )


@compiled(called_from_python=False)
def round_entry(point: Vector, way: Vector, bend: Vector) -> float:
    """Find where a line, from a point along a way, enters an ellipsoid: infinite where it misses it.

    bend: 1/mm, one over each half-axis.
    """
    x, y, z = point[0] * bend[0], point[1] * bend[1], point[2] * bend[2]
    to_x, to_y, to_z = way[0] * bend[0], way[1] * bend[1], way[2] * bend[2]
    a, b = to_x * to_x + to_y * to_y + to_z * to_z, x * to_x + y * to_y + z * to_z
    inside = b * b - a * (x * x + y * y + z * z - 1)
    return (-b - math.sqrt(inside)) / a if inside >= 0 else np.inf


@compiled(called_from_python=False)
def side_entry(point: Vector, way: Vector, radius: float) -> float:
    """Find where a line enters an endless cylinder along z: infinite where it misses it."""
    a = max(way[0] * way[0] + way[1] * way[1], SMALL)
    b = point[0] * way[0] + point[1] * way[1]
    inside = b * b - a * (point[0] * point[0] + point[1] * point[1] - radius * radius)
    return (-b - math.sqrt(inside)) / a if inside >= 0 else np.inf


@compiled(called_from_python=False)
def capsule_entry(point: Vector, way: Vector, radius: float, half: float) -> float:
    """Find where a line enters a capsule along z: infinite where it misses it."""
    x, y, z = point
    entry, ball = side_entry(point, way, radius), (1 / radius, 1 / radius, 1 / radius)
    if not abs(z + entry * way[2]) <= half:
        entry = np.inf
    return min(entry, round_entry((x, y, z - half), way, ball), round_entry((x, y, z + half), way, ball))


@compiled(called_from_python=False)
def seen(lines: Lines, i: int, geom: int, pose: Pose) -> tuple[Vector, Vector]:
    """Give a line's point and normal in the frame of a geom."""
    own, place = i if len(lines.normals) > 1 else 0, pose.positions[geom]
    x, y, z = lines.points[i, 0] - place[0], lines.points[i, 1] - place[1], lines.points[i, 2] - place[2]
    return turned(pose.rotations, geom, (x, y, z)), turned(pose.rotations, geom, vector(lines.normals, own))


@compiled(ordered=False)
def ball_around(points: Reals2D) -> Reals1D:
    """Give the middle of points (n, 3) mm, and how far the farthest is from it: (4,) mm."""
    x = y = z = spread = 0.0
    for i in range(len(points)):
        x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
    x, y, z = x / len(points), y / len(points), z / len(points)
    for i in range(len(points)):
        apart = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 + (points[i, 2] - z) ** 2
        spread = max(spread, apart)
    return np.array([x, y, z, math.sqrt(spread)])


@compiled(called_from_python=False)
def near(body: Body, geom: int, pose: Pose, ball: Reals1D) -> tuple[Reals2D, Reals1D]:
    """Put the faces of a geom before the pad: normals (f, 3) and offsets (f,) mm in its frame.

    ball: (4,) mm, a middle and a radius, as `measure` takes it. Faces that are further from the middle than the geom
    is, by more than the radius, are left out.
    """
    first, last, place = body.faces[geom, 0], body.faces[geom, 1], pose.positions[geom]
    x, y, z = turned(pose.rotations, geom, (ball[0] - place[0], ball[1] - place[1], ball[2] - place[2]))
    balls, away = body.balls[first:last], np.empty(last - first)
    for face in range(len(away)):
        apart = (balls[face, 0] - x) ** 2 + (balls[face, 1] - y) ** 2 + (balls[face, 2] - z) ** 2
        away[face] = math.sqrt(apart) - balls[face, 3]
    limit = max(away.min(), 0.0) + ball[3]
    count = int(np.count_nonzero(away <= limit))
    normals, offsets = np.zeros((count, 3)), np.empty(count)
    count = 0
    for face in range(first, last):
        if away[face - first] <= limit:
            offsets[count] = body.offsets[face]
            for k in range(3):
                for j in range(3):
                    normals[count, k] += body.normals[face, j] * pose.rotations[geom, k, j]
                offsets[count] += normals[count, k] * pose.positions[geom, k]
            count += 1
    return normals, offsets


@compiled()
def measure(
    body: Body,
    geom: int,
    pose: Pose,
    lines: Lines,
    ball: Reals1D,
    steep: float,
    gap: Reals1D,
    share: Reals1D,
    shift: Reals2D,
) -> None:
    """Measure from each of n points of a surface along its normal to where a geom begins.

    ball: (4,) mm, about the points, so much larger than they spread that it holds also what the geom sinks in.

    steep: what a wall is, as `STEEP`. Fills gap (n,) mm, infinite where the line misses the geom, and share (n,) and
    shift (2, n) as in `Cover`.
    """
    kind = body.kind[geom]
    if kind == FACETED:
        normals, offsets = near(body, geom, pose, ball)
        enter(normals, offsets, lines, steep, np.empty(0), gap, share, shift)
        return
    half = (body.size[geom, 0], body.size[geom, 1], body.size[geom, 2])
    bend = (1 / half[0], 1 / half[1], 1 / half[2])
    own, upright = len(lines.normals) > 1, -np.inf
    share[:] = 1.0
    shift[:] = 0.0
    for i in range(len(gap)):
        point, way = seen(lines, i, geom, pose)
        if kind == _ROUND:
            gap[i] = round_entry(point, way, bend)
        elif kind == _CAPSULE:
            gap[i] = capsule_entry(point, way, half[0], half[1])
        elif math.hypot(way[0], way[1]) < steep:  # the cylinder's side is a wall
            gap[i] = upright
        else:
            gap[i] = side_entry(point, way, half[0])
    if kind != _CYLINDER:
        return
    # Of a cylinder the flat ends are entered as faces, and its side bounds them.
    normals = np.empty((2, 3))
    normals[0], normals[1] = pose.rotations[geom, :, 2], -pose.rotations[geom, :, 2]
    offsets = half[1] + normals @ pose.positions[geom]
    before = gap.copy()
    sides = before[: len(gap) * int((before > upright).any())]
    enter(normals, offsets, lines, steep, sides, gap, share, shift)
    for i in range(len(gap)):
        if before[i] > upright:
            continue
        point, way = seen(lines, i, geom, pose)
        line = i if own else 0
        along_u = turned(pose.rotations, geom, vector(lines.span_u, line))
        along_v = turned(pose.rotations, geom, vector(lines.span_v, line))
        # The rim is a wall that turns with the point: its part along each side of a cell.
        x, y = point[0] + gap[i] * way[0], point[1] + gap[i] * way[1]
        distance = max(math.hypot(x, y), SMALL)
        leaning = min((x * way[0] + y * way[1]) / distance, 0.0) * min(gap[i], 0.0) / 2  # as in `enter`
        share[i], shift[0, i], shift[1, i] = cut(
            distance - half[0] - leaning,
            (along_u[0] * x + along_u[1] * y) / distance,
            (along_v[0] * x + along_v[1] * y) / distance,
        )


@compiled(called_from_python=False)
def among(body: Body, pose: Pose, chosen: Bools1D) -> tuple[Body, Pose]:
    """Take the chosen ones, (p,), of a body's geoms alone."""
    (geoms,) = np.nonzero(chosen)
    faces = body.normals, body.offsets, body.balls
    parts = Body(body.kind[geoms], body.size[geoms], body.radii[geoms], body.faces[geoms], *faces)
    return parts, Pose(pose.rotations[geoms], pose.positions[geoms])


@compiled(called_from_python=False)
def union_gaps(body: Body, pose: Pose, lines: Lines, depth: float, deep: float, cell: float) -> Cover:
    """Measure from a surface to a body of several geoms, which may overlap: to the nearest of them at each point.

    depth: mm below the surface, where nothing begins. deep: mm that the body sinks in, as far as is known. cell: mm, a
    cell's shorter side; what leans over more than that is no wall. Not more than the whole of a cell is covered.
    """
    geoms, cells = len(body.kind), len(lines.points)
    gap, share, shift = np.empty((geoms, cells)), np.empty((geoms, cells)), np.empty((geoms, 2, cells))
    ball, steep = ball_around(lines.points), min(STEEP, cell / max(deep, SMALL))
    ball[3] = max(_FACES * ball[3], math.hypot(ball[3], deep))
    for geom in range(geoms):
        measure(body, geom, pose, lines, ball, steep, gap[geom], share[geom], shift[geom])
        for cell in range(cells):
            if not -depth < gap[geom, cell] < np.inf:
                share[geom, cell] = 0.0
    if geoms > 1:
        unite(gap, share, shift)
    (found,) = np.nonzero(share.ravel() > 0)
    shifts = np.empty((2, len(found)))
    for axis in range(2):
        shifts[axis] = shift[:, axis].copy().ravel()[found]
    return Cover(found % cells, found // cells, gap.ravel()[found], share.ravel()[found], shifts)
