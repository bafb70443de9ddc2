"""Readings drawn for a sensor pose, and what each of them would say of every state (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float32, int64, uint64, void

from tactsim.core.compiling import (
    FLOATS_2D,
    FLOATS_3D,
    FLOATS_4D,
    INTS,
    REALS,
    REALS_2D,
    Floats,
    Ints,
    Reals,
    compiled,
)


@compiled(
    void(FLOATS_2D, REALS, INTS, INTS, REALS_2D, REALS_2D, FLOATS_4D,
         REALS, FLOATS_3D),
    ordered=False,
)  # fmt: skip
def foresee(
    log_p: Floats, pose: Reals, drawn: Ints, letter: Ints, state: Reals, taxel_xy: Reals, nodes: Floats,
    lattice: Reals, chance: Floats,
) -> None:  # fmt: skip
    """Draw a reading at a sensor pose for some states s, and find log p of it for every state t: log_p[s, t].

    pose: sensor_in_robot. drawn: the states s. letter: (states,). state: (3, states) T_R^O. nodes: (letters,
    rows, columns, classes) log p. lattice: [x, y] of node (0, 0), then the step in x and y, mm. chance: (s, taxels,
    classes) of the standard Gumbel distribution: the class where log p + chance is largest is drawn.
    """
    _, rows, columns, classes = nodes.shape
    states, taxels = len(letter), len(taxel_xy)
    predicted = np.empty((taxels, classes, states), dtype=np.float32)
    last_column, last_row = columns - 1.000001, rows - 1.000001
    for t in range(states):
        angle = state[2, t] + pose[2]
        cos, sin = math.cos(angle), math.sin(angle)
        turn_cos, turn_sin = math.cos(state[2, t]), math.sin(state[2, t])
        x = state[0, t] + turn_cos * pose[0] - turn_sin * pose[1] - lattice[0]
        y = state[1, t] + turn_sin * pose[0] + turn_cos * pose[1] - lattice[1]
        for e in range(taxels):
            u = (x + cos * taxel_xy[e, 0] - sin * taxel_xy[e, 1]) / lattice[2]
            v = (y + sin * taxel_xy[e, 0] + cos * taxel_xy[e, 1]) / lattice[3]
            u, v = min(max(u, 0.0), last_column), min(max(v, 0.0), last_row)
            column, row = int64(u), int64(v)
            right, above = float32(u - column), float32(v - row)
            here, up = nodes[letter[t], row], nodes[letter[t], row + 1]
            for k in range(classes):
                lower = here[column, k] + right * (here[column + 1, k] - here[column, k])
                upper = up[column, k] + right * (up[column + 1, k] - up[column, k])
                predicted[e, k, t] = lower + above * (upper - lower)
    log_p[:] = 0
    for s in range(len(drawn)):
        total = log_p[s]
        for e in range(taxels):
            felt, highest = 0, -np.inf
            for k in range(classes):
                value = predicted[e, k, drawn[s]] + chance[s, e, k]
                if value > highest:
                    felt, highest = k, value
            as_felt = predicted[e, felt]
            for t in range(uint64(states)):
                total[t] += as_felt[t]
