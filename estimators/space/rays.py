"""Rays through a pad: the lattice on which surfaces are looked at, and how taxels read what lies on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray


@dataclass(frozen=True, eq=False)
class Rays:
    """A lattice of rays along the pad's z axis over the taxels.

    x: (columns,) and y: (rows,) mm. base: (rows, columns) mm, z of the pad's unloaded surface. to_rays: (rays, taxels)
    interpolates what taxels read at the rays. to_taxels: (taxels, rays) averages the pressure at rays to what taxels
    read: the point spread and the taxel's own area, rows of sum 1.
    """

    x: FloatArray
    y: FloatArray
    base: FloatArray
    to_rays: FloatArray
    to_taxels: FloatArray

    @property
    def frame(self) -> FloatArray:
        """Give [x of the first ray, y of the first ray, spacing] mm."""
        return np.array([self.x[0], self.y[0], self.x[1] - self.x[0]])

    @property
    def xy(self) -> FloatArray:
        """Give the rays' places, (rays, 2) mm, x fastest."""
        x, y = np.meshgrid(self.x, self.y)
        return np.column_stack([x.ravel(), y.ravel()])


def rays_over(points: FloatArray, per_taxel: int, spread: float) -> Rays:
    """Lay rays over taxels at (taxels, 3) mm, `per_taxel` along a side of each.

    spread: mm, the standard deviation of the pad's point spread; the taxel's area is added to it.
    """
    xy = points[:, :2]
    pitch = _pitch(xy)
    low, high = xy.min(axis=0) - pitch / 2, xy.max(axis=0) + pitch / 2
    step = pitch / per_taxel
    counts = np.maximum(np.rint((high - low) / step).astype(int), 2)
    middle = (low + high) / 2
    x, y = (middle[axis] + step * (np.arange(counts[axis]) - (counts[axis] - 1) / 2) for axis in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    squared = ((places[:, None] - xy[None]) ** 2).sum(axis=-1)
    to_rays = _local_linear(places, xy, np.exp(-squared / (2 * (0.5 * pitch) ** 2)))
    variance = spread**2 + pitch**2 / 12
    to_taxels = np.exp(-squared.T / (2 * variance))
    to_taxels[to_taxels < 0.01] = 0.0
    to_taxels /= to_taxels.sum(axis=1, keepdims=True)
    base = (to_rays @ points[:, 2]).reshape(len(y), len(x))
    return Rays(x, y, base, to_rays, to_taxels)


def _pitch(xy: FloatArray) -> float:
    """Give the usual distance mm from a taxel to its nearest neighbour."""
    if len(xy) == 1:
        return 2.0
    apart = np.linalg.norm(xy[:, None] - xy[None], axis=-1) + np.where(np.eye(len(xy)), np.inf, 0.0)
    return float(np.median(apart.min(axis=1)))


def _local_linear(places: FloatArray, xy: FloatArray, weight: FloatArray) -> FloatArray:
    """Give the matrix of local linear regression (Cleveland 1979) from taxels at xy to places."""
    result = np.empty((len(places), len(xy)))
    for row, (place, near) in enumerate(zip(places, weight, strict=True)):
        design = np.column_stack([np.ones(len(xy)), xy - place])
        normal = (design * near[:, None]).T @ design + 1e-6 * np.diag([0.0, 1.0, 1.0]) * near.max()
        result[row] = np.linalg.solve(normal, (design * near[:, None]).T)[0]
    return result
