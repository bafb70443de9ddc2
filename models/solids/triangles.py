"""Triangles in space: cut into cells, measured from points, and searched for faces that cut through each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

_CELL = 1.5  # mm, the longest edge of the cells by which neighbours are found
_STRICTLY = 1e-6  # share of an edge or face by which a crossing must lie inside: faces that meet do not cross
_BATCH = 1 << 17  # pairs of faces that are looked at together


def cut_to(length: float, corners: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Halve triangles at their longest edges until none is longer than `length` mm.

    corners: (f, 3 corners, 3) mm. Returns the cells (c, 3, 3) and of which triangle each is a part, (c,).
    """
    done, numbers = [], []
    number = np.arange(len(corners))
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small = edges.max(axis=1) <= length
        done.append(corners[small])
        numbers.append(number[small])
        corners, number, longest = corners[~small], number[~small], edges[~small].argmax(axis=1)
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        number = np.tile(number, 2)
    return np.concatenate(done), np.concatenate(numbers)


def to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Measure the distances (n, k) mm of points (n, 1, 3) from triangles (n, k, 3 corners, 3)."""
    a, b, c = np.moveaxis(triangles, 2, 0)
    normal = np.cross(b - a, c - a)
    double = np.linalg.norm(normal, axis=-1)
    inside: NDArray[np.bool_] = double > 0
    best = np.full(double.shape, np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, offset = end - start, points - start
        square = np.maximum(np.sum(edge**2, axis=-1), 1e-300)
        along = np.clip(np.sum(offset * edge, axis=-1) / square, 0, 1)
        best = np.minimum(best, np.linalg.norm(offset - along[..., None] * edge, axis=-1))
        inside &= np.sum(np.cross(edge, offset) * normal, axis=-1) >= 0
    height = np.abs(np.sum((points - a) * normal, axis=-1)) / np.maximum(double, 1e-300)
    return np.where(inside, height, best)


def crossings(corners: FloatArray) -> NDArray[np.intp]:
    """List the pairs of triangles of which one's edge passes through the inside of the other: (m, 2).

    corners: (f, 3 corners, 3) mm. Triangles that meet at a corner or an edge, or lie in one plane, do not cross there.
    """
    from scipy.spatial import cKDTree

    cells, face = cut_to(_CELL, corners)
    # No point of a cell is further from its middle than two thirds of its longest edge.
    near = cKDTree(cells.mean(axis=1)).query_pairs(4 / 3 * _CELL, output_type="ndarray")
    pairs = np.sort(face[near], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    low, high = corners.min(axis=1), corners.max(axis=1)
    first, second = pairs.T
    pairs = pairs[((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)]
    found = [
        part[
            _passes(corners[part[:, 0]], corners[part[:, 1]])
            | _passes(corners[part[:, 1]], corners[part[:, 0]])
        ]
        for part in np.array_split(pairs, len(pairs) // _BATCH + 1)
    ]
    return np.concatenate(found)


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
