"""All bins brought up to date, letter by letter (compiled).

A bin's terms are added in the same order and precision as in `branch_and_bound`. What differs is the order of bins:
all angles of a letter come before the next letter, so that its tables are read while they are in the cache.
"""

from __future__ import annotations

import numpy as np
from numba import int64, void

from tactsim.core.compiling import REALS_2D, Reals, compiled
from tactsim.estimators.field.slices import SLICES, Slices, place_terms, sum_tile
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.branch_and_bound import BELIEF, Belief, add_tile


@compiled(void(BELIEF, SLICES, TERMS, REALS_2D, int64, int64))
def take_in(belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, longest: int) -> None:
    """Let all bins take in reading number `count`; they have taken in all before it.

    turns: (angles, 2) cos and sin. longest: terms of the longest reading.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    reading = count - 1
    number = terms.start[count] - terms.start[reading]
    offset, within = (
        np.empty((angles, longest, 4), dtype=np.int64),
        np.empty((angles, longest, 4), dtype=np.int64),
    )
    share = np.empty((angles, longest, 4), dtype=np.float32)
    for angle in range(angles):
        place_terms(
            terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns,
            offset[angle], share[angle], within[angle],
        )  # fmt: skip
    total, peak = np.empty(TALL * LANES, dtype=np.float32), np.empty((belief.log_p.shape[3], LANES))
    for letter in range(letters):
        for angle in range(angles):
            log_p, upper = belief.log_p[letter, angle], belief.upper[letter, angle]
            for i in range(block_rows):
                peak[:] = -np.inf
                for tile_row in range(i * tall // TALL, min(len(log_p), (i + 1) * tall // TALL)):
                    for tile in range(log_p.shape[1]):
                        sum_tile(
                            total, slices, number, letter, tile_row * TALL, tile * LANES,
                            offset[angle], share[angle], within[angle],
                        )  # fmt: skip
                        here = log_p[tile_row, tile]
                        # Before the first reading all bins are alike, whatever is stored.
                        before = belief.edge[tile_row, tile] if reading == 0 else here
                        add_tile(here, before, total, terms.constant[reading, letter], 0, LANES, peak[tile])
                for j in range(block_columns):
                    highest = -np.inf
                    for column in range(j * wide, min(columns, (j + 1) * wide)):
                        highest = max(highest, peak[column // LANES, column % LANES])
                    upper[i, j] = highest - terms.upper[count]
            belief.summit[letter, angle] = upper.max()
    belief.seen[:] = count
    belief.bounded[:] = count
