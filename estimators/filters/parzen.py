"""The mode of the particles' kernel density (paper, eq. 10 to 12)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tactsim.core import wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.cones import add_cones, sum_cones

# The grid on which the paper evaluates the density of eq. 11: mm, mm, rad.
PARZEN_STEP = np.array([0.5, 0.5, 0.04 * np.pi])
# Particles lighter than this share of the heaviest are added to the density only if they could
# decide which node is highest.
_LIGHT = 1e-4
# By how much a sum of cones in float32 may be off, relative to itself: thirty times what was seen.
_ROUNDING = 1e-4
# Nodes along a side of the tiles in which the density is worked out, 64 mm: the paper's poses fit into one.
_TILE = 128


def parzen_mode(state: FloatArray, weight: FloatArray, rho: float = 1.0) -> FloatArray:
    """Find the pose of highest density (eq. 10 to 12) on the grid of 0.5 mm and 0.04 pi rad.

    state: (3, n) mm, mm, rad. weight: (n,). Light particles are added only if all of them together could lift
    another node above the highest.
    """
    weight = weight / weight.max()  # of a size for float32
    heavy = weight > _LIGHT
    mode, lead = _density_mode(state.compress(heavy, axis=1), weight[heavy], rho)
    if lead <= weight[~heavy].sum():
        mode, _ = _density_mode(state, weight, rho)
    return mode


def _density_mode(state: FloatArray, weight: FloatArray, rho: float) -> tuple[FloatArray, float]:
    """Find the highest node of the density, and how much higher it is, at least, than every other."""
    low = np.floor(state[:2].min(axis=1) / PARZEN_STEP[:2]) * PARZEN_STEP[:2]
    high = np.ceil(state[:2].max(axis=1) / PARZEN_STEP[:2]) * PARZEN_STEP[:2]
    columns, rows = (np.rint((high - low) / PARZEN_STEP[:2]).astype(int) + 1).tolist()
    on_circle = np.stack([state[0], state[1], np.mod(state[2], 2 * np.pi)])
    best, second = (-1.0, (0, 0, 0)), 0.0
    for row, column, near in _tiles(on_circle, low, rows, columns, rho):
        states, weights = (
            (on_circle, weight) if near is None else (on_circle.take(near, axis=1), weight[near])
        )
        size = min(rows - row, _TILE), min(columns - column, _TILE)
        density = _density(states, weights, low + PARZEN_STEP[:2] * [column, row], size, rho)
        flat = density.reshape(-1)
        # The grid is summed in float32; the nodes that may be the highest are summed again.
        close = np.flatnonzero(flat >= flat.max() * (1 - _ROUNDING))
        inside = np.stack(np.unravel_index(close, density.shape), axis=-1) + [row, column, 0]
        node = np.ascontiguousarray(inside[:, [1, 0, 2]] * PARZEN_STEP + [*low, 0])
        heights = np.empty(len(close))
        sum_cones(heights, node, states, weights, rho)
        first = int(heights.argmax())
        height, flat[close[first]] = float(heights[first]), 0
        place = tuple(inside[first].tolist())
        second = max(second, float(flat.max()) * (1 + _ROUNDING), min(height, best[0]))
        if height > best[0] or (height == best[0] and place < best[1]):
            best = (height, place)
    height, (row, column, angle) = best
    dx, dy, turn = PARZEN_STEP
    return np.array([low[0] + column * dx, low[1] + row * dy, wrap_angle(angle * turn)]), height - second


def _tiles(
    state: FloatArray, low: FloatArray, rows: int, columns: int, rho: float
) -> Iterator[tuple[int, int, NDArray[np.intp] | None]]:
    """Cut a plane of rows x columns nodes into tiles, and leave out those that no cone reaches.

    state: (3, n). low: [x, y] mm of the first node. Gives each tile's first row and column and the indices,
    ascending, of the states whose cones may reach it; None for all of them, where one tile does.
    """
    if max(rows, columns) <= _TILE:
        yield 0, 0, None
        return
    nodes = (state[:2] - low[:, None]) / PARZEN_STEP[:2, None]
    reach = rho / PARZEN_STEP[0] + 1  # at most 7 nodes, so that a cone reaches two tiles each way
    edges = [np.clip((nodes + side) // _TILE, 0, None).astype(np.int64) for side in (-reach, reach)]
    across = columns // _TILE + 2
    tile = np.concatenate([edges[i][1] * across + edges[j][0] for i in (0, 1) for j in (0, 1)])
    owner = np.tile(np.arange(state.shape[1]), 4)
    order = np.lexsort((owner, tile))
    tile, owner = tile[order], owner[order]
    again = np.zeros(len(tile), dtype=bool)
    again[1:] = (tile[1:] == tile[:-1]) & (owner[1:] == owner[:-1])
    tile, owner = tile[~again], owner[~again]
    for near in np.split(np.arange(len(tile)), np.flatnonzero(np.diff(tile)) + 1):
        row, column = divmod(int(tile[near[0]]), across)
        if row * _TILE < rows and column * _TILE < columns:
            yield row * _TILE, column * _TILE, owner[near]


def _density(
    on_circle: FloatArray, weight: FloatArray, low: FloatArray, size: tuple[int, int], rho: float
) -> FloatArray:
    """Sum the cones of states (3, n) at the nodes of a tile: (rows, columns, angles)."""
    around, angles = int(rho / PARZEN_STEP[2]) + 1, round(2 * math.pi / PARZEN_STEP[2])
    density = np.zeros((*size, angles + 2 * around + 1), dtype=np.float32)
    add_cones(density, around, on_circle, weight, low, PARZEN_STEP, rho)
    # What went round the circle at either end belongs to the other.
    density[:, :, angles : angles + around] += density[:, :, :around]
    density[:, :, around : 2 * around + 1] += density[:, :, around + angles :]
    return np.ascontiguousarray(density[:, :, around : around + angles])
