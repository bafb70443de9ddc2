"""Sums of weighted cones: the kernel density of eq. 10 and 11 (compiled)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import float32, float64, int32, int64, types, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import (
    FLOATS,
    FLOATS_2D,
    FLOATS_3D,
    INTS,
    REALS,
    REALS_2D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.bits import bits_of
from tactsim.estimators.field.vectors import LANES
from tactsim.estimators.filters.cone_blocks import SIDE, add_block, no_cones, plus_cone, write_entries

Wholes = NDArray[np.int32]
WHOLES = types.int32[::1]

# The grid on which the paper evaluates the density of eq. 11: mm, mm, rad.
PARZEN_STEP = np.array([0.5, 0.5, 0.04 * np.pi])
TURN = 50  # of its nodes in a circle
# Steps in which tabulated cones are known: of the squared distance in the plane, and of a node's fraction in angle.
_SQUARES, _FRACTIONS = 128, 8
_BATCH = 128  # cones whose numbers stay in the cache
_BUCKETS = 128  # of weights, two for each power of 2; the last holds all the rest


def window(rho: float) -> tuple[int, int, int]:
    """Count the nodes of a grid that a cone takes: along x and y, ahead of it in angle, and in angle altogether.

    The first is a whole number of blocks, the last of vectors.
    """
    ahead = math.ceil(rho / PARZEN_STEP[2])
    wide = math.ceil(2 * rho / PARZEN_STEP[0])
    return -(-wide // SIDE) * SIDE, ahead, -(-2 * ahead // LANES) * LANES


@lru_cache(maxsize=8)
def cone_profiles(rho: float) -> Floats:
    """Tabulate upper bounds of a cone of height 1 along the angle: (squared distances, fractions, angles), flat.

    Of each step of the squared distance in the plane, from 0 to rho^2, and of the angle up to the next node, the entry
    is the cone's largest value. After the last square all is 0.
    """
    _, ahead, lanes = window(rho)
    square = np.arange(_SQUARES) / _SQUARES * rho**2
    nearest = (np.arange(_FRACTIONS) / _FRACTIONS)[:, None] + np.arange(lanes) - ahead
    away = np.maximum(0, np.maximum(nearest, -nearest - 1 / _FRACTIONS)) * PARZEN_STEP[2]
    cone = np.maximum(0, 1 - np.sqrt(square[:, None, None] + away**2) / rho)
    # Vectors that begin with a line of the cache, 64 bytes, are loaded in half the time.
    room = np.zeros(cone.size + _FRACTIONS * lanes + LANES, dtype=np.float32)
    begin = -room.ctypes.data % 64 // 4
    profiles = room[begin : begin + cone.size + _FRACTIONS * lanes]
    profiles[: cone.size] = cone.ravel()
    return profiles


@compiled(types.Tuple((int64, float64))(INTS, REALS, REALS_2D, REALS, float64), ordered=False)
def heaviest(chosen: Ints, box: Reals, state: Reals, weight: Reals, share: float) -> tuple[int, float]:
    """Choose the heaviest states, leaving out the lightest that hold at most a share of the sum of the weights.

    chosen: (as many as states,), of which the first become indices, ascending. box: (4,) becomes the least and the
    largest x, and y, of the chosen states. state: (3, states). weight: from 0 to 1. Returns how many are chosen, and
    the sum of the other weights.
    """
    held, total, left_out, count = np.zeros(_BUCKETS), 0.0, 0.0, 0
    for i in range(len(weight)):
        bucket = min(uint64(_BUCKETS - 1), uint64(2046) - (bits_of(weight[i]) >> uint64(51)))
        held[bucket] += weight[i]
    for one in held:
        total += one
    lightest = uint64(_BUCKETS - 1)
    while share > 0 and lightest > 0 and left_out + held[lightest] <= share * total:
        left_out += held[lightest]
        lightest -= uint64(1)
    for i in range(len(weight)):
        chosen[count] = i
        bucket = min(uint64(_BUCKETS - 1), uint64(2046) - (bits_of(weight[i]) >> uint64(51)))
        count += bucket <= lightest
    left = low = np.inf
    right = high = -np.inf
    for i in chosen[:count]:
        left, right = min(left, state[0, i]), max(right, state[0, i])
        low, high = min(low, state[1, i]), max(high, state[1, i])
    box[0], box[1], box[2], box[3] = left, right, low, high
    return count, left_out


@compiled(void(WHOLES, FLOATS_2D, WHOLES, REALS_2D, REALS, INTS, INTS, float64, int64, int64), ordered=False)
def place_cones(
    cell: Wholes, cone: Floats, fraction: Wholes, state: Reals, weight: Reals, chosen: Ints, corner: Ints,
    rho: float, columns: int, angles: int,
) -> None:  # fmt: skip
    """Find the nodes that the cones of the chosen states take.

    cell: (chosen,) becomes the flat index of each cone's first node. cone: (3, chosen) becomes how far in columns and
    rows that node lies from the tip, and the height. fraction: (chosen,) becomes the angle from the tip up to the next
    node, in `_FRACTIONS` of a step. The others are as in `add_cones`.
    """
    per_x, per_y, per_angle = 1 / PARZEN_STEP[0], 1 / PARZEN_STEP[1], 1 / PARZEN_STEP[2]
    radius, left, low = rho / PARZEN_STEP[0], float64(corner[0]), float64(corner[1])
    x, y, turn = np.empty(_BATCH), np.empty(_BATCH), np.empty(_BATCH)
    # Three loops, because what lies anywhere is not loaded in vectors, and few arrays at once are.
    for begin in range(0, len(chosen), _BATCH):
        count = min(_BATCH, len(chosen) - begin)
        some = chosen[begin : begin + count]
        first, part = cell[begin : begin + count], fraction[begin : begin + count]
        across, along, height = (
            cone[0, begin : begin + count], cone[1, begin : begin + count], cone[2, begin : begin + count],
        )  # fmt: skip
        for k in range(uint64(count)):
            i = uint64(some[k])
            x[k], y[k], turn[k] = (
                state[0, i] * per_x - left,
                state[1, i] * per_y - low,
                state[2, i] * per_angle,
            )
            height[k] = float32(weight[i])
        for k in range(uint64(count)):
            ahead = turn[k] - TURN * np.floor(turn[k] / TURN)
            turn[k] = np.ceil(ahead)
            part[k] = min(int32((turn[k] - ahead) * _FRACTIONS), int32(_FRACTIONS - 1))
        for k in range(uint64(count)):
            column, row = np.ceil(x[k] - radius), np.ceil(y[k] - radius)
            across[k], along[k] = float32(column - x[k]), float32(row - y[k])
            first[k] = int32((row * columns + column) * angles + turn[k])


@compiled(int64(WHOLES, WHOLES, WHOLES, FLOATS_2D, FLOATS_2D, WHOLES, WHOLES), ordered=False)
def sort_cones(
    used: Wholes, end: Wholes, cell: Wholes, cone: Floats, by_cell: Floats, fraction: Wholes, part: Wholes
) -> int:
    """Put cones that share a cell next to each other, and count the cells that have any.

    used: (as many as cones, and 1) of which the first become those cells. end: (cells,) of zeros, becomes where the
    cones of each end. by_cell, part: become cone and fraction in their new order.
    """
    cells, total = uint64(0), int32(0)
    for first in cell:
        used[cells] = first
        cells += uint64(end[first] == 0)
        end[first] += int32(1)
    for first in used[:cells]:
        have = end[first]
        end[first] = total
        total += have
    for j in range(uint64(len(cell))):
        place = uint64(end[cell[j]])
        end[cell[j]] += int32(1)
        by_cell[0, place], by_cell[1, place], by_cell[2, place] = cone[0, j], cone[1, j], cone[2, j]
        part[place] = fraction[j]
    return int(cells)


@compiled(void(FLOATS_3D, REALS_2D, REALS, INTS, INTS, float64, FLOATS))
def add_cones(
    bound: Floats, state: Reals, weight: Reals, chosen: Ints, corner: Ints, rho: float, profiles: Floats
) -> None:
    """Add upper bounds of weighted cones (eq. 10, 11) to a grid.

    bound: (rows, columns, angles) from the node corner = [column, row] of the paper's grid; its first angle lies as
    many nodes below 0 as `window` says, and angles are not folded around the circle. All nodes that a cone reaches
    must lie on it. state: (3, states) mm, mm, rad. chosen: (n,) indices of states. profiles: of rho, from
    `cone_profiles`. The distance of eq. 10 counts mm and rad alike.
    """
    _, columns, angles = bound.shape
    nodes, count = bound.reshape(bound.size), len(chosen)
    wide = uint64(math.ceil(2 * rho / PARZEN_STEP[0] / SIDE) * SIDE)
    lanes = uint64(len(profiles) // ((_SQUARES + 1) * _FRACTIONS))
    squares, row_below = float32(_SQUARES * (PARZEN_STEP[0] / rho) ** 2), uint64(columns * angles)
    cell, fraction, part = (
        np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32),
    )  # fmt: skip
    cone, by_cell = np.empty((3, count), dtype=np.float32), np.empty((3, count), dtype=np.float32)
    used, end = np.empty(count + 1, dtype=np.int32), np.zeros(bound.size, dtype=np.int32)
    place_cones(cell, cone, fraction, state, weight, chosen, corner, rho, columns, angles)
    cells = sort_cones(used, end, cell, cone, by_cell, fraction, part)
    # The cones of a cell take the same nodes. Their sum stays in registers; memory sees it once.
    entries, start = np.empty(_BATCH * LANES, dtype=np.int32), uint64(0)
    for first in used[:cells]:
        stop = uint64(end[first])
        for k in range(uint64(0), lanes, uint64(LANES)):
            for r in range(uint64(0), wide, uint64(SIDE)):
                for c in range(uint64(0), wide, uint64(SIDE)):
                    block: Any = no_cones()  # type: ignore[call-arg]
                    for begin in range(start, stop, uint64(_BATCH)):
                        some = min(stop - begin, uint64(_BATCH))
                        for m in range(some):
                            j = begin + m
                            write_entries(
                                entries, m * uint64(LANES), by_cell[0, j] + float32(c), by_cell[1, j] + float32(r),
                                squares, float32(_SQUARES), int32(_FRACTIONS * lanes), int32(part[j] * lanes + k),
                            )  # fmt: skip
                        for m in range(some):
                            block = plus_cone(
                                block, by_cell[2, begin + m], profiles, entries, m * uint64(LANES)
                            )
                    at = uint64(first) + r * row_below + c * uint64(angles) + k
                    add_block(nodes, at, uint64(angles), row_below, block)
        start = stop


@compiled(void(FLOATS_3D, FLOATS_2D, int64), ordered=False)
def fold(bound: Floats, highest: Floats, ahead: int) -> None:
    """Add what lies beyond either end of the circle to the other end, and find the highest of each column.

    bound: (rows, columns, angles), of which the circle is [ahead : ahead + TURN]; the rest keeps what was added.
    highest: (rows, columns) is overwritten.
    """
    rows, columns, angles = bound.shape
    for row in range(rows):
        for column in range(columns):
            circle = bound[row, column]
            for k in range(uint64(ahead)):
                circle[k + uint64(TURN)] += circle[k]
            for k in range(uint64(ahead), uint64(angles - TURN)):
                circle[k] += circle[k + uint64(TURN)]
            most = circle[ahead]
            for k in range(uint64(ahead), uint64(ahead + TURN)):
                most = max(most, circle[k])
            highest[row, column] = most
