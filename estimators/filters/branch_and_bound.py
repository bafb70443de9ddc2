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
    FLOATS_3D,
    INTS,
    INTS_2D,
    INTS_3D,
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


@compiled(
    void(TERMS, int64, SLICES, REALS_2D, int64, int64, INTS_3D, FLOATS_3D, INTS_3D),
    called_from_python=False,
)
def place_everywhere(
    terms: Terms, reading: int, slices: Slices, turns: Reals, rows: int, columns: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Place a reading's terms for every angle, in arrays (angles, terms, 4), as `place_terms` does for one."""
    for angle in range(len(turns)):
        place_terms(
            terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
            offset[angle], share[angle], within[angle],
        )  # fmt: skip


@compiled(
    int64(BELIEF, SLICES, TERMS, int64, int64, int64, int64, float64, FLOATS, INTS_2D, FLOATS_2D, INTS_2D),
    called_from_python=False,
)
def lower_tile(
    belief: Belief, slices: Slices, terms: Terms, letter: int, angle: int, tile: int, reading: int, floor: float,
    total: Floats, offset: Ints, share: Floats, within: Ints,
) -> int:  # fmt: skip
    """Let the blocks of a tile that are above `floor` take in a reading; returns how many took it in.

    They are those that have taken in all readings before it. tile: number of the tile of blocks, row by row.
    """
    _, _, rows, columns = belief.upper.shape
    tile_columns = -(-columns // LANES)
    first_row, first_column = tile // tile_columns * TALL, tile % tile_columns * LANES
    last_row, last_column = min(rows, first_row + TALL), min(columns, first_column + LANES)
    upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
    # What the bound of any state has gained is taken back: it is for the readings that were not taken in.
    gain = terms.slack[reading] - (terms.upper[reading + 1] - terms.upper[reading])
    needed = False
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            needed = needed or (bounded[row, column] == reading and upper[row, column] > floor)
    if not needed:
        return 0
    number = terms.start[reading + 1] - terms.start[reading]
    sum_tile(total, slices, number, letter, first_row, first_column, offset, share, within)
    evaluated = 0
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            if bounded[row, column] == reading:
                value = total[(row - first_row) * LANES + column - first_column]
                upper[row, column] += value + terms.constant[reading, letter] + gain
                bounded[row, column] = reading + 1
                evaluated += 1
    return evaluated


@compiled(int64(BELIEF, SLICES, TERMS, REALS_2D, int64, int64, float64), called_from_python=False)
def lower_bounds(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, longest: int, floor: float
) -> int:
    """Lower the upper bounds of the blocks that are above `floor`, with the tables' maxima over a block.

    A block whose upper bound falls below `floor` on the way takes in no further reading. longest: terms of the
    longest reading. Returns how many times a block took in a reading.
    """
    letters, angles, rows, columns = belief.upper.shape
    offset, within = (
        np.empty((angles, longest, 4), dtype=np.int64),
        np.empty((angles, longest, 4), dtype=np.int64),
    )
    share, total = np.empty((angles, longest, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    tiles = -(-rows // TALL) * -(-columns // LANES)
    below, newest = floor - terms.upper[count], count - 1
    evaluated, placed = 0, False
    # Earlier readings are few and of few blocks: an angle's terms are placed once for all letters.
    for angle in range(angles):
        oldest = newest
        for letter in range(letters):
            if belief.summit[letter, angle] <= below:
                continue
            for row in range(rows):
                for column in range(columns):
                    if belief.upper[letter, angle, row, column] > below:
                        oldest = min(oldest, belief.bounded[letter, angle, row, column])
        for reading in range(oldest, newest):
            place_terms(
                terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
                offset[angle], share[angle], within[angle],
            )  # fmt: skip
            for letter in range(letters):
                if belief.summit[letter, angle] > below:
                    for tile in range(tiles):
                        evaluated += lower_tile(
                            belief, slices, terms, letter, angle, tile, reading, below,
                            total, offset[angle], share[angle], within[angle],
                        )  # fmt: skip
    # The newest reading is for most of them: a letter's tables are read for all its angles while they are at hand.
    for letter in range(letters):
        for angle in range(angles):
            if belief.summit[letter, angle] <= below:
                continue
            if not placed:
                place_everywhere(terms, newest, slices, turns, rows, columns, offset, share, within)
                placed = True
            for tile in range(tiles):
                evaluated += lower_tile(
                    belief, slices, terms, letter, angle, tile, newest, below,
                    total, offset[angle], share[angle], within[angle],
                )  # fmt: skip
            belief.summit[letter, angle] = belief.upper[letter, angle].max()
    return evaluated


@compiled(
    types.Tuple((int64, float64, int64))(
        BELIEF, SLICES, TERMS, int64, int64, int64, int64, int64, int64, float64,
        REALS_2D, FLOATS, INTS_2D, FLOATS_2D, INTS_2D,
    ),
    called_from_python=False,
)  # fmt: skip
def advance_row(
    belief: Belief, slices: Slices, terms: Terms, letter: int, angle: int, i: int, only: int,
    reading: int, count: int, floor: float,
    peak: Reals, total: Floats, offset: Ints, share: Floats, within: Ints,
) -> tuple[int, float, int]:  # fmt: skip
    """Let the bins of one row of blocks take in a reading: those above `floor` that have taken in all before it.

    i: number of the row. only: flat index of the one block to look at, or -1. peak: (tile columns, LANES) room.
    Returns how many bins took it in, and the best of them, if it is the last reading, and its block's flat index.
    """
    _, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    upper, seen = belief.upper[letter, angle, i], belief.seen[letter, angle, i]
    bounded, any_state = belief.bounded[letter, angle, i], terms.upper
    first_block = ((letter * angles + angle) * block_rows + i) * block_columns
    number = terms.start[reading + 1] - terms.start[reading]
    below = floor - any_state[count]
    evaluated, best, incumbent, j = 0, -np.inf, -1, 0
    while j < block_columns:
        # Neighbours that want the same reading are evaluated together.
        last = j
        while (
            last < block_columns
            and seen[last] == reading
            and upper[last] > below
            and (only < 0 or only == first_block + last)
        ):
            last += 1
        if last == j:
            j += 1
            continue
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


@compiled(
    types.Tuple((int64, float64, int64))(
        BELIEF, SLICES, TERMS, REALS_2D, int64, int64, int64, float64, float64, float64, int64
    ),
    called_from_python=False,
)
def catch_up(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, only: int,
    count: int, longest: int, floor: float, margin: float, best: float, incumbent: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Bring the bins of blocks up to date that may come above `floor` and within `margin` of the best bin.

    only: flat index of the one block to look at, or -1. best: log-belief of the best bin so far. incumbent:
    flat index of its block. Returns how many times a bin took in a reading, and the new best and incumbent.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, any_state, newest = belief.size[0], belief.size[1], terms.upper, count - 1
    offset, within = (
        np.empty((angles, longest, 4), dtype=np.int64),
        np.empty((angles, longest, 4), dtype=np.int64),
    )
    share, total = np.empty((angles, longest, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    peak = np.empty((belief.log_p.shape[3], LANES))
    evaluated, placed = 0, False
    first_angle, last_angle = 0, angles
    first_letter, last_letter = 0, letters
    if only >= 0:
        first_angle = only // (block_rows * block_columns) % angles
        first_letter = only // (block_rows * block_columns * angles)
        last_angle, last_letter = first_angle + 1, first_letter + 1
    # A letter's tables are read for all its angles and readings while they are at hand: places are found faster than
    # tables are fetched.
    for letter in range(first_letter, last_letter):
        limit = max(floor, best - margin)
        for angle in range(first_angle, last_angle):
            oldest = newest
            if belief.summit[letter, angle] + any_state[count] <= limit:
                continue
            for i in range(block_rows):
                for j in range(block_columns):
                    block = ((letter * angles + angle) * block_rows + i) * block_columns + j
                    bound = belief.upper[letter, angle, i, j] + any_state[count]
                    if bound > limit and (only < 0 or only == block):
                        oldest = min(oldest, belief.seen[letter, angle, i, j])
            for reading in range(oldest, newest):
                place_terms(
                    terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
                    offset[angle], share[angle], within[angle],
                )  # fmt: skip
                for i in range(block_rows):
                    evaluated += advance_row(
                        belief, slices, terms, letter, angle, i, only, reading, count, limit,
                        peak, total, offset[angle], share[angle], within[angle],
                    )[0]  # fmt: skip
    # The newest reading is for most of them: a letter's tables are read for all its angles while they are at hand.
    for letter in range(first_letter, last_letter):
        for angle in range(first_angle, last_angle):
            limit = max(floor, best - margin)
            if belief.summit[letter, angle] + any_state[count] <= limit:
                continue
            if not placed:
                place_everywhere(
                    terms, newest, slices, turns[first_angle:last_angle], rows, columns,
                    offset[first_angle:last_angle], share[first_angle:last_angle], within[first_angle:last_angle],
                )  # fmt: skip
                placed = True
            for i in range(block_rows):
                made, highest, block = advance_row(
                    belief, slices, terms, letter, angle, i, only, newest, count, max(floor, best - margin),
                    peak, total, offset[angle], share[angle], within[angle],
                )  # fmt: skip
                evaluated += made
                if highest > best:
                    best, incumbent = highest, block
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
    lowered, none = 0, -np.inf
    # The better the best bin that is known, the fewer blocks can matter. So the incumbent comes first; at
    # the first reading the block with the highest upper bound.
    if count == 1 and margin < np.inf:
        lowered = lower_bounds(belief, blocks, terms, turns, count, longest, none)
        incumbent = int(belief.upper.argmax())
    evaluated, best, incumbent = catch_up(
        belief, bins, terms, turns, incumbent, count, longest, none, margin, none, incumbent
    )
    if count > 1 and margin < np.inf:
        lowered = lower_bounds(belief, blocks, terms, turns, count, longest, best - margin)
    made, best, incumbent = catch_up(
        belief, bins, terms, turns, -1, count, longest, none, margin, best, incumbent
    )
    return evaluated + made, lowered, incumbent


@compiled(int64(BELIEF, SLICES, TERMS, REALS_2D, int64, int64, float64))
def raise_to(
    belief: Belief, bins: Slices, terms: Terms, turns: Reals, count: int, longest: int, floor: float
) -> int:
    """Bring all blocks of bins up to date whose upper bounds after `count` readings are above `floor`.

    The arguments are as for `advance`. Returns how many times a bin took in a reading.
    """
    return catch_up(belief, bins, terms, turns, -1, count, longest, floor, np.inf, -np.inf, 0)[0]


@compiled(float64[:](BELIEF, int64))
def block_tops(belief: Belief, count: int) -> Reals:
    """List `Belief.upper` of the blocks whose bins are up to date after `count` readings."""
    upper, seen = belief.upper.reshape(belief.upper.size), belief.seen.reshape(belief.seen.size)
    tops, found = np.empty(len(upper)), 0
    for block in range(len(upper)):
        if seen[block] == count:
            tops[found] = upper[block]
            found += 1
    return tops[:found]
