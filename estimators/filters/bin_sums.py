"""What is read off the log-belief of all bins: sums, modes, and the best bins (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, types, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.branch_and_bound import BELIEF, Belief
from tactsim.estimators.filters.placement import samples_of_cells


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


@compiled(int64(BELIEF, float64, int64, float64, int64, int64, INTS, REALS), called_from_python=False)
def pick_letters(
    belief: Belief,
    any_state: float,
    count: int,
    least: float,
    first: int,
    last: int,
    flat: Ints,
    log_p: Reals,
) -> int:
    """List the bins of letters first, ..., last - 1, up to date after `count` readings, from log-belief `least` on.

    any_state: `Terms.upper` after so many readings. Fills flat, index into (letters, angles, rows,
    columns), and log_p from the start, which need the room that `room_for` says; returns how many there are.
    """
    _, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    found = 0
    for letter in range(first, last):
        for angle in range(angles):
            for i in range(block_rows):
                for j in range(block_columns):
                    bound = belief.upper[letter, angle, i, j] + any_state
                    if belief.seen[letter, angle, i, j] != count or bound < least:
                        continue
                    for row in range(i * tall, min(rows, (i + 1) * tall)):
                        tiles = belief.log_p[letter, angle, row // TALL]
                        for column in range(j * wide, min(columns, (j + 1) * wide)):
                            # Before the first reading all bins are alike, whatever is stored.
                            value = (
                                tiles[column // LANES, row % TALL * LANES + column % LANES] if count else 0.0
                            )
                            if value >= least:
                                flat[found] = ((letter * angles + angle) * rows + row) * columns + column
                                log_p[found] = value
                                found += 1
    return found


@compiled(int64(BELIEF, float64, int64, float64, INTS, REALS))
def pick(belief: Belief, any_state: float, count: int, least: float, flat: Ints, log_p: Reals) -> int:
    """List the bins of all letters, as `pick_letters` does; flat and log_p have room for all bins."""
    return int(pick_letters(belief, any_state, count, least, 0, len(belief.seen), flat, log_p))


@compiled(int64(BELIEF, float64, int64, float64, int64, int64), called_from_python=False)
def room_for(belief: Belief, any_state: float, count: int, least: float, first: int, last: int) -> int:
    """Count the bins of the blocks that `pick_letters` looks into, given the same."""
    _, angles, block_rows, block_columns = belief.seen.shape
    blocks = 0
    for letter in range(first, last):
        for angle in range(angles):
            for i in range(block_rows):
                for j in range(block_columns):
                    bound = belief.upper[letter, angle, i, j] + any_state
                    blocks += belief.seen[letter, angle, i, j] == count and bound >= least
    return blocks * belief.size[2] * belief.size[3]


@compiled(
    types.Tuple((REALS, INTS, REALS_2D, REALS))(
        BELIEF, REALS, int64, float64, int64, float64, REALS, REALS, REALS, REALS, REALS_2D, float64
    )
)
def posterior(
    belief: Belief, any_state: Reals, count: int, margin: float, incumbent: int, within: float,
    x: Reals, y: Reals, angle: Reals, spacing: Reals, corners: Reals, spread: float,
) -> tuple[Reals, Ints, Reals, Reals]:  # fmt: skip
    """Sum the belief of each letter and find its mode (`summarise`), and list the bins of the letter that holds most.

    within: nats below the best bin up to which bins are listed. x, y (mm), angle (rad): the bins' centroids. spacing:
    (3,) their size. corners, spread: as `samples_of_cells` takes them. Returns mass and mode, (letters,) each, and
    poses (n, 3) and weights (n,), which sum to 1.
    """
    letters, rows, columns = len(belief.seen), belief.size[0], belief.size[1]
    mass, mode = np.empty(letters), np.empty(letters, dtype=np.int64)
    summarise(belief, any_state, count, margin, incumbent, mass, mode)
    letter = int(mass.argmax())
    least = belief.upper.reshape(belief.upper.size)[incumbent] + any_state[count] - within
    room = room_for(belief, any_state[count], count, least, letter, letter + 1)
    flat, weight = np.empty(room, dtype=np.int64), np.empty(room)
    found = pick_letters(belief, any_state[count], count, least, letter, letter + 1, flat, weight)
    highest = weight[:found].max()
    state, size, total = np.empty((3, found)), np.empty((3, found)), 0.0
    for k in range(found):
        weight[k] = math.exp(weight[k] - highest)
        total += weight[k]
        state[0, k], state[1, k] = x[flat[k] % columns], y[flat[k] // columns % rows]
        state[2, k] = angle[flat[k] // (columns * rows) % len(angle)]
    for axis in range(3):
        size[axis] = spacing[axis]
    poses, share = samples_of_cells(state, weight[:found] / total, size, corners, spread)
    return mass, mode, poses, share
