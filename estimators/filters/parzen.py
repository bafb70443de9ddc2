"""The mode of the particles' kernel density (paper, eq. 10 to 12)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.cone_search import search_grid
from tactsim.estimators.filters.cones import (
    PARZEN_STEP,
    TURN,
    cone_profiles,
    heaviest,
    window,
)

# Of the sum of the weights: the lightest particles that hold it are added only at nodes that may be the highest.
_LIGHT = 0.01
# Nodes along a side of the tiles in which the density is worked out, 64 mm: the paper's poses fit into one.
_TILE = 128


def parzen_mode(
    state: FloatArray, weight: FloatArray, rho: float = 1.0, skip: bool = True
) -> tuple[FloatArray, int]:
    """Find the pose of highest density (eq. 10 to 12) on the grid of 0.5 mm and 0.04 pi rad.

    state: (3, n) mm, mm, rad. weight: (n,). A grid gets upper bounds of the particles' cones; the exact density is
    summed at the nodes that may be the highest. skip: the lightest particles are left out of the grid, and what they
    hold together is added to every bound. Of equally high nodes the first counts, by y, x, angle. Also returns how
    many particles' cones were left out.
    """
    if not 0.5 <= weight.max() <= 1:
        weight = weight / weight.max()  # of a size for float32
    for share in (_LIGHT, 0.0) if skip else (0.0,):
        mode, left_out = _highest_node(state, weight, rho, share)
        if mode is not None:
            return mode, left_out
    # No cone reaches a node.
    column, row, angle = np.rint(state[:, weight.argmax()] / PARZEN_STEP).astype(np.int64).tolist()
    return _pose(column, row, angle % TURN), 0


def _highest_node(
    state: FloatArray, weight: FloatArray, rho: float, share: float
) -> tuple[FloatArray | None, int]:
    """Find the highest node of the density, with the lightest states, up to a share, left out of the grid.

    Also returns how many are left out. Gives None if those left out may reach a node that no other one does, or must
    be looked at in too many nodes.
    """
    chosen, box = np.empty(len(weight), dtype=np.int64), np.empty(4)
    count, light = heaviest(chosen, box, state, weight, share)
    best, place, profiles = light, np.zeros(3, dtype=np.int64), cone_profiles(rho)
    tiles = list(_tiles(state, chosen[:count], box, rho))
    for corner, size, mine in tiles:
        best = search_grid(
            place, state, weight, mine, corner, size, rho, profiles, light, best, len(tiles) == 1
        )
        if best < 0:
            return None, 0
    if best <= light:
        return None, 0
    row, column, angle = place.tolist()
    return _pose(column, row, angle), len(weight) - count


def _pose(column: int, row: int, angle: int) -> FloatArray:
    """Give the pose of a node."""
    dx, dy, turn = PARZEN_STEP.tolist()
    return np.array([column * dx, row * dy, (angle if 2 * angle < TURN else angle - TURN) * turn])


def _tiles(
    state: FloatArray, chosen: NDArray[np.int64], box: FloatArray, rho: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]]:
    """Cut the plane into tiles, and leave out those that no cone reaches.

    box: the least and the largest x, and y, of the chosen states. Gives each tile's first [column, row], how many
    [columns, rows] it has, with a rim for cones that reach beyond it, and the states whose cones may reach it.
    """
    rim = window(rho)[0] + 2
    dx, dy, _ = PARZEN_STEP.tolist()
    # The first node of each cone along x and y, or one before it; it ends before `rim` nodes further.
    left, right, low, high = (
        math.floor((edge - rho) / step) for edge, step in zip(box.tolist(), (dx, dx, dy, dy), strict=True)
    )
    if max(right - left, high - low) + rim <= _TILE:
        yield np.array([left, low]), np.array([right - left + rim, high - low + rim]), chosen
        return
    first = [
        np.floor((state[k, chosen] - rho) / PARZEN_STEP[k]).astype(np.int64) - (left, low)[k] for k in (0, 1)
    ]
    x, y = ([one // _TILE, (one + rim) // _TILE] for one in first)
    across, states = (right - left + rim) // _TILE + 1, state.shape[1]
    tile = np.concatenate([j * across + i for i in x for j in y])
    tile, owner = np.divmod(np.unique(tile * states + np.tile(chosen, 4)), states)
    for near in np.split(np.arange(len(tile)), np.flatnonzero(np.diff(tile)) + 1):
        row, column = divmod(int(tile[near[0]]), across)
        corner = np.array([left + column * _TILE - rim, low + row * _TILE - rim])
        yield corner, np.full(2, _TILE + 2 * rim), owner[near]
