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
    FLOATS_2D,
    INTS,
    INTS_2D,
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
# What `least_age` gives where no block is above the limit.
_NEVER = np.iinfo(np.int64).max


class Room(NamedTuple):
    """Room for the terms of one reading as `place_terms` places them, a tile's total, and the peak of its columns."""

    offset: Ints
    share: Floats
    within: Ints
    total: Floats
    peak: Reals


ROOM = types.NamedTuple((INTS_2D, FLOATS_2D, INTS_2D, FLOATS, REALS_2D), Room)
PART = types.UniTuple(int64, 6)


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


@compiled(int64(REALS_2D, INTS_2D, int64, int64, int64, int64, float64), called_from_python=False)
def least_age(
    upper: Reals, age: Ints, row: int, last_row: int, column: int, last_column: int, least: float
) -> int:
    """Find the least age of the blocks of a rectangle whose `upper` is above `least`; if none is, _NEVER.

    upper, age: (block rows, block columns) of one letter and angle; an age is a number of readings taken in.
    """
    youngest = _NEVER
    for i in range(row, last_row):
        for j in range(column, last_column):
            if upper[i, j] > least:
                youngest = min(youngest, age[i, j])
    return youngest


@compiled(int64(BELIEF, SLICES, TERMS, REALS_2D, int64, ROOM, float64), called_from_python=False)
def lower_bounds(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, room: Room, floor: float
) -> int:
    """Lower the upper bounds of the blocks that are above `floor`, with the tables' maxima over a block.

    A block whose upper bound falls below `floor` on the way takes in no further reading. Returns how many times a
    block took in a reading.
    """
    letters, angles, rows, columns = belief.upper.shape
    tile_rows, tile_columns = -(-rows // TALL), -(-columns // LANES)
    tiles = letters * tile_rows * tile_columns
    wanted, waits_for = np.empty(tiles, dtype=np.int64), np.empty(tiles, dtype=np.int64)
    any_state, evaluated = terms.upper, 0
    least = floor - any_state[count]  # what `upper` is compared with
    for angle in range(angles):
        chosen, reading = 0, count
        for letter in range(letters):
            if belief.summit[letter, angle] <= least:
                continue
            upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
            for i in range(0, rows, TALL):
                for j in range(0, columns, LANES):
                    age = least_age(upper, bounded, i, min(rows, i + TALL), j, min(columns, j + LANES), least)
                    if age < count:
                        wanted[chosen] = (letter * rows + i) * columns + j
                        waits_for[chosen] = age
                        chosen += 1
                        reading = min(reading, age)
        # Only readings that a tile waits for are visited: one that was left alone may be thousands behind.
        while reading < count:
            place_terms(
                terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
                room.offset, room.share, room.within,
            )  # fmt: skip
            number = terms.start[reading + 1] - terms.start[reading]
            gain = terms.slack[reading] - (any_state[reading + 1] - any_state[reading])
            next_one = count
            for w in range(chosen):
                if waits_for[w] == reading:
                    letter, i, j = (
                        wanted[w] // (rows * columns),
                        wanted[w] // columns % rows,
                        wanted[w] % columns,
                    )
                    last_row, last_column = min(rows, i + TALL), min(columns, j + LANES)
                    upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
                    sum_tile(room.total, slices, number, letter, i, j, room.offset, room.share, room.within)
                    for row in range(i, last_row):
                        for column in range(j, last_column):
                            if bounded[row, column] == reading:
                                value = room.total[(row - i) * LANES + column - j]
                                upper[row, column] += value + terms.constant[reading, letter] + gain
                                bounded[row, column] = reading + 1
                                evaluated += 1
                    waits_for[w] = least_age(upper, bounded, i, last_row, j, last_column, least)
                next_one = min(next_one, waits_for[w])
            reading = next_one
        for letter in range(letters):
            if belief.summit[letter, angle] > least:
                belief.summit[letter, angle] = belief.upper[letter, angle].max()
    return evaluated


@compiled(
    types.Tuple((int64, float64, int64))(
        BELIEF, SLICES, TERMS, REALS_2D, int64, PART, int64, ROOM, float64, float64, int64
    ),
    called_from_python=False,
)
def catch_up(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, angle: int, part: tuple[int, ...],
    count: int, room: Room, margin: float, best: float, incumbent: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Bring the bins of one angle's blocks up to date that may come within `margin` of the best bin.

    part: of which blocks: letters from, to, block rows from, to, block columns from, to. best: log-belief of the best
    bin so far. incumbent: flat index of its block. Returns how many times a bin took in a reading, and the new best
    and incumbent.
    """
    _, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    any_state, evaluated, chosen, reading = terms.upper, 0, 0, count
    most = (part[1] - part[0]) * (part[3] - part[2])
    wanted, waits_for = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    least = best - margin - any_state[count]  # what `upper` is compared with
    for letter in range(part[0], part[1]):
        if belief.summit[letter, angle] <= least:
            continue
        for i in range(part[2], part[3]):
            age = least_age(
                belief.upper[letter, angle], belief.seen[letter, angle], i, i + 1, part[4], part[5], least
            )
            if age < count:
                wanted[chosen], waits_for[chosen] = letter * block_rows + i, age
                chosen += 1
                reading = min(reading, age)
    # Only readings that a row of blocks waits for are visited, as with bounds.
    while reading < count:
        place_terms(
            terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
            room.offset, room.share, room.within,
        )  # fmt: skip
        number, next_one = terms.start[reading + 1] - terms.start[reading], count
        for w in range(chosen):
            if waits_for[w] != reading:
                next_one = min(next_one, waits_for[w])
                continue
            letter, i = wanted[w] // block_rows, wanted[w] % block_rows
            upper, seen = belief.upper[letter, angle], belief.seen[letter, angle]
            first_block = ((letter * angles + angle) * block_rows + i) * block_columns
            height = min(rows, (i + 1) * tall) - i * tall
            j = part[4]
            while j < part[5]:
                # Neighbours that want the same reading are evaluated together.
                last = j
                while last < part[5] and seen[i, last] == reading and upper[i, last] > least:
                    last += 1
                if last == j:
                    j += 1
                    continue
                begin, end = j * wide, last * wide
                first_tile, end_tile = begin // LANES, (end - 1) // LANES + 1
                room.peak[first_tile:end_tile] = -np.inf
                for tile_row in range(i * tall // TALL, min(belief.log_p.shape[2], (i + 1) * tall // TALL)):
                    for tile in range(first_tile, end_tile):
                        row, column = tile_row * TALL, tile * LANES
                        sum_tile(
                            room.total, slices, number, letter, row, column,
                            room.offset, room.share, room.within,
                        )  # fmt: skip
                        here = belief.log_p[letter, angle, tile_row, tile]
                        # Before the first reading all bins are alike, whatever is stored.
                        before = belief.edge[tile_row, tile] if reading == 0 else here
                        add_tile(
                            here, before, room.total, terms.constant[reading, letter],
                            max(0, begin - column), min(LANES, end - column), room.peak[tile],
                        )  # fmt: skip
                evaluated += height * (min(columns, end) - begin)
                for k in range(j, last):
                    highest = -np.inf
                    for column in range(k * wide, min(columns, (k + 1) * wide)):
                        highest = max(highest, room.peak[column // LANES, column % LANES])
                    seen[i, k] = reading + 1
                    upper[i, k] = min(upper[i, k], highest - any_state[reading + 1])
                    belief.bounded[letter, angle, i, k] = count
                    if reading + 1 == count and highest > best:
                        best, incumbent = highest, first_block + k
                        least = best - margin - any_state[count]
                j = last
            waits_for[w] = least_age(upper, seen, i, i + 1, part[4], part[5], least)
            next_one = min(next_one, waits_for[w])
        reading = next_one
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
    letters, angles, block_rows, block_columns = belief.seen.shape
    room = Room(
        np.empty((longest, 4), dtype=np.int64), np.empty((longest, 4), dtype=np.float32),
        np.empty((longest, 4), dtype=np.int64), np.empty(TALL * LANES, dtype=np.float32),
        np.empty((belief.log_p.shape[3], LANES)),
    )  # fmt: skip
    best, lowered = -np.inf, 0
    if count == 1:
        # The better the best bin that is known, the fewer blocks can matter. So the incumbent comes first; at
        # the first reading the block with the highest upper bound.
        lowered = lower_bounds(belief, blocks, terms, turns, count, room, best)
        incumbent = int(belief.upper.argmax())
    block = incumbent // block_columns
    letter, angle, i = block // (angles * block_rows), block // block_rows % angles, block % block_rows
    j = incumbent % block_columns
    evaluated, best, incumbent = catch_up(
        belief, bins, terms, turns, angle, (letter, letter + 1, i, i + 1, j, j + 1), count, room, margin,
        best, incumbent,
    )  # fmt: skip
    if count > 1:
        lowered = lower_bounds(belief, blocks, terms, turns, count, room, best - margin)
    for angle in range(angles):
        made, best, incumbent = catch_up(
            belief, bins, terms, turns, angle, (0, letters, 0, block_rows, 0, block_columns), count, room,
            margin, best, incumbent,
        )  # fmt: skip
        evaluated += made
    return evaluated, lowered, incumbent
