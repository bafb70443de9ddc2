"""Points and normals of a surface in space: where to lay a touch, and what to draw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray


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
