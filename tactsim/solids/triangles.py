"""Triangles in space: cut into cells, measured from points, and searched for faces that cut through each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

CELL = 1.5  # mm, the longest edge of the cells of a surface
_NEAREST = 32  # cells about a point to which its distance is measured, at most
_STRICTLY = 1e-6  # share of an edge or face by which a crossing must lie inside: faces that meet do not cross
_BATCH = 1 << 17  # pairs of faces that are looked at together


def cut_to(length: float, corners: FloatArray) -> FloatArray:
    """Halve triangles (f, 3 corners, 3) at their longest edges until none is longer than `length` mm: (c, 3, 3)."""
    done = [corners[:0]]
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small = edges.max(axis=1) <= length
        done.append(corners[small])
        corners, longest = corners[~small], edges[~small].argmax(axis=1)
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


class CutSurface:
    """A mesh cut into small cells, so that distances from it are found quickly.

    corners: (f, 3 corners, 3) mm. cells: (c, 3, 3) mm, and their middles (c, 3).
    """

    def __init__(self, corners: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self.corners = corners
        self.cells = cut_to(CELL, corners)
        self.middles = self.cells.mean(axis=1)
        self._tree = cKDTree(self.middles)

    def distances(self, points: FloatArray, enough: float) -> FloatArray:
        """Measure how far points (n, 3) lie from the surface, mm: (n,).

        What is told is never too small. It is exact for a point much nearer than CELL, unless it is `enough` or less:
        then a face may be nearer still.
        """
        found = np.full(len(points), np.inf)
        for nearest in (_NEAREST // 8, _NEAREST):
            far = np.flatnonzero(found > enough)
            count = min(nearest, len(self.cells))
            near = self._tree.query(points[far], k=range(1, count + 1))[1]
            found[far] = to_triangles(points[far, None], self.cells[near]).min(axis=1)
        return found


def to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Measure the distances (n, k) mm of points (n, 1, 3) from triangles (n, k, 3 corners, 3)."""
    from trimesh.triangles import closest_point

    nearest = closest_point(
        triangles.reshape(-1, 3, 3), np.repeat(points, triangles.shape[1], axis=1).reshape(-1, 3)
    )
    return np.asarray(np.linalg.norm(nearest.reshape(*triangles.shape[:2], 3) - points, axis=-1), dtype=float)


def crossings(corners: FloatArray) -> NDArray[np.intp]:
    """List the pairs of triangles of which one's edge passes through the inside of the other: (m, 2).

    corners: (f, 3 corners, 3) mm. Triangles that meet at a corner or an edge, or lie in one plane, do not cross there.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    # Sorted along an axis, a triangle's neighbours there are a run behind it. The axis with the shortest runs serves.
    orders = [np.argsort(low[:, axis], kind="stable") for axis in range(3)]
    runs = [
        np.searchsorted(low[order, axis], high[order, axis], side="right") - np.arange(1, len(order) + 1)
        for axis, order in enumerate(orders)
    ]
    shortest = min(range(3), key=lambda axis: int(runs[axis].sum()))
    order, run = orders[shortest], runs[shortest]
    found = [np.empty((0, 2), dtype=np.intp)]
    for rows in np.array_split(np.arange(len(order)), run.sum() // _BATCH + 1):
        first = np.repeat(rows, run[rows])
        place = np.arange(len(first)) - np.repeat(np.cumsum(run[rows]) - run[rows], run[rows])
        pairs = np.sort(np.stack([order[first], order[first + 1 + place]], axis=1), axis=1)
        a, b = pairs.T
        pairs = pairs[((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1)]
        one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
        found.append(pairs[_passes(one, other) | _passes(other, one)])
    return np.unique(np.concatenate(found), axis=0)


def _passes(edges_of: FloatArray, triangles: FloatArray) -> NDArray[np.bool_]:
    """Tell whether an edge of each of `edges_of` (n, 3, 3) passes through the inside of its triangle (n, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    first, second = b - a, c - a
    passes = np.zeros(len(triangles), dtype=bool)
    for corner in range(3):
        start = edges_of[:, corner]
        along = edges_of[:, (corner + 1) % 3] - start
        # Moller and Trumbore (1997): start + t along = a + u first + v second.
        across = np.cross(along, second)
        scale = np.sum(first * across, axis=1)
        size = np.linalg.norm(along, axis=1) * np.linalg.norm(np.cross(first, second), axis=1)
        parallel = np.abs(scale) <= 1e-9 * size
        scale = np.where(parallel, 1.0, scale)
        u = np.sum((start - a) * across, axis=1) / scale
        around = np.cross(start - a, first)
        v = np.sum(along * around, axis=1) / scale
        t = np.sum(second * around, axis=1) / scale
        within = np.min([u, v, 1 - u - v, t, 1 - t], axis=0) > _STRICTLY
        passes |= within & ~parallel
    return passes
