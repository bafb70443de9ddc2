"""The highest node of a sum of weighted cones, from upper bounds of all nodes and sums at few (compiled)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import boolean, float32, float64, int64, types, uint64, void

from tactsim.core.compiling import (
    FLOATS,
    FLOATS_2D,
    FLOATS_3D,
    INTS,
    INTS_2D,
    REALS,
    REALS_2D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.vectors import LANES
from tactsim.estimators.filters.cones import PARZEN_STEP, TURN, add_cones, fold

# By how much a sum of cones in float32 may be off, relative to itself: thirty times what was seen.
_ROUNDING = 1e-4
# How far below the highest bound, relative to it, the nodes lie that are looked at first.
_SLACK = 0.02
_NOTHING = float(np.finfo(np.float32).tiny)  # below the bound of any node that a cone reaches
# More nodes than these, and it is worth asking where the light states are.
_FEW = 64
# Nodes at once at which light states are added: more, and the grid with all states is the quicker way.
_MANY = 256
_NEAR = 1024  # states at once whose cones are summed in float32


@compiled(types.UniTuple(float64, 3)(REALS_2D, float64), ordered=False, called_from_python=False)
def around(node: Reals, rho: float) -> tuple[float, float, float]:
    """Give a circle, x and y of its middle and its radius, from outside which no cone reaches a node.

    node: as in `sum_cones`.
    """
    middle_x, middle_y = (node[0].min() + node[0].max()) / 2, (node[1].min() + node[1].max()) / 2
    away = 0.0
    for m in range(node.shape[1]):
        away = max(away, (node[0, m] - middle_x) ** 2 + (node[1, m] - middle_y) ** 2)
    return middle_x, middle_y, (math.sqrt(away) + rho) * (1 + 1e-9)  # larger by what rounding may do


@compiled(float64(REALS, REALS_2D, REALS_2D, REALS, float64), ordered=False, summed_in_order=False)
def nearly_sum_cones(density: Reals, node: Reals, state: Reals, weight: Reals, rho: float) -> float:
    """Sum cones as `sum_cones` does, but in float32, many states at once; return by how much each may be off."""
    middle_x, middle_y, away = around(node, rho)
    square, per_rho, circle = away * away, float32(1 / rho), 2 * math.pi
    zero, one, round_about = float32(0), float32(1), float32(circle)
    x, y, angle = np.empty(_NEAR, np.float32), np.empty(_NEAR, np.float32), np.empty(_NEAR, np.float32)
    height, turned, total = np.empty(_NEAR, np.float32), np.empty(_NEAR), 0.0
    density[:] = 0
    for begin in range(uint64(0), uint64(len(weight)), uint64(_NEAR)):
        count = uint64(0)
        for i in range(begin, min(begin + uint64(_NEAR), uint64(len(weight)))):
            dx, dy = state[0, i] - middle_x, state[1, i] - middle_y
            x[count], y[count], turned[count], height[count] = dx, dy, state[2, i], weight[i]
            count += uint64(dx * dx + dy * dy < square)
        whole = (count + uint64(31)) & ~uint64(31)  # so that vectors have no rest
        for k in range(count, whole):
            x[k], y[k], turned[k], height[k] = 0, 0, 0, 0
        held: Any = zero
        for k in range(whole):
            angle[k] = turned[k] - circle * math.floor(turned[k] / circle)
            held += height[k]
        total += held
        for m in range(len(density)):
            node_x, node_y = float32(node[0, m] - middle_x), float32(node[1, m] - middle_y)
            node_angle = float32(node[2, m])
            some: Any = zero
            for k in range(whole):
                turn = abs(angle[k] - node_angle)
                turn = min(turn, round_about - turn)
                away_x, away_y = x[k] - node_x, y[k] - node_y
                off = math.sqrt(away_x * away_x + away_y * away_y + turn * turn)
                some += height[k] * max(zero, one - off * per_rho)
            density[m] += some
    # In units of the last place, 2^-24: places and angles are off by a few, of their size; sums by one a term.
    return total * 2.0**-24 * (2 * _NEAR + (8 * away + 40) / rho)


@compiled(void(REALS, REALS_2D, REALS_2D, REALS, float64), ordered=False)
def sum_cones(density: Reals, node: Reals, state: Reals, weight: Reals, rho: float) -> None:
    """Sum the weighted cones (eq. 10, 11) of states at single nodes, around the circle.

    density: (nodes,) is overwritten. node: (3, nodes), with angles in [0, 2 pi), state: (3, states) mm, mm, rad.
    """
    middle_x, middle_y, away = around(node, rho)
    away *= away
    near, count = np.empty(len(weight), dtype=np.int32), uint64(0)
    for i in range(uint64(len(weight))):
        near[count] = i
        x, y = state[0, i] - middle_x, state[1, i] - middle_y
        count += uint64(x * x + y * y < away)
    density[:] = 0
    circle, per_rho = 2 * math.pi, 1 / rho
    for one_near in near[:count]:
        i = uint64(one_near)
        x, y, one = state[0, i], state[1, i], weight[i]
        angle = state[2, i] - circle * math.floor(state[2, i] / circle)
        for m in range(uint64(len(density))):
            turn = abs(angle - node[2, m])
            turn = min(turn, circle - turn)
            square = (x - node[0, m]) ** 2 + (y - node[1, m]) ** 2 + turn * turn
            density[m] += one * max(0.0, 1.0 - math.sqrt(square) * per_rho)


@compiled(int64(INTS_2D, FLOATS_3D, FLOATS_2D, REALS_2D, float64, int64), called_from_python=False)
def nodes_above(found: Ints, bound: Floats, highest: Floats, lift: Reals, least: float, ahead: int) -> int:
    """Count the nodes that some cone reaches and whose bound is `least` or higher when it is lifted.

    found: (3, n) becomes [row, column, angle] of the first n of them, in this order. bound, highest: as from `fold`.
    lift: (rows, columns) is added to the bounds.
    """
    rows, columns = highest.shape
    count, room = 0, found.shape[1]
    for row in range(rows):
        for column in range(columns):
            enough = max(least - lift[row, column], _NOTHING)
            if highest[row, column] >= enough:
                for k in range(TURN):
                    if bound[row, column, ahead + k] >= enough:
                        if count < room:
                            found[0, count], found[1, count], found[2, count] = row, column, k
                        count += 1
    return count


@compiled(void(REALS_2D, REALS_2D, REALS, INTS, INTS, float64, float64), ordered=False)
def lift_nearby(
    lift: Reals, state: Reals, weight: Reals, chosen: Ints, corner: Ints, rho: float, light: float
) -> None:
    """Bound what the states that are not chosen add to the nodes of a grid, at most `light`.

    lift: (rows, columns) is overwritten. The others are as in `add_cones`. All states in the squares around a node's
    own count, with sides that are rho or longer.
    """
    rows, columns = lift.shape
    side = max(rho, PARZEN_STEP[0])
    left, low, per_side = (
        corner[0] * PARZEN_STEP[0] - 2 * side, corner[1] * PARZEN_STEP[1] - 2 * side, 1 / side,
    )  # fmt: skip
    across, along = int(columns * PARZEN_STEP[0] / side) + 4, int(rows * PARZEN_STEP[1] / side) + 4
    held, last, following = np.zeros((along, across)), uint64(len(chosen) - 1), uint64(0)
    right, high = float64(across - 1), float64(along - 1)
    for i in range(uint64(len(weight))):
        is_chosen = uint64(chosen[following]) == i
        following = min(following + uint64(is_chosen), last)
        # What lies beyond the grid is in the squares at its rim.
        x = min(max((state[0, i] - left) * per_side, 0.0), right)
        y = min(max((state[1, i] - low) * per_side, 0.0), high)
        held[uint64(y), uint64(x)] += 0.0 if is_chosen else weight[i]
    beside = np.empty((along, across))
    for m in range(1, along - 1):
        for n in range(1, across - 1):
            beside[m, n] = min(held[m - 1 : m + 2, n - 1 : n + 2].sum(), light)
    for row in range(rows):
        m = uint64(((corner[1] + row) * PARZEN_STEP[1] - low) * per_side)
        for column in range(columns):
            n = uint64(((corner[0] + column) * PARZEN_STEP[0] - left) * per_side)
            lift[row, column] = beside[m, n]


@compiled(float64(INTS, REALS_2D, REALS, INTS, INTS, INTS, float64, FLOATS, float64, float64, boolean))
def search_grid(
    place: Ints, state: Reals, weight: Reals, chosen: Ints, corner: Ints, size: Ints, rho: float, profiles: Floats,
    light: float, best: float, alone: bool,
) -> float:  # fmt: skip
    """Find the highest node of a grid, if it is higher than `best`, or as high and before `place`.

    place: [row, column, angle] of the highest node so far, is overwritten. corner, size: as in `add_cones`, of the
    [columns, rows]. light: the sum of the weights of states that are not chosen. alone: whether there is no other
    grid. Returns the height of `place`, which is summed over all states, or a bit less if there is no other grid; -1
    if light states would have to be added at too many nodes.
    """
    ahead, lanes = math.ceil(rho / PARZEN_STEP[2]), -(-2 * math.ceil(rho / PARZEN_STEP[2]) // LANES) * LANES
    bound = np.zeros((size[1], size[0], TURN + 1 + lanes), dtype=np.float32)
    highest, found_none = np.empty((size[1], size[0]), dtype=np.float32), np.empty((3, 0), dtype=np.int64)
    add_cones(bound, state, weight, chosen, corner, rho, profiles)
    fold(bound, highest, ahead)
    # All nodes that may reach `least` are looked at; how low that must be is known afterwards.
    lift, near, least = np.full(highest.shape, light), False, max(highest.max() * (1 - _SLACK), best)
    while True:
        count = nodes_above(found_none, bound, highest, lift, least, ahead)
        if count > _FEW and light > 0 and not near:
            near = True
            lift_nearby(lift, state, weight, chosen, corner, rho, light)
            count = nodes_above(found_none, bound, highest, lift, least, ahead)
        if count > _MANY and light > 0:
            return -1.0
        if count == 0:
            return best
        node, found, heights = np.empty((3, count)), np.empty((3, count), np.int64), np.empty(count)
        nodes_above(found, bound, highest, lift, least, ahead)
        for m in range(count):
            found[0, m] += corner[1]
            found[1, m] += corner[0]
            node[0, m], node[1, m] = found[1, m] * PARZEN_STEP[0], found[0, m] * PARZEN_STEP[1]
            node[2, m] = found[2, m] * PARZEN_STEP[2]
        error = nearly_sum_cones(heights, node, state, weight, rho)
        # Exact sums are for nodes that are as high within the error, if there are several.
        nearly = np.flatnonzero(heights >= max(heights.max() - 2 * error, best - error))
        if alone and len(nearly) == 1 and heights[nearly[0]] - error > best:
            heights[nearly[0]] -= error
        elif len(nearly) > 0:
            exact = np.empty((len(nearly) + 3) // 4 * 4)  # vectors of 4 have no rest then
            few = np.empty((3, len(exact)))
            for n in range(len(exact)):
                few[:, n] = node[:, nearly[min(n, len(nearly) - 1)]]
            sum_cones(exact, few, state, weight, rho)
            heights[nearly] = exact[: len(nearly)]
        for one in nearly:
            m = int(one)
            row, column, k = int(found[0, m]), int(found[1, m]), int(found[2, m])
            earlier = row < place[0] or (
                row == place[0] and (column < place[1] or (column == place[1] and k < place[2]))
            )
            if heights[m] > best or (heights[m] == best and earlier):
                best, place[0], place[1], place[2] = heights[m], row, column, k
        if best * (1 - _ROUNDING) >= least or least - light <= _NOTHING:
            return best
        least = best * (1 - _ROUNDING)
