"""The tactile mosaic in the force domain: what is felt at every place of an object, relative to the press."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.compiling import Reals1D, Reals2D, Reals3D, Reals4D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.occupancy import point_spread

# Taxels farther away, in sigma, have less than 4e-4 of the weight and are left out.
_REACH = 2.0
# Weight of the prior, a flat 0, beside a taxel at the place itself.
_PRIOR = 0.01


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Planes fitted to the taxels around every node of a square grid, weighted by the point spread of eq. 4.

    origin: [x, y] mm of node [0, 0]. cell: mm. sigma: mm. plane: (rows, columns, 3) the value, and its
    slope along x and y per cell.
    """

    origin: FloatArray
    cell: float
    sigma: float
    plane: FloatArray

    def __call__(self, xy: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Interpolate bilinearly at points (..., 2) mm: the value, and the squared slope in mm^-2."""
        value, slope = np.zeros((2, *np.shape(xy)[:-1]))
        level, steep = self.plane[..., 0].ravel(), (self.plane[..., 1:] ** 2).sum(axis=-1)
        for share, row, column, _ in self.around(xy):
            node = row * steep.shape[1] + column
            value += share * level[node]
            slope += share * steep.take(node)
        return value, slope / self.cell**2

    def around(
        self, xy: ArrayLike
    ) -> Iterator[tuple[FloatArray, NDArray[np.intp], NDArray[np.intp], FloatArray]]:
        """Yield for the four nodes around points: bilinear share, row, column, offset [x, y] in cells.

        Beyond the grid everything is as at its rim.
        """
        last = np.array(self.plane.shape[1::-1]) - 1
        place = np.clip((np.asarray(xy, dtype=float) - self.origin) / self.cell, 0, last)
        corner = np.minimum(place.astype(np.intp), last - 1)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            offset = place - corner - (dx, dy)
            share = (1 - np.abs(offset[..., 0])) * (1 - np.abs(offset[..., 1]))
            yield share, corner[..., 1] + dy, corner[..., 0] + dx, offset


@dataclass(frozen=True, eq=False)
class LearnedMosaic:
    """A mosaic, and what its planes owe to each taxel: needed while something is learned, and three times as large.

    spread: (rows, columns, 3, 3) the inverse of the normal equations.
    """

    mosaic: Mosaic
    spread: FloatArray

    def without(self, xy: FloatArray, values: FloatArray, weight: FloatArray) -> FloatArray:
        """Interpolate at each taxel that the mosaic was learned from, as if it had been learned without that taxel.

        xy: (n, 2) mm. values, weight: (n,). Leaving one observation out of a least-squares fit moves the
        coefficients by -spread x k r / (1 - k x' spread x), where r is its residual and k its weight.
        """
        mosaic, result = self.mosaic, np.zeros(len(values))
        for share, row, column, offset in mosaic.around(xy):
            design = np.column_stack([np.ones(len(values)), offset])
            here = weight * point_spread((offset**2).sum(axis=1) * mosaic.cell**2, mosaic.sigma, 1.0)
            influence = here[:, None] * np.einsum("ni,nij->nj", design, self.spread[row, column])
            plane = mosaic.plane[row, column]
            residual = values - (design * plane).sum(axis=1)
            leverage = (influence * design).sum(axis=1)
            result += share * (plane[:, 0] - influence[:, 0] * residual / (1 - leverage))
        return result


@dataclass(frozen=True)
class Grid:
    """The nodes of a mosaic. origin: [x, y] mm of node [0, 0]. cell: mm. shape: (rows, columns). sigma: mm."""

    origin: FloatArray
    cell: float
    shape: tuple[int, ...]
    sigma: float


def learn_mosaic(xy: FloatArray, values: FloatArray, weight: FloatArray, grid: Grid) -> Mosaic:
    """Learn a mosaic as `learn_with_spread` does."""
    return learn_with_spread(xy, values, weight, grid).mosaic


def learn_with_spread(xy: FloatArray, values: FloatArray, weight: FloatArray, grid: Grid) -> LearnedMosaic:
    """Fit a plane to the taxels around every node of a grid: local linear regression (Cleveland 1979).

    xy: (n, 2) mm, where taxels lay. values, weight: (n,) what they felt, and how much that counts, 1 for
    a taxel without noise. A taxel at distance d has the weight times exp(-2 d^2 / sigma^2), as in eq. 4. Where there is
    none, the value is 0.
    """
    sums, sigma = np.zeros((*grid.shape, 9)), grid.sigma / grid.cell
    add_moments(sums, (xy - grid.origin) / grid.cell, weight, values, sigma, _REACH * sigma)
    spread, plane = np.empty((*grid.shape, 3, 3)), np.empty((*grid.shape, 3))
    solve(sums, _PRIOR * np.array([1, sigma**2, sigma**2]), spread, plane)
    return LearnedMosaic(Mosaic(grid.origin, grid.cell, grid.sigma, plane), spread)


@compiled()
def add_moments(
    moments: Reals3D, place: Reals2D, weight: Reals1D, value: Reals1D, sigma: float, reach: float
) -> None:
    """Add what taxels give to the normal equations of a plane around every node near them.

    moments: (rows, columns, 9): of the offsets (1, x, y) from the node the sums 11, 1x, 1y, xx, xy, yy, and of
    the value times (1, x, y). place: (n, 2) [x, y]. weight, value: (n,). sigma, reach: all lengths are in
    cells. A taxel at distance d has the weight times exp(-2 d^2 / sigma^2), none beyond `reach` in x or y.
    """
    rows, columns, _ = moments.shape
    along = np.empty(2 * math.ceil(reach) + 2)
    for i in range(len(weight)):
        x, y = place[i]
        left, right = max(0, math.ceil(x - reach)), min(columns - 1, math.floor(x + reach))
        for column in range(left, right + 1):
            along[column - left] = math.exp(-2 * ((x - column) / sigma) ** 2)
        for row in range(max(0, math.ceil(y - reach)), min(rows - 1, math.floor(y + reach)) + 1):
            dy = y - row
            across = weight[i] * math.exp(-2 * (dy / sigma) ** 2)
            for column in range(left, right + 1):
                dx, here = x - column, across * along[column - left]
                sums = moments[row, column]
                sums[0] += here
                sums[1] += here * dx
                sums[2] += here * dy
                sums[3] += here * dx * dx
                sums[4] += here * dx * dy
                sums[5] += here * dy * dy
                sums[6] += here * value[i]
                sums[7] += here * value[i] * dx
                sums[8] += here * value[i] * dy


@compiled()
def solve(moments: Reals3D, prior: Reals1D, spread: Reals4D, plane: Reals3D) -> None:
    """Solve the normal equations of the plane around every node, by Cramer's rule.

    moments: (rows, columns, 9) of `add_moments`. prior: (3,) is added to 11, xx and yy. Fills spread (rows, columns, 3,
    3), the inverses, and plane (rows, columns, 3).
    """
    rows, columns, _ = moments.shape
    for row in range(rows):
        for column in range(columns):
            sums, inverse = moments[row, column], spread[row, column]
            a, b, c = sums[0] + prior[0], sums[1], sums[2]
            d, e, f = sums[3] + prior[1], sums[4], sums[5] + prior[2]
            inverse[0, 0], inverse[1, 1], inverse[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
            inverse[0, 1] = inverse[1, 0] = c * e - b * f
            inverse[0, 2] = inverse[2, 0] = b * e - c * d
            inverse[1, 2] = inverse[2, 1] = b * c - a * e
            inverse /= a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]
            for i in range(3):
                of_axis = inverse[i]
                plane[row, column, i] = of_axis[0] * sums[6] + of_axis[1] * sums[7] + of_axis[2] * sums[8]
