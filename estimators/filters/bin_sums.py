"""What is read off the log-belief of all bins: sums, modes, and the best bins (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, void

from tactsim.core.compiling import INTS, REALS, Ints, Reals, compiled
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.branch_and_bound import BELIEF, Belief


@compiled(void(BELIEF, REALS, int64, float64, int64, REALS, INTS))
def summarise(
    belief: Belief, any_state: Reals, count: int, margin: float, incumbent: int, mass: Reals, mode: Ints
) -> None:
    """Sum the belief of each letter (eq. 14) and find its best bin (eq. 15).

    Bins `margin` or more below the best are left out. incumbent: flat index of the block of the best bin.
    Fills mass (letters,), relative to the best bin, and mode (letters,), flat index into
    its (angles, rows, columns), or -1.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    best = belief.upper.reshape(belief.upper.size)[incumbent] + any_state[count]
    for letter in range(letters):
        mass[letter], mode[letter], highest = 0.0, -1, -np.inf
        for angle in range(angles):
            if belief.summit[letter, angle] + any_state[count] <= best - margin:
                continue
            for i in range(block_rows):
                for j in range(block_columns):
                    bound = belief.upper[letter, angle, i, j] + any_state[count]
                    if belief.seen[letter, angle, i, j] != count or bound <= best - margin:
                        continue
                    for row in range(i * tall, min(rows, (i + 1) * tall)):
                        tiles = belief.log_p[letter, angle, row // TALL]
                        for column in range(j * wide, min(columns, (j + 1) * wide)):
                            value = tiles[column // LANES, row % TALL * LANES + column % LANES]
                            if count == 0:
                                value = 0.0
                            if value > best - margin:
                                mass[letter] += math.exp(value - best)
                                if value > highest:
                                    highest = value
                                    mode[letter] = (angle * rows + row) * columns + column


@compiled(int64(BELIEF, float64, int64, float64, INTS, REALS))
def pick(belief: Belief, any_state: float, count: int, least: float, flat: Ints, log_p: Reals) -> int:
    """List the bins, up to date after `count` readings, whose log-belief is at least `least`.

    any_state: `Terms.upper` after so many readings. Fills flat, index into (letters, angles, rows,
    columns), and log_p, both (bins of all letters,), from the start; returns how many there are.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    found = 0
    for letter in range(letters):
        for angle in range(angles):
            if belief.summit[letter, angle] + any_state < least:
                continue
            for i in range(block_rows):
                for j in range(block_columns):
                    bound = belief.upper[letter, angle, i, j] + any_state
                    if belief.seen[letter, angle, i, j] != count or bound < least:
                        continue
                    for row in range(i * tall, min(rows, (i + 1) * tall)):
                        tiles = belief.log_p[letter, angle, row // TALL]
                        for column in range(j * wide, min(columns, (j + 1) * wide)):
                            value = tiles[column // LANES, row % TALL * LANES + column % LANES]
                            if value >= least:
                                flat[found] = ((letter * angles + angle) * rows + row) * columns + column
                                log_p[found] = value
                                found += 1
    return found
