"""Cut a solid into few convex pieces, which MuJoCo needs to collide it.

A piece that is not convex is cut in two by a plane: one of its own faces beside a reflex edge, which keeps flat faces
flat, or one across its middle, which suits rings and cups. Of these the cut is made after which the pieces fill their
convex hulls best.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.solids.triangles import CELL, CutSurface, cut_to

if TYPE_CHECKING:
    from manifold3d import Manifold

CONCAVITY = 0.1  # mm: a piece whose hull lies nowhere further off counts as convex
MOST_PARTS = 400
_PLANES = 8  # faces beside reflex edges that are tried
_REFLEX = 1e-6  # mm by which an edge's neighbour must rise above a face
_SLIVER = 1e-6  # share of the solid's volume: what is smaller is left out


def convex_solids(solid: Manifold) -> tuple[FloatArray, ...]:
    """Cut a solid into convex pieces: the corners (k, 3) mm of each, whose hull is the piece.

    No point of the pieces lies further than CONCAVITY mm outside the solid. Slivers are left out.
    Raises InputError if that takes more than MOST_PARTS pieces.
    """
    waiting = solid.decompose()
    done: list[FloatArray] = []
    least = _SLIVER * solid.volume()
    while waiting:
        piece = waiting.pop()
        hull = piece.hull()
        if _is_convex(piece, hull):
            done.append(np.array(hull.to_mesh64().vert_properties[:, :3], dtype=float))
        else:
            waiting += [part for part in _best_cut(piece) if part.volume() > least]
        if len(done) + len(waiting) > MOST_PARTS:
            raise InputError(f"it takes more than {MOST_PARTS} convex pieces to fill it")
    for part in done:
        part.setflags(write=False)
    return tuple(done)


def _is_convex(piece: Manifold, hull: Manifold) -> bool:
    """Tell whether no point of the hull of a piece lies further than CONCAVITY mm from the piece."""
    if hull.volume() - piece.volume() <= 1e-6 * hull.volume():
        return True
    corners = _corners(hull)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals, corners = normals[length > 0] / length[length > 0, None], corners[length > 0]
    points = np.asarray(piece.to_mesh64().vert_properties[:, :3], dtype=float)
    depth = np.min(np.sum(normals * corners[:, 0], axis=1) - points @ normals.T, axis=1)
    if depth.max() > CONCAVITY:
        return False
    # A dent may lie deep under one face of the hull and yet near another: what fills it tells.
    fillings = _corners(hull - piece)
    return bool((CutSurface(_corners(piece)).distances(_points_of(fillings), CONCAVITY) <= CONCAVITY).all())


def _points_of(corners: FloatArray) -> FloatArray:
    """Give the corners and the middles of the cells of triangles (f, 3, 3): (n, 3)."""
    return np.concatenate([corners.reshape(-1, 3), cut_to(CELL, corners).mean(axis=1)])


def _best_cut(piece: Manifold) -> list[Manifold]:
    """Cut a piece by the plane after which the parts fill their hulls best."""
    best: list[Manifold] = []
    least = np.inf
    for normal, offset in _planes(piece):
        parts = [part for half in piece.split_by_plane(normal, offset) for part in half.decompose()]
        gap = sum(part.hull().volume() - part.volume() for part in parts)
        if len(parts) > 1 and gap < least:
            best, least = parts, gap
    if not best:
        raise InputError("it cannot be cut into convex pieces")
    return best


def _planes(piece: Manifold) -> list[tuple[FloatArray, float]]:
    """List the planes (unit normal, offset mm) along which a piece may be cut."""
    corners = _corners(piece)
    points = corners.reshape(-1, 3)
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    ends = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    found = list(zip(axes, (ends[0] + ends[1]) / 2, strict=True))
    return found + _reflex_planes(piece, corners)


def _reflex_planes(piece: Manifold, corners: FloatArray) -> list[tuple[FloatArray, float]]:
    """List the planes of the faces beside reflex edges, those with the most of such edges first."""
    faces = np.asarray(piece.to_mesh64().tri_verts, dtype=np.int64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    offsets = np.sum(normals * corners[:, 0], axis=1)
    # Each edge of a face meets the same edge, the other way round, of its neighbour.
    count = int(faces.max()) + 1
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    forward, backward = np.argsort(start * count + end), np.argsort(end * count + start)
    neighbour = np.empty(len(start), dtype=np.int64)
    neighbour[forward] = backward
    opposite = np.roll(corners, 1, axis=1).reshape(-1, 3)[neighbour]
    face = np.arange(len(start)) // 3
    rise = np.sum(normals[face] * opposite, axis=1) - offsets[face]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).ravel()
    weight = np.where(rise > _REFLEX, edges * np.minimum(rise, 1.0), 0.0)
    planes = np.column_stack([normals, offsets])
    _, first, group = np.unique(planes.round(4), axis=0, return_index=True, return_inverse=True)
    total = np.bincount(group.ravel(), np.bincount(face, weight, minlength=len(faces)))
    order = [one for one in np.argsort(-total)[:_PLANES] if total[one] > 0]
    return [(planes[first[one], :3], float(planes[first[one], 3])) for one in order]


def _corners(piece: Manifold) -> FloatArray:
    mesh = piece.to_mesh64()
    return np.asarray(mesh.vert_properties[:, :3], dtype=float)[np.asarray(mesh.tri_verts, dtype=np.int64)]
