"""Rays through a pad: the lattice on which surfaces are looked at, and how taxels read what lies on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray

_PARTS = 8  # of a ray's cell along each axis, over which what a taxel feels is averaged


@dataclass(frozen=True, eq=False)
class Rays:
    """A lattice of rays along the pad's z axis, over the taxels and the rim beside them that carries load too.

    x: (columns,) and y: (rows,) mm. base: (rows, columns) mm, z of the pad's unloaded surface. to_rays: (rays, taxels)
    interpolates what taxels read at the rays. to_taxels: (taxels, rays) sums the pressure at rays to what taxels
    read: the point spread over the taxel's own area. What spreads past the pad's edge is lost: rows sum to at most 1.
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


def rays_over(points: FloatArray, per_taxel: int, spread: float, bounds: FloatArray | None = None) -> Rays:
    """Lay rays over taxels at (taxels, 3) mm, `per_taxel` along a side of each.

    spread: mm, the standard deviation of the pad's point spread. bounds: (4,) mm, x low, x high, y low, y high of the
    surface that carries load; without it that is the taxels' own.
    """
    xy = points[:, :2]
    apart = pitch(xy) or 2.0  # mm, of a single taxel
    low, high = xy.min(axis=0) - apart / 2, xy.max(axis=0) + apart / 2
    if bounds is not None:
        low, high = np.minimum(low, bounds[::2]), np.maximum(high, bounds[1::2])
    step = apart / per_taxel
    counts = np.maximum(np.rint((high - low) / step).astype(int), 2)
    middle = (low + high) / 2
    x, y = (middle[axis] + step * (np.arange(counts[axis]) - (counts[axis] - 1) / 2) for axis in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    squared = ((places[:, None] - xy[None]) ** 2).sum(axis=-1)
    near = (squared - squared.min(axis=1, keepdims=True)) / (2 * (0.5 * apart) ** 2)
    to_rays = _local_linear(places, xy, np.exp(-near))
    along_x, along_y = _felt(x, step, xy[:, 0], apart, spread), _felt(y, step, xy[:, 1], apart, spread)
    to_taxels = (along_y[:, :, None] * along_x[:, None, :]).reshape(len(xy), -1)
    to_taxels[to_taxels < 0.003] = 0.0
    base = (to_rays @ points[:, 2]).reshape(len(y), len(x))
    return Rays(x, y, base, to_rays, to_taxels)


def _felt(rays: FloatArray, step: float, taxels: FloatArray, pitch: float, spread: float) -> FloatArray:
    """Give the part along one axis of the mean pressure on taxels by an even pressure on rays' cells: (taxels, rays).

    rays: (rays,) mm, the middles of cells `step` mm wide. taxels: (taxels,) mm, the middles of taxels `pitch` mm wide.
    """
    parts = rays[:, None] + step * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
    edges = taxels[:, None] + pitch / 2 * np.array([-1.0, 1.0])
    away = (edges[:, None, None, :] - parts[None, :, :, None]) / (max(spread, 1e-3) * np.sqrt(2))
    return np.asarray(np.diff(erf(away), axis=-1)[..., 0].mean(axis=-1) / 2 * (step / pitch))


def _local_linear(places: FloatArray, xy: FloatArray, weight: FloatArray) -> FloatArray:
    """Give the matrix of local linear regression (Cleveland 1979) from taxels at xy to places."""
    result = np.empty((len(places), len(xy)))
    for row, (place, near) in enumerate(zip(places, weight, strict=True)):
        design = np.column_stack([np.ones(len(xy)), xy - place])
        normal = (design * near[:, None]).T @ design + 1e-6 * np.diag([0.0, 1.0, 1.0]) * near.max()
        result[row] = np.linalg.solve(normal, (design * near[:, None]).T)[0]
    return result
