"""Bins brought up to date down to a limit, letter by letter (compiled).

A bin's terms are added in the same order and precision as in `branch_and_bound`. What differs is the order of bins:
all angles of a letter come before the next letter, so that its tables are read while they are in the cache.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from tactsim.core.compiling import FLOATS, FLOATS_2D, INTS_2D, REALS_2D, Floats, Ints, Reals, compiled
from tactsim.estimators.field.slices import SLICES, Slices, place_terms, sum_tile
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.branch_and_bound import BELIEF, Belief, add_tile, least_age


@compiled(
    int64(
        BELIEF, SLICES, TERMS, int64, int64, int64, int64, int64, float64,
        REALS_2D, FLOATS, INTS_2D, FLOATS_2D, INTS_2D,
    ),
    called_from_python=False,
)  # fmt: skip
def raise_row(
    belief: Belief, slices: Slices, terms: Terms, letter: int, angle: int, i: int, reading: int, count: int,
    least: float, peak: Reals, total: Floats, offset: Ints, share: Floats, within: Ints,
) -> int:  # fmt: skip
    """Let the bins of one row of blocks take in a reading: those above `least` that have taken in all before it.

    i: number of the row. least: what `Belief.upper` is compared with. peak: (tile columns, LANES), total: (a tile,)
    room. Returns how many bins took it in.
    """
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    upper, seen = belief.upper[letter, angle, i], belief.seen[letter, angle, i]
    number, evaluated, j = terms.start[reading + 1] - terms.start[reading], 0, 0
    while j < len(seen):
        # Neighbours that want the same reading are evaluated together.
        last = j
        while last < len(seen) and seen[last] == reading and upper[last] > least:
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
        evaluated += (min(rows, (i + 1) * tall) - i * tall) * (min(columns, end) - begin)
        for k in range(j, last):
            highest = -np.inf
            for column in range(k * wide, min(columns, (k + 1) * wide)):
                highest = max(highest, peak[column // LANES, column % LANES])
            seen[k] = reading + 1
            upper[k] = min(upper[k], highest - terms.upper[reading + 1])
            belief.bounded[letter, angle, i, k] = count
        j = last
    return evaluated


@compiled(int64(BELIEF, SLICES, TERMS, REALS_2D, int64, int64, float64))
def raise_to(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, longest: int, floor: float
) -> int:
    """Bring all blocks of bins up to date whose upper bounds after `count` readings are above `floor`.

    A block whose upper bound falls to `floor` on the way takes in no further reading. turns: (angles, 2) cos and sin.
    longest: terms of the longest reading. Returns how many times a bin took in a reading.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, newest = belief.size[0], belief.size[1], count - 1
    offset, within = (
        np.empty((angles, longest, 4), dtype=np.int64),
        np.empty((angles, longest, 4), dtype=np.int64),
    )
    old_offset, old_within = np.empty((longest, 4), dtype=np.int64), np.empty((longest, 4), dtype=np.int64)
    share, old_share = (
        np.empty((angles, longest, 4), dtype=np.float32),
        np.empty((longest, 4), dtype=np.float32),
    )
    total, peak = np.empty(TALL * LANES, dtype=np.float32), np.empty((belief.log_p.shape[3], LANES))
    placed, evaluated = np.zeros(angles, dtype=np.int64), 0
    least = floor - terms.upper[count]
    for letter in range(letters):
        for angle in range(angles):
            if belief.summit[letter, angle] <= least:
                continue
            upper, seen = belief.upper[letter, angle], belief.seen[letter, angle]
            cos, sin = turns[angle, 0], turns[angle, 1]
            # Only readings that a block waits for are visited: one that was left alone may be thousands behind.
            reading = least_age(upper, seen, 0, block_rows, 0, block_columns, least)
            while reading < newest:
                place_terms(
                    terms, reading, slices, cos, sin, rows, columns, old_offset, old_share, old_within
                )
                for i in range(block_rows):
                    evaluated += raise_row(
                        belief, slices, terms, letter, angle, i, reading, count, least, peak, total,
                        old_offset, old_share, old_within,
                    )  # fmt: skip
                reading = least_age(upper, seen, 0, block_rows, 0, block_columns, least)
            if reading > newest:
                continue
            if not placed[angle]:
                place_terms(
                    terms, newest, slices, cos, sin, rows, columns, offset[angle], share[angle], within[angle]
                )
                placed[angle] = 1
            for i in range(block_rows):
                evaluated += raise_row(
                    belief, slices, terms, letter, angle, i, newest, count, least, peak, total,
                    offset[angle], share[angle], within[angle],
                )  # fmt: skip
    return evaluated


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
