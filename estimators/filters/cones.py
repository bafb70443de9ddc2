"""Sums of weighted cones: the kernel density of eq. 10 and 11 (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float32, float64, int64, uint64, void

from tactsim.core.compiling import FLOATS_3D, REALS, REALS_2D, Floats, Reals, compiled


@compiled(void(FLOATS_3D, int64, REALS_2D, REALS, REALS, REALS, float64), ordered=False)
def add_cones(
    density: Floats, before: int, state: Reals, weight: Reals, corner: Reals, step: Reals, rho: float
) -> None:
    """Add the weighted cones (eq. 10, 11) of states to a grid.

    density: (rows, columns, angles), beginning at [x, y] = corner mm and `before` angles ahead of 0,
    which must be more than rho has steps. state: (3, states), with angles in [0, 2 pi). step: mm, mm,
    rad. Cones are not folded around the circle. The distance of eq. 10 counts mm and rad alike.
    """
    rows, columns, angles = density.shape
    nodes, square = density.reshape(density.size), step[2] ** 2
    reach_x, reach_y, reach = rho / step[0], rho / step[1], int64(rho / step[2])
    turned, nothing = np.empty(2 * reach + 2, dtype=np.float32), float32(0)
    for i in range(len(weight)):
        x, y = (state[0, i] - corner[0]) / step[0], (state[1, i] - corner[1]) / step[1]
        turn, height, slope = state[2, i] / step[2], float32(weight[i]), float32(weight[i] / rho)
        first = math.ceil(turn - rho / step[2])
        for k in range(uint64(len(turned))):
            turned[k] = square * (first - turn + k) ** 2
        for row in range(max(0, math.ceil(y - reach_y)), min(rows, math.floor(y + reach_y) + 1)):
            for column in range(max(0, math.ceil(x - reach_x)), min(columns, math.floor(x + reach_x) + 1)):
                flat = float32(((column - x) * step[0]) ** 2 + ((row - y) * step[1]) ** 2)
                if flat >= rho**2:
                    continue
                at = uint64((row * columns + column) * angles + before + first)
                for k in range(uint64(len(turned))):
                    nodes[at + k] += max(nothing, height - slope * math.sqrt(flat + turned[k]))


@compiled(void(REALS, REALS_2D, REALS_2D, REALS, float64))
def sum_cones(density: Reals, node: Reals, state: Reals, weight: Reals, rho: float) -> None:
    """Sum the weighted cones (eq. 10, 11) of states at single nodes, around the circle.

    density: (nodes,) is overwritten. node: (nodes, 3), state: (3, states) mm, mm, rad, angles in [0, 2 pi).
    """
    for m in range(len(density)):
        density[m] = 0
        for i in range(len(weight)):
            turn = abs(state[2, i] - node[m, 2])
            turn = min(turn, 2 * math.pi - turn)
            square = (state[0, i] - node[m, 0]) ** 2 + (state[1, i] - node[m, 1]) ** 2 + turn**2
            if square < rho**2:
                density[m] += weight[i] * (1 - math.sqrt(square) / rho)
