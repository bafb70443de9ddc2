"""All coarse bins after a reading, as far as they can be among the best: the others wait (compiled).

Each bin of a tile that waits has an upper bound of its own. What is evaluated is what `every_bin` gives, to the bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, float64, int64, types, uint8, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import (
    FLOATS,
    FLOATS_4D,
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
from tactsim.estimators.field.table_levels import (
    HIGHEST,
    LEVELS,
    Levels,
    Looked,
    look_up,
    raise_alike,
    raise_weighted,
)
from tactsim.estimators.field.terms import ROUNDING, TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL, fetch
from tactsim.estimators.filters.branch_and_bound import add_tile

# A tile for so many of the best bins is looked at first; and how many times as many tiles each time after that.
_NEIGHBOURS, _MORE = 10, 2
# Bytes that are fetched together.
_LINE = 64
# By these a bound of either sign is raised by more than one operation in float32 rounds.
_LESS, _GREATER = np.float32(1 - 2 * ROUNDING), np.float32(1 + 2 * ROUNDING)


class Coarse(NamedTuple):
    """The log-belief of all bins in tiles (letters, angles, tile rows, tile columns), some of which wait.

    log_p: (..., TALL * LANES), a bin's log-belief after the first `seen` readings; -inf where a tile hangs over the
    grid. upper: likewise, float32, not below what a bin's log-belief is after all readings. seen: (...). bound: (...)
    the highest `upper` of a tile that waits; the highest bin of one that does not. bins: (tile rows, tile columns) how
    many bins a tile holds. size: rows and columns of bins.
    """

    log_p: Reals
    upper: Floats
    seen: Ints
    bound: Reals
    bins: Ints
    size: Ints


COARSE = types.NamedTuple((REALS_5D, float32[:, :, :, :, ::1], INTS_4D, REALS_4D, INTS_2D, INTS), Coarse)


class Placed(NamedTuple):
    """The terms of the last readings as `place_terms` places them for every angle: (slots, angles, terms, 4) each.

    Reading r is in the slot r modulo their number, less the last slot. That one is for older readings, one at a time.
    """

    offset: Ints
    share: Floats
    within: Ints


PLACED = types.NamedTuple((INTS_4D, FLOATS_4D, INTS_4D), Placed)


@compiled(void(PLACED, int64, TERMS, int64, SLICES, REALS_2D, int64, COARSE), called_from_python=False)
def place(
    placed: Placed, slot: int, terms: Terms, reading: int, slices: Slices, turns: Reals, angle: int, coarse: Coarse
) -> None:  # fmt: skip
    """Place the terms of a reading for one angle, in a slot."""
    place_terms(
        terms, reading, slices, turns[angle, 0], turns[angle, 1], coarse.size[0], coarse.size[1],
        placed.offset[slot, angle], placed.share[slot, angle], placed.within[slot, angle],
    )  # fmt: skip


@compiled(void(FLOATS, REALS), called_from_python=False, ordered=False)
def set_bounds(upper: Floats, log_p: Reals) -> None:
    """Set the bounds of a tile (TALL * LANES,) to the bins' log-beliefs, rounded up."""
    for k in range(uint64(TALL * LANES)):
        known = float32(log_p[k])
        upper[k] = known * (_LESS if known < 0 else _GREATER)


@compiled(void(uint8[::1], INTS, int64, int64, int64, int64, int64), called_from_python=False)
def fetch_part(
    level: NDArray[np.uint8], kinds: Ints, table: int, letter: int, nodes: int, part: int, parts: int
) -> None:
    """Begin to fetch one of so many parts of a letter's bounds: `nodes` bytes of each of some tables.

    table: bytes from a table to the next.

    No processor foresees where tiles of all angles look up bounds. So a letter's are fetched in order while those of
    the letter before are summed.
    """
    size = (nodes // _LINE) // parts + 1
    for kind in kinds:
        first = kind * table + letter * nodes
        for line in range(part * size, min(nodes // _LINE + 1, (part + 1) * size)):
            fetch(level, first + line * _LINE)  # type: ignore[call-arg]


@compiled(void(COARSE, LEVELS, SLICES, TERMS, PLACED, int64), called_from_python=False)
def bound_all(
    coarse: Coarse, levels: Levels, slices: Slices, terms: Terms, placed: Placed, count: int
) -> None:
    """Let the upper bounds of all bins take in reading number `count`."""
    letters, angles, rows, columns = coarse.seen.shape
    tiles, longest = angles * rows * columns, placed.offset.shape[2]
    slot = (count - 1) % (len(placed.offset) - 1)
    looked = Looked(
        np.empty((tiles, longest), dtype=np.int64),
        np.empty((tiles, longest), dtype=np.int64),
        np.empty((tiles, longest), dtype=np.int64),
        np.empty(tiles, dtype=np.int64),
        np.empty((tiles, LANES), dtype=np.float32),
    )
    width, nodes = slices.shape[5], slices.shape[2] * slices.shape[3] * slices.plane
    kinds = np.unique(terms.kind[terms.start[count - 1] : terms.start[count]])
    for angle in range(angles):
        fetch_part(levels.level, kinds, slices.table, 0, nodes, angle, angles)
        look_up(
            looked, levels, slices, terms, count - 1, angle * rows * columns, rows, columns,
            placed.offset[slot, angle], placed.within[slot, angle],
        )  # fmt: skip
    weights = terms.weight[terms.start[count - 1] : terms.start[count]]
    heaviest, lightest = np.float32(0), np.float32(np.inf)
    for weight in weights:
        heaviest, lightest = max(heaviest, weight), min(lightest, weight)
    factor = levels.step[0] * heaviest
    # What float32 may lose of the sums of levels and of lowest values, which are at most HIGHEST steps below 0.
    slack = terms.slack[count - 1] + (len(weights) + 6) * ROUNDING * len(weights) * HIGHEST * factor
    for letter in range(letters):
        upper = coarse.upper[letter].reshape(tiles, TALL * LANES)
        bound = coarse.bound[letter].reshape(tiles)
        for tile in range(tiles):
            if letter + 1 < letters:
                fetch_part(levels.level, kinds, slices.table, letter + 1, nodes, tile, tiles)
            constant = terms.constant[count - 1, letter]
            constant += slack + 4 * ROUNDING * abs(constant)
            here, move = upper[tile], letter * nodes
            if heaviest == lightest:
                bound[tile] = raise_alike(here, levels, looked, tile, move, width, factor, constant)
            else:
                bound[tile] = raise_weighted(here, levels, looked, tile, move, width, terms.weight, constant)


@compiled(void(REALS, REALS), called_from_python=False)
def keep_highest(kept: Reals, log_p: Reals) -> None:
    """Put what is higher than the least of `kept` in its place, from log_p (bins,).

    kept: (n,) the highest so far, a heap: [i] is not above [2 i + 1] and [2 i + 2].
    """
    for k in range(len(log_p)):
        value, place = log_p[k], 0
        if value <= kept[0]:
            continue
        while True:
            below = 2 * place + 1
            if below + 1 < len(kept) and kept[below + 1] < kept[below]:
                below += 1
            if below >= len(kept) or value <= kept[below]:
                break
            kept[place] = kept[below]
            place = below
        kept[place] = value


@compiled(
    int64(COARSE, SLICES, TERMS, REALS_2D, PLACED, int64, int64, float64, REALS),
    called_from_python=False,
)
def catch_up(
    coarse: Coarse, slices: Slices, terms: Terms, turns: Reals, placed: Placed, oldest: int, count: int,
    least: float, kept: Reals,
) -> int:  # fmt: skip
    """Bring the tiles up to date whose bound is at least `least`; returns how many times a bin took in a reading.

    oldest: the first reading that is in its slot. kept: see `keep_highest`. All that a letter's tiles wait for is done
    before the next letter, so that its tables are read while they are in the cache.
    """
    letters, angles, tile_rows, tile_columns = coarse.seen.shape
    slots, evaluated = len(placed.offset) - 1, 0
    total, peak = np.empty(TALL * LANES, dtype=np.float32), np.empty(LANES)
    for letter in range(letters):
        for angle in range(angles):
            for i in range(tile_rows):
                for j in range(tile_columns):
                    first = coarse.seen[letter, angle, i, j]
                    if first == count or coarse.bound[letter, angle, i, j] < least:
                        continue
                    here = coarse.log_p[letter, angle, i, j]
                    for reading in range(first, count):
                        slot = reading % slots
                        if reading < oldest:
                            slot = slots
                            place(placed, slot, terms, reading, slices, turns, angle, coarse)
                        sum_tile(
                            total, slices, terms.start[reading + 1] - terms.start[reading], letter,
                            i * TALL, j * LANES,
                            placed.offset[slot, angle], placed.share[slot, angle], placed.within[slot, angle],
                        )  # fmt: skip
                        peak[:] = -np.inf
                        add_tile(here, here, total, terms.constant[reading, letter], 0, LANES, peak)
                    set_bounds(coarse.upper[letter, angle, i, j], here)
                    coarse.seen[letter, angle, i, j] = count
                    coarse.bound[letter, angle, i, j] = peak.max()
                    if coarse.bound[letter, angle, i, j] > kept[0]:
                        keep_highest(kept, here)
                    evaluated += coarse.bins[i, j] * (count - first)
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
    """Give the least of the bounds of so many tiles, those with the highest bounds of all that are not up to date.

    -inf if there are fewer.
    """
    seen, bound = coarse.seen.reshape(coarse.seen.size), coarse.bound.reshape(coarse.bound.size)
    kept = np.full(tiles, -np.inf)
    for k in range(len(seen)):
        if seen[k] != count and bound[k] > kept[0]:
            keep_highest(kept, bound[k : k + 1])
    return float(kept[0])


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
        COARSE, LEVELS, SLICES, TERMS, REALS_2D, PLACED, int64, int64, int64, boolean, int64, float64, float64
    )
)
def best_bins(
    coarse: Coarse, levels: Levels, slices: Slices, terms: Terms, turns: Reals, placed: Placed, oldest: int,
    first: int, count: int, skip: bool, keep: int, within: float, rounding: float,
) -> tuple[Ints, Reals, int]:  # fmt: skip
    """Take in readings number first + 1, ..., `count`, one at least, and list the bins that matter.

    turns: (angles, 2) cos and sin. oldest: the first reading that is in its slot of `placed`, or is now put there.
    skip: whether tiles may wait. Listed are all bins at most `within` nats below the best, and in any case the best
    `keep` and one more; up to `rounding` nats further, for the sake of equal ones. Returns flat indices and
    log-beliefs, and how many times a bin took in a reading.
    """
    # After one reading most bins are still as near to the best as is asked for: bounds would cost more than they save.
    bounded = skip and count > 1
    for reading in range(first, count):
        for angle in range(len(turns)):
            place(placed, reading % (len(placed.offset) - 1), terms, reading, slices, turns, angle, coarse)
        if bounded:
            bound_all(coarse, levels, slices, terms, placed, reading + 1)
    evaluated, more = 0, 1 + keep // _NEIGHBOURS
    kept = np.full(keep + 1, -np.inf)
    if not bounded:
        coarse.bound[:] = np.inf
        evaluated += catch_up(coarse, slices, terms, turns, placed, oldest, count, -np.inf, kept)
    while True:
        best, waits = highest_bounds(coarse, count)
        least = best - within - rounding
        enough = kept[0] >= least > -np.inf
        if not enough:
            # Fewer than asked for are as near the best: what matters is the last of the best `keep` and one more.
            least = kept[0] - rounding
        if waits == -np.inf or waits < least:
            flat, log_p = listed(coarse, count, least)
            return flat, log_p, evaluated
        # Until enough are known, more and more of the tiles with the highest bounds are looked at.
        if not enough:
            least = max(least, bound_of_highest(coarse, count, more))
        evaluated += catch_up(coarse, slices, terms, turns, placed, oldest, count, least, kept)
        more *= _MORE
