"""The histogram filter's branch and bound: which bins are summed, and which can wait (compiled).

A bin's terms are always added in the same order and precision, so it does not matter when, or beside
which others, a bin is evaluated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, uint64, void

from tactsim.core.compiling import (
    FLOATS,
    INTS,
    INTS_4D,
    REALS,
    REALS_2D,
    REALS_3D,
    REALS_4D,
    REALS_5D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.slices import SLICES, Slices, place_terms, sum_tile
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL


class Belief(NamedTuple):
    """The log-belief of all bins, and what is known of blocks of bins that were left alone.

    log_p: (letters, angles, tile rows, tile columns, TALL * LANES), a bin's log-belief after the first
    `seen` readings, not normalised. edge: (tile rows, tile columns, TALL * LANES), 0 for a bin and
    -inf where a tile hangs over the grid. upper, seen, bounded: (letters, angles, block rows, block
    columns). After `count` readings, upper + terms.upper[count] is an upper bound of a block's bins. It
    holds the tables' maxima over the block for the first `bounded` readings, and for later ones what any
    state may get. summit: (letters, angles), not below any `upper` there. size: rows and columns of bins,
    rows and columns of bins in a block. A block is made of whole tiles, or is one of the equal columns
    that a tile is cut into.
    """

    log_p: Reals
    edge: Reals
    upper: Reals
    seen: Ints
    bounded: Ints
    summit: Reals
    size: Ints


BELIEF = types.NamedTuple((REALS_5D, REALS_3D, REALS_4D, INTS_4D, INTS_4D, REALS_2D, INTS), Belief)


@compiled(void(REALS, REALS, FLOATS, float64, int64, int64, REALS), ordered=False, called_from_python=False)
def add_tile(
    log_p: Reals, before: Reals, total: Floats, constant: float, first: int, last: int, peak: Reals
) -> None:
    """Set lanes first..last of a tile to before + constant + total; raise peak (LANES,) to them.

    Arrays are (TALL * LANES,). Other lanes of `peak` are left without meaning.
    """
    # Unsigned, because a signed index is compiled with a test for negative ones, without vectors.
    one, two, three = uint64(LANES), uint64(2 * LANES), uint64(3 * LANES)
    if first == 0 and last == LANES:
        for k in range(one):
            log_p[k] = before[k] + (constant + total[k])
            log_p[k + one] = before[k + one] + (constant + total[k + one])
            log_p[k + two] = before[k + two] + (constant + total[k + two])
            log_p[k + three] = before[k + three] + (constant + total[k + three])
    else:
        for row in range(TALL):
            for k in range(uint64(row * LANES + first), uint64(row * LANES + last)):
                log_p[k] = before[k] + (constant + total[k])
    for k in range(one):
        upper, lower = max(log_p[k], log_p[k + one]), max(log_p[k + two], log_p[k + three])
        peak[k] = max(peak[k], max(upper, lower))


@compiled(int64(BELIEF, SLICES, TERMS, REALS_2D, int64, int64, float64), called_from_python=False)
def lower_bounds(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, longest: int, floor: float
) -> int:
    """Lower the upper bounds of the blocks that are above `floor`, with the tables' maxima over a block.

    A block whose upper bound falls below `floor` on the way takes in no further reading. longest: terms of the
    longest reading. Returns how many times a block took in a reading.
    """
    letters, angles, rows, columns = belief.upper.shape
    offset, within = np.empty((longest, 4), dtype=np.int64), np.empty((longest, 4), dtype=np.int64)
    share, total = np.empty((longest, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    tile_rows, tile_columns = -(-rows // TALL), -(-columns // LANES)
    wanted, any_state = np.empty(letters * tile_rows * tile_columns, dtype=np.int64), terms.upper
    evaluated = 0
    for angle in range(angles):
        oldest, chosen = count, 0
        for letter in range(letters):
            if belief.summit[letter, angle] + any_state[count] <= floor:
                continue
            for i in range(tile_rows):
                for j in range(tile_columns):
                    age = count
                    for row in range(i * TALL, min(rows, (i + 1) * TALL)):
                        for column in range(j * LANES, min(columns, (j + 1) * LANES)):
                            if belief.upper[letter, angle, row, column] + any_state[count] > floor:
                                age = min(age, belief.bounded[letter, angle, row, column])
                    if age < count:
                        wanted[chosen] = (letter * tile_rows + i) * tile_columns + j
                        chosen += 1
                        oldest = min(oldest, age)
        for reading in range(oldest, count):
            placed = False
            number = terms.start[reading + 1] - terms.start[reading]
            gain = terms.slack[reading] - (any_state[reading + 1] - any_state[reading])
            for w in range(chosen):
                letter, i = wanted[w] // (tile_rows * tile_columns), wanted[w] // tile_columns % tile_rows
                first_row, first_column = i * TALL, wanted[w] % tile_columns * LANES
                last_row, last_column = min(rows, first_row + TALL), min(columns, first_column + LANES)
                upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
                needed = False
                for row in range(first_row, last_row):
                    for column in range(first_column, last_column):
                        if bounded[row, column] == reading and upper[row, column] + any_state[count] > floor:
                            needed = True
                if not needed:
                    continue
                if not placed:
                    cos, sin = turns[angle, 0], turns[angle, 1]
                    place_terms(terms, reading, slices, cos, sin, rows, columns, offset, share, within)
                    placed = True
                sum_tile(total, slices, number, letter, first_row, first_column, offset, share, within)
                for row in range(first_row, last_row):
                    for column in range(first_column, last_column):
                        if bounded[row, column] == reading:
                            value = total[(row - first_row) * LANES + column - first_column]
                            upper[row, column] += value + terms.constant[reading, letter] + gain
                            bounded[row, column] = reading + 1
                            evaluated += 1
        for letter in range(letters):
            if belief.summit[letter, angle] + any_state[count] > floor:
                belief.summit[letter, angle] = belief.upper[letter, angle].max()
    return evaluated


@compiled(
    types.Tuple((int64, float64, int64))(
        BELIEF, SLICES, TERMS, REALS_2D, int64, int64, int64, int64, float64, float64, int64
    ),
    called_from_python=False,
)
def catch_up(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, angle: int, only: int,
    count: int, longest: int, margin: float, best: float, incumbent: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Bring the bins of one angle's blocks up to date that may come within `margin` of the best bin.

    only: flat index of the one block to look at, or -1. best: log-belief of the best bin so far. incumbent:
    flat index of its block. Returns how many times a bin took in a reading, and the new best and incumbent.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    offset, within = np.empty((longest, 4), dtype=np.int64), np.empty((longest, 4), dtype=np.int64)
    share, total = np.empty((longest, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    peak = np.empty((belief.log_p.shape[3], LANES))
    wanted = np.empty(letters * block_rows, dtype=np.int64)
    any_state = terms.upper
    oldest, evaluated, chosen = count, 0, 0
    for letter in range(letters):
        if belief.summit[letter, angle] + any_state[count] <= best - margin:
            continue
        for i in range(block_rows):
            age = count
            for j in range(block_columns):
                block = ((letter * angles + angle) * block_rows + i) * block_columns + j
                bound = belief.upper[letter, angle, i, j] + any_state[count]
                if bound > best - margin and (only < 0 or only == block):
                    age = min(age, belief.seen[letter, angle, i, j])
            if age < count:
                wanted[chosen] = letter * block_rows + i
                chosen += 1
                oldest = min(oldest, age)
    for reading in range(oldest, count):
        placed = False
        number = terms.start[reading + 1] - terms.start[reading]
        for w in range(chosen):
            letter, i = wanted[w] // block_rows, wanted[w] % block_rows
            upper, seen = belief.upper[letter, angle, i], belief.seen[letter, angle, i]
            bounded = belief.bounded[letter, angle, i]
            first_block = ((letter * angles + angle) * block_rows + i) * block_columns
            j = 0
            while j < block_columns:
                # Neighbours that want the same reading are evaluated together.
                last = j
                while (
                    last < block_columns
                    and seen[last] == reading
                    and upper[last] + any_state[count] > best - margin
                    and (only < 0 or only == first_block + last)
                ):
                    last += 1
                if last == j:
                    j += 1
                    continue
                if not placed:
                    cos, sin = turns[angle, 0], turns[angle, 1]
                    place_terms(terms, reading, slices, cos, sin, rows, columns, offset, share, within)
                    placed = True
                begin, end = j * wide, last * wide
                first_tile, end_tile = begin // LANES, (end - 1) // LANES + 1
                peak[first_tile:end_tile] = -np.inf
                for tile_row in range(i * tall // TALL, min(belief.log_p.shape[2], (i + 1) * tall // TALL)):
                    for tile in range(first_tile, end_tile):
                        row, column = tile_row * TALL, tile * LANES
                        sum_tile(total, slices, number, letter, row, column, offset, share, within)
                        here = belief.log_p[letter, angle, tile_row, tile]
                        # Before the first reading all bins are alike, whatever is stored.
                        before = belief.edge[tile_row, tile] if reading == 0 else here
                        add_tile(
                            here, before, total, terms.constant[reading, letter],
                            max(0, begin - column), min(LANES, end - column), peak[tile],
                        )  # fmt: skip
                height = min(rows, (i + 1) * tall) - i * tall
                evaluated += height * (min(columns, last * wide) - j * wide)
                for k in range(j, last):
                    highest = -np.inf
                    for column in range(k * wide, min(columns, (k + 1) * wide)):
                        highest = max(highest, peak[column // LANES, column % LANES])
                    seen[k] = reading + 1
                    upper[k] = min(upper[k], highest - any_state[reading + 1])
                    bounded[k] = count
                    if reading + 1 == count and highest > best:
                        best, incumbent = highest, first_block + k
                j = last
    return evaluated, best, incumbent


@compiled(types.UniTuple(int64, 3)(BELIEF, SLICES, SLICES, TERMS, REALS_2D, int64, int64, float64, int64))
def advance(
    belief: Belief, bins: Slices, blocks: Slices, terms: Terms, turns: Reals,
    count: int, longest: int, margin: float, incumbent: int,
) -> tuple[int, int, int]:  # fmt: skip
    """Bring the bins up to date that can still matter after `count` readings (eq. 13, in logs).

    A block is left alone while its upper bound is `margin` or more below the best bin. The bound is first
    lowered with the tables' maxima (`blocks`); if that is not enough, the block's bins are caught up.
    turns: (angles, 2) cos and sin. longest: terms of the longest reading. incumbent: flat index of the block
    that held the best bin before the last reading. Returns how many times a bin and a block took in a
    reading, and the new incumbent.
    """
    _, angles, block_rows, block_columns = belief.seen.shape
    best, evaluated, lowered = -np.inf, 0, 0
    # The better the best bin that is known, the fewer blocks can matter. So the incumbent comes first; at
    # the first reading the block with the highest upper bound.
    for step in range(-1, angles):
        if step == (-1 if count == 1 else 0) and margin < np.inf:
            lowered = lower_bounds(belief, blocks, terms, turns, count, longest, best - margin)
            if count == 1:
                incumbent = int(belief.upper.argmax())
        angle, only = step, -1
        if step < 0:
            angle, only = incumbent // (block_rows * block_columns) % angles, incumbent
        made, best, incumbent = catch_up(
            belief, bins, terms, turns, angle, only, count, longest, margin, best, incumbent
        )
        evaluated += made
    return evaluated, lowered, incumbent
