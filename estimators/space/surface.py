"""Points and normals of a surface that voxels hold: where to lay a touch, and what to draw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.estimators.space.voxels import BLOCK, Voxels


class Surface(NamedTuple):
    """Points (p, 3) mm, about evenly over a surface, unit normals (p, 3) that point out, and their spacing mm."""

    points: FloatArray
    normals: FloatArray
    spacing: float


def surface_of(voxels: Voxels, spacing: float) -> Surface:
    """Take from every cube of `spacing` mm that a surface crosses the point of the surface nearest to its middle."""
    side = BLOCK + 1
    values = voxels.nodes.reshape(-1, side, side, side)
    slopes = np.stack(np.gradient(values, voxels.cell, axis=(1, 2, 3)), axis=-1)
    block = np.argwhere(voxels.block >= 0)
    which, *inside = np.nonzero(np.abs(values[:, :BLOCK, :BLOCK, :BLOCK]) < 0.75 * voxels.cell)
    places = voxels.corner + voxels.cell * (BLOCK * block[which] + np.column_stack(inside))
    slope = slopes[which, *inside]
    steep = np.linalg.norm(slope, axis=1, keepdims=True)
    normals = slope / np.maximum(steep, 1e-9)
    points = places - values[which, *inside][:, None] * normals
    kept = steep[:, 0] > 0.3
    points, normals = points[kept], normals[kept]
    cubes = np.floor(points / spacing)
    order = np.argsort(((points / spacing - cubes - 0.5) ** 2).sum(axis=1))
    _, first = np.unique(cubes[order], axis=0, return_index=True)
    chosen = order[np.sort(first)]
    return Surface(np.ascontiguousarray(points[chosen]), np.ascontiguousarray(normals[chosen]), spacing)
