"""All coarse bins after a reading, as far as they can be among the best: the others wait (compiled).

Each bin of a tile that waits has an upper bound of its own. What is evaluated is what `every_bin` gives, to the bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, types, void

from tactsim.core.compiling import (
    FLOATS_3D,
    INTS,
    INTS_2D,
    INTS_4D,
    REALS,
    REALS_2D,
    REALS_4D,
    REALS_5D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.slices import SLICES, Slices, place_terms, sum_tile
from tactsim.estimators.field.table_levels import LEVELS, Levels, bound_tile
from tactsim.estimators.field.terms import ROUNDING, TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.branch_and_bound import add_tile

# So many tiles are looked at one by one, those with the highest bounds first, to find a bin that is nearly the best.
_FIRST = 4


class Coarse(NamedTuple):
    """The log-belief of all bins in tiles (letters, angles, tile rows, tile columns), some of which wait.

    log_p: (..., TALL * LANES), a bin's log-belief after the first `seen` readings; -inf where a tile hangs over the
    grid. waiting: likewise, a bound of what the readings since then add. seen: (...). bound: (...) not below any bin of
    the tile; its highest bin if it does not wait. bins: (tile rows, tile columns) how many bins a tile holds. size:
    rows and columns of bins.
    """

    log_p: Reals
    waiting: Reals
    seen: Ints
    bound: Reals
    bins: Ints
    size: Ints


COARSE = types.NamedTuple((REALS_5D, REALS_5D, INTS_4D, REALS_4D, INTS_2D, INTS), Coarse)


class Placed(NamedTuple):
    """The terms of one reading as `place_terms` places them for every angle: (angles, terms, 4) each."""

    offset: Ints
    share: Floats
    within: Ints


PLACED = types.NamedTuple((int64[:, :, ::1], FLOATS_3D, int64[:, :, ::1]), Placed)


@compiled(void(COARSE, LEVELS, SLICES, TERMS, PLACED, int64), called_from_python=False)
def bound_all(
    coarse: Coarse, levels: Levels, slices: Slices, terms: Terms, placed: Placed, count: int
) -> None:
    """Let the upper bounds of all bins take in reading number `count`."""
    letters, angles, tile_rows, tile_columns = coarse.seen.shape
    begin, number = terms.start[count - 1], terms.start[count] - terms.start[count - 1]
    factor, lowest = np.empty(number, dtype=np.float32), np.empty(number)
    most = 0.0
    for i in range(number):
        kind = terms.kind[begin + i]
        factor[i], lowest[i] = (
            terms.weight[begin + i] * levels.step[kind],
            terms.weight[begin + i] * levels.lowest[kind],
        )
        most += 256.0 * factor[i]
    # Both the bound and the sum that it bounds are float32.
    slack = terms.slack[count - 1] + (number + 2) * ROUNDING * most
    total = np.empty(TALL * LANES, dtype=np.float32)
    for letter in range(letters):
        constant = terms.constant[count - 1, letter] + slack
        for angle in range(angles):
            for i in range(tile_rows):
                for j in range(tile_columns):
                    added = constant + bound_tile(
                        total, levels, slices, number, letter, i * TALL, j * LANES,
                        placed.offset[angle], factor, lowest, placed.within[angle],
                    )  # fmt: skip
                    log_p, waiting = coarse.log_p[letter, angle, i, j], coarse.waiting[letter, angle, i, j]
                    highest = -np.inf
                    for k in range(TALL * LANES):
                        waiting[k] += added + total[k]
                        highest = max(highest, log_p[k] + waiting[k])
                    coarse.bound[letter, angle, i, j] = highest


@compiled(
    int64(COARSE, SLICES, TERMS, REALS_2D, PLACED, int64, float64),
    called_from_python=False,
)
def catch_up(
    coarse: Coarse, slices: Slices, terms: Terms, turns: Reals, placed: Placed, count: int, least: float
) -> int:
    """Bring the tiles up to date whose bound is at least `least`; returns how many times a bin took in a reading."""
    letters, angles, tile_rows, tile_columns = coarse.seen.shape
    rows, columns, evaluated = coarse.size[0], coarse.size[1], 0
    total, peak = np.empty(TALL * LANES, dtype=np.float32), np.empty(LANES)
    offset, within = np.empty_like(placed.offset[0]), np.empty_like(placed.within[0])
    share = np.empty_like(placed.share[0])
    # First the readings before the last, each placed once for all tiles of an angle that wait for it.
    for angle in range(angles):
        reading = count - 1
        for letter in range(letters):
            for i in range(tile_rows):
                for j in range(tile_columns):
                    if coarse.bound[letter, angle, i, j] >= least:
                        reading = min(reading, coarse.seen[letter, angle, i, j])
        while reading < count - 1:
            place_terms(
                terms, reading, slices, turns[angle, 0], turns[angle, 1], rows, columns, offset, share, within
            )
            number = terms.start[reading + 1] - terms.start[reading]
            for letter in range(letters):
                for i in range(tile_rows):
                    for j in range(tile_columns):
                        if (
                            coarse.bound[letter, angle, i, j] >= least
                            and coarse.seen[letter, angle, i, j] == reading
                        ):
                            sum_tile(
                                total, slices, number, letter, i * TALL, j * LANES, offset, share, within
                            )
                            here = coarse.log_p[letter, angle, i, j]
                            constant = terms.constant[reading, letter]
                            add_tile(here, here, total, constant, 0, LANES, peak)
                            coarse.seen[letter, angle, i, j] += 1
                            evaluated += coarse.bins[i, j]
            reading += 1
    number = terms.start[count] - terms.start[count - 1]
    for letter in range(letters):
        for angle in range(angles):
            for i in range(tile_rows):
                for j in range(tile_columns):
                    if coarse.bound[letter, angle, i, j] < least or coarse.seen[letter, angle, i, j] == count:
                        continue
                    sum_tile(
                        total, slices, number, letter, i * TALL, j * LANES,
                        placed.offset[angle], placed.share[angle], placed.within[angle],
                    )  # fmt: skip
                    here = coarse.log_p[letter, angle, i, j]
                    peak[:] = -np.inf
                    add_tile(here, here, total, terms.constant[count - 1, letter], 0, LANES, peak)
                    coarse.seen[letter, angle, i, j] = count
                    coarse.waiting[letter, angle, i, j] = 0
                    coarse.bound[letter, angle, i, j] = peak.max()
                    evaluated += coarse.bins[i, j]
    return evaluated


@compiled(types.Tuple((float64, float64))(COARSE, int64), called_from_python=False)
def highest_bounds(coarse: Coarse, count: int) -> tuple[float, float]:
    """Give the highest bin that is up to date, and the highest bound of a tile that is not; -inf if there is none."""
    known = waits = -np.inf
    seen, bound = coarse.seen.reshape(coarse.seen.size), coarse.bound.reshape(coarse.bound.size)
    for k in range(len(seen)):
        if seen[k] == count:
            known = max(known, bound[k])
        else:
            waits = max(waits, bound[k])
    return known, waits


@compiled(float64(COARSE, int64, int64), called_from_python=False)
def bound_of_highest(coarse: Coarse, count: int, tiles: int) -> float:
    """Give the least of the bounds of so many tiles, those with the highest bounds of all that are not up to date."""
    seen, bound = coarse.seen.reshape(coarse.seen.size), coarse.bound.reshape(coarse.bound.size)
    waits = bound[seen != count]
    place = max(0, len(waits) - tiles)
    return float(np.partition(waits, place)[place])


@compiled(types.Tuple((INTS, REALS))(COARSE, int64, float64), called_from_python=False)
def listed(coarse: Coarse, count: int, least: float) -> tuple[Ints, Reals]:
    """List the bins up to date that are at least `least`.

    Returns flat indices into (letters, angles, rows, columns), and log-beliefs.
    """
    letters, angles, tile_rows, tile_columns = coarse.seen.shape
    rows, columns, found = coarse.size[0], coarse.size[1], 0
    seen, bound = coarse.seen.reshape(coarse.seen.size), coarse.bound.reshape(coarse.bound.size)
    room = 0
    for k in range(len(seen)):
        room += TALL * LANES * (seen[k] == count and bound[k] >= least)
    flat, log_p = np.empty(room, dtype=np.int64), np.empty(room)
    for letter in range(letters):
        for angle in range(angles):
            for i in range(tile_rows):
                for j in range(tile_columns):
                    if coarse.seen[letter, angle, i, j] != count or coarse.bound[letter, angle, i, j] < least:
                        continue
                    here, first = (
                        coarse.log_p[letter, angle, i, j],
                        (letter * angles + angle) * rows + i * TALL,
                    )
                    for k in range(TALL * LANES):
                        if here[k] >= least and here[k] > -np.inf:
                            flat[found] = (first + k // LANES) * columns + j * LANES + k % LANES
                            log_p[found] = here[k]
                            found += 1
    return flat[:found], log_p[:found]


@compiled(
    types.Tuple((INTS, REALS, int64))(
        COARSE, LEVELS, SLICES, TERMS, REALS_2D, int64, int64, boolean, int64, float64, float64
    )
)
def best_bins(
    coarse: Coarse, levels: Levels, slices: Slices, terms: Terms, turns: Reals, count: int, longest: int,
    skip: bool, keep: int, within: float, rounding: float,
) -> tuple[Ints, Reals, int]:  # fmt: skip
    """Take in reading number `count`, and list the bins that matter.

    turns: (angles, 2) cos and sin. longest: terms of the longest reading. skip: whether tiles may wait. Listed are all
    bins at most `within` nats below the best, and in any case the best `keep` and one more; up to `rounding` nats
    further, for the sake of equal ones. Returns flat indices and log-beliefs, and how many times a bin took in a
    reading.
    """
    angles, rows, columns = len(turns), coarse.size[0], coarse.size[1]
    placed = Placed(
        np.empty((angles, longest, 4), dtype=np.int64),
        np.empty((angles, longest, 4), dtype=np.float32),
        np.empty((angles, longest, 4), dtype=np.int64),
    )
    for angle in range(angles):
        place_terms(
            terms, count - 1, slices, turns[angle, 0], turns[angle, 1], rows, columns,
            placed.offset[angle], placed.share[angle], placed.within[angle],
        )  # fmt: skip
    # After one reading most bins are still as near to the best as is asked for: bounds would cost more than they save.
    if not skip or count == 1:
        coarse.bound[:] = np.inf
        evaluated = catch_up(coarse, slices, terms, turns, placed, count, -np.inf)
        best = coarse.bound.max()
    else:
        bound_all(coarse, levels, slices, terms, placed, count)
        evaluated, best, waits = 0, -np.inf, coarse.bound.max()
        for _ in range(_FIRST):
            if waits <= best:
                break
            evaluated += catch_up(coarse, slices, terms, turns, placed, count, waits)
            best, waits = highest_bounds(coarse, count)
        evaluated += catch_up(coarse, slices, terms, turns, placed, count, best - within - rounding)
        best, waits = highest_bounds(coarse, count)
    flat, log_p = listed(coarse, count, best - within - rounding)
    if len(log_p) > keep:
        return flat, log_p, evaluated
    # Fewer than asked for are as near the best: what matters is the last of the best `keep` and one more. The tiles
    # with the highest bounds are looked at, more each time, until no other can hold one of these.
    more = 1 + keep // 3  # few of the best bins are neighbours
    while True:
        _, log_p = listed(coarse, count, -np.inf)
        last = len(log_p) - keep - 1
        least = np.partition(log_p, last)[last] - rounding if last >= 0 else -np.inf
        _, waits = highest_bounds(coarse, count)
        if waits == -np.inf or waits < least:
            flat, log_p = listed(coarse, count, least)
            return flat, log_p, evaluated
        evaluated += catch_up(
            coarse, slices, terms, turns, placed, count, max(least, bound_of_highest(coarse, count, more))
        )
        more *= 2
