"""Upper bounds of bins from maxima of the tables, read without interpolation (compiled)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, uint64, void

from tactsim.core.compiling import (
    FLOATS,
    INTS,
    INTS_2D,
    INTS_4D,
    REALS,
    REALS_2D,
    REALS_4D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL, add_times, load, store, zeros
from tactsim.estimators.filters.branch_and_bound import BELIEF, Belief, least_age


class BinMaxima(NamedTuple):
    """The largest values that a bin can read from the tables, wherever it lies between two lattice points.

    highest: flat, (tables, letters, phases_y, phases_x, rows, LANES + columns) and LANES zeros. Lattice points are one
    bin apart; a phase is a part of the way to the next. Column LANES + 1 and row 1 are of the point at the first node.
    The first and last row and the first LANES columns are 0, as tables are outside. start: (2, phases) the first node
    of each phase after a point, in y and x. shape: of `highest`. place: [x, y] of the first bin less that of the first
    node, and the steps between nodes, mm. step: nodes from bin to bin in y and x.
    """

    highest: Floats
    start: Ints
    shape: Ints
    place: Reals
    step: Ints


BIN_MAXIMA = types.NamedTuple((FLOATS, INTS_2D, INTS, REALS, INTS), BinMaxima)


class Ceiling(NamedTuple):
    """Upper bounds of all bins.

    upper: (letters, angles, rows, columns), whole tiles; as `Belief.upper` for each bin. since: (letters, angles, block
    rows, block columns), the reading after which the block's bounds were taken over from its bins.
    """

    upper: Reals
    since: Ints


CEILING = types.NamedTuple((REALS_4D, INTS_4D), Ceiling)


@compiled(void(TERMS, int64, BIN_MAXIMA, float64, float64, INTS_2D, INTS_2D), called_from_python=False)
def place_maxima(
    terms: Terms, reading: int, maxima: BinMaxima, cos: float, sin: float, row: Ints, column: Ints
) -> None:
    """Find where the bins of one angle look up a reading's terms.

    Fills row (terms, rows of bins), the flat index of a row of the first letter's maxima, and column (terms, tile
    columns), which is added to it.
    """
    letters, phases_y, phases_x, rows, width = maxima.shape[1:]
    begin, place, step = terms.start[reading], maxima.place, maxima.step
    for i in range(terms.start[reading + 1] - begin):
        x, y = terms.xy[begin + i, 0], terms.xy[begin + i, 1]
        u = min(max((cos * x - sin * y + place[0]) / place[2], -1e9), 1e9)
        v = min(max((sin * x + cos * y + place[1]) / place[3], -1e9), 1e9)
        across, up = int64(math.floor(u)), int64(math.floor(v))
        left, below = int64(math.floor(across / step[1])), int64(math.floor(up / step[0]))
        across, up, below = across - left * step[1], up - below * step[0], below + 2
        phase_x, phase_y = phases_x - 1, phases_y - 1
        while maxima.start[1, phase_x] > across:
            phase_x -= 1
        while maxima.start[0, phase_y] > up:
            phase_y -= 1
        base = ((terms.kind[begin + i] * letters * phases_y + phase_y) * phases_x + phase_x) * rows * width
        for k in range(row.shape[1]):
            row[i, k] = base + min(max(below + k, 0), rows - 1) * width
        for k in range(column.shape[1]):
            column[i, k] = min(max(left + 1 + k * LANES, -LANES), width - LANES) + LANES


@compiled(
    void(REALS_2D, REALS, FLOATS, REALS, float64, float64, REALS, uint64, uint64, uint64),
    ordered=False,
    called_from_python=False,
)
def take_in(
    upper: Reals, log_p: Reals, total: Floats, state: Reals, gain: float, any_state: float, peak: Reals,
    first_row: int, lane: int, at: int,
) -> None:  # fmt: skip
    """Add a reading to the bounds of a tile of bins; raise `peak` to them.

    The tile begins at the row `first_row` and column `lane` of upper (rows, columns), and at `at` in log_p, which is
    flat. state: (columns,) 0 for bins that stay as they are, 1 for those whose bounds take it in, 2 for those whose
    log-beliefs do.
    """
    for r in range(uint64(TALL)):
        for k in range(uint64(LANES)):
            now, kind = upper[first_row + r, lane + k], state[lane + k]
            before = log_p[at + r * uint64(LANES) + k] - any_state if kind > 1.5 else now
            now = before + (total[r * uint64(LANES) + k] + gain) if kind > 0.5 else now
            upper[first_row + r, lane + k] = now
            peak[lane + k] = max(peak[lane + k], now)


@compiled(
    int64(
        BELIEF, CEILING, BIN_MAXIMA, TERMS, int64, int64, int64, float64, FLOATS, REALS, REALS,
        INTS_2D, INTS_2D,
    ),
    called_from_python=False,
)  # fmt: skip
def lower_angle(
    belief: Belief, ceiling: Ceiling, maxima: BinMaxima, terms: Terms, letter: int, angle: int, reading: int,
    below: float, total: Floats, state: Reals, peak: Reals, row: Ints, column: Ints,
) -> int:  # fmt: skip
    """Let the bins of one letter and angle take in a reading, in the blocks above `below` that took in all before it.

    state, peak: (columns,) room. Returns how many blocks did.
    """
    block_rows, block_columns = belief.upper.shape[2:]
    columns, tall, wide = belief.size[1], belief.size[2], belief.size[3]
    upper, bounded, seen = (
        belief.upper[letter, angle],
        belief.bounded[letter, angle],
        belief.seen[letter, angle],
    )
    bins, since = ceiling.upper[letter, angle], ceiling.since[letter, angle]
    log_p = belief.log_p[letter, angle].reshape(belief.log_p[letter, angle].size)
    begin, evaluated, highest = terms.start[reading], 0, maxima.highest
    number = terms.start[reading + 1] - begin
    move = letter * maxima.shape[2] * maxima.shape[3] * maxima.shape[4] * maxima.shape[5]
    # What any state may have gained is taken back: it is for the readings that were not taken in.
    gain = terms.slack[reading] - (terms.upper[reading + 1] - terms.upper[reading])
    gain += terms.constant[reading, letter]
    for i in range(block_rows):
        chosen = 0
        for j in range(block_columns):
            wanted = bounded[i, j] == reading and upper[i, j] > below
            # Bins that are themselves up to date have no better bound.
            exact = wanted and seen[i, j] == reading and since[i, j] < reading
            for c in range(j * wide, min(columns, (j + 1) * wide)):
                state[c] = 2.0 if exact else (1.0 if wanted else 0.0)
            if wanted:
                since[i, j] = reading if exact else since[i, j]
                bounded[i, j] = reading + 1
                chosen += 1
        if not chosen:
            continue
        evaluated += chosen
        peak[:] = -np.inf
        for tile_row in range(i * tall // TALL, min(belief.log_p.shape[2], (i + 1) * tall // TALL)):
            first_row = tile_row * TALL
            for tile in range(column.shape[1]):
                first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
                for k in range(number):
                    weight, to = terms.weight[begin + k], column[k, tile] + move
                    first = add_times(first, weight, load(highest, row[k, first_row] + to))
                    second = add_times(second, weight, load(highest, row[k, first_row + 1] + to))
                    third = add_times(third, weight, load(highest, row[k, first_row + 2] + to))
                    fourth = add_times(fourth, weight, load(highest, row[k, first_row + 3] + to))
                store(total, 0, first)
                store(total, LANES, second)
                store(total, 2 * LANES, third)
                store(total, 3 * LANES, fourth)
                lane, at = uint64(tile * LANES), uint64((tile_row * column.shape[1] + tile) * TALL * LANES)
                take_in(
                    bins, log_p, total, state, gain, terms.upper[reading], peak, uint64(first_row), lane, at
                )
        for j in range(block_columns):
            if state[j * wide] > 0:
                upper[i, j] = peak[j * wide : min(columns, (j + 1) * wide)].max()
    return evaluated


@compiled(int64(BELIEF, CEILING, BIN_MAXIMA, TERMS, REALS_2D, int64, int64, float64))
def lower(
    belief: Belief, ceiling: Ceiling, maxima: BinMaxima, terms: Terms, turns: Reals, count: int, longest: int,
    floor: float,
) -> int:  # fmt: skip
    """Lower the upper bounds of the blocks that are above `floor`, with what each of their bins can have got at most.

    A block whose upper bound falls to `floor` on the way takes in no further reading. turns: (angles, 2) cos and sin.
    longest: terms of the longest reading. Returns how many times a block took in a reading.
    """
    letters, angles, block_rows, block_columns = belief.upper.shape
    rows, tiles = ceiling.upper.shape[2], ceiling.upper.shape[3] // LANES
    row = np.empty((angles, longest, rows), dtype=np.int64)
    column = np.empty((angles, longest, tiles), dtype=np.int64)
    old_row, old_column = (
        np.empty((longest, rows), dtype=np.int64),
        np.empty((longest, tiles), dtype=np.int64),
    )
    total, peak = np.empty(TALL * LANES, dtype=np.float32), np.empty(tiles * LANES)
    state = np.zeros(tiles * LANES)
    below, newest, evaluated, placed = floor - terms.upper[count], count - 1, 0, False
    # Earlier readings are of few blocks: an angle's terms are placed once for all letters.
    # Only readings that a block waits for are visited: one that was left alone may be thousands behind.
    waits_for = np.empty(letters, dtype=np.int64)
    for angle in range(angles):
        for letter in range(letters):
            upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
            waits_for[letter] = newest
            if belief.summit[letter, angle] > below:
                waits_for[letter] = least_age(upper, bounded, 0, block_rows, 0, block_columns, below)
        while waits_for.min() < newest:
            reading = waits_for.min()
            place_maxima(terms, reading, maxima, turns[angle, 0], turns[angle, 1], old_row, old_column)
            for letter in range(letters):
                if waits_for[letter] == reading:
                    evaluated += lower_angle(
                        belief, ceiling, maxima, terms, letter, angle, reading, below, total, state, peak,
                        old_row, old_column,
                    )  # fmt: skip
                    upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
                    waits_for[letter] = least_age(upper, bounded, 0, block_rows, 0, block_columns, below)
    # The newest reading is for most of them: a letter's maxima are read for all its angles while they are at hand.
    for letter in range(letters):
        for angle in range(angles):
            if belief.summit[letter, angle] <= below:
                continue
            if not placed:
                for every in range(angles):
                    place_maxima(
                        terms, newest, maxima, turns[every, 0], turns[every, 1], row[every], column[every]
                    )
                placed = True
            evaluated += lower_angle(
                belief,
                ceiling,
                maxima,
                terms,
                letter,
                angle,
                newest,
                below,
                total,
                state,
                peak,
                row[angle],
                column[angle],
            )
            belief.summit[letter, angle] = belief.upper[letter, angle].max()
    return evaluated
