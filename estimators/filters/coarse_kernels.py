"""All coarse bins after a reading, as far as they can be among the best: the others wait (compiled).

Each bin has an upper bound, and bounds are summed for a tile of bins at a time. A bin that need not wait takes in the
readings that it waited for by itself, as a state anywhere does: what it gets is the same to the bit as without waiting.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float32, float64, int64, types, uint64, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.replay import SAMPLED, Sampled, replay
from tactsim.estimators.field.slices import LAYOUT, Layout
from tactsim.estimators.field.table_levels import LEVELS, Levels
from tactsim.estimators.field.terms import ROUNDING, TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.coarse_bounds import COARSE, Coarse, bound_all
from tactsim.estimators.filters.halving import unravelled

# A tile for so many of the best bins is looked at first, or so many times as many once likely bins were evaluated; and
# how many times as many each time after that.
_NEIGHBOURS, _AFTER_LIKELY, _MORE = 10, 4, 2
# So many bins catch up at once, with some 90 bytes each.
_BINS = 2**16
# By these a bound of either sign is raised by more than one operation in float32 rounds.
_LESS, _GREATER = np.float32(1 - 2 * ROUNDING), np.float32(1 + 2 * ROUNDING)


@compiled(void(REALS, float64), called_from_python=False)
def replace_least(kept: Reals, value: float) -> None:
    """Put a value in the place of the least of `kept` if it is higher.

    kept: (n,) the highest so far, a heap: [i] is not above [2 i + 1] and [2 i + 2].
    """
    if value <= kept[0]:
        return
    place = 0
    while True:
        below = 2 * place + 1
        if below + 1 < len(kept) and kept[below + 1] < kept[below]:
            below += 1
        if below >= len(kept) or value <= kept[below]:
            break
        kept[place] = kept[below]
        place = below
    kept[place] = value


@compiled(float64(COARSE, int64, float64), called_from_python=False)
def bound_of_highest(coarse: Coarse, tiles: int, least: float) -> float:
    """Give the least of the bounds of so many tiles, those with the highest bounds; `least` if that is higher."""
    kept = np.full(tiles, least)
    for bound in coarse.bound:
        if bound > least:
            replace_least(kept, bound)
    return float(kept[0])


@compiled(INTS(COARSE, float64), called_from_python=False)
def bounded_by(coarse: Coarse, least: float) -> Ints:
    """List the bins whose bound is at least `least`, by their places in `Coarse.upper`, ascending."""
    number = 0
    for tile in range(len(coarse.bound)):
        if coarse.bound[tile] >= least:
            for bound in coarse.upper[tile]:
                number += float64(bound) >= least and bound > -np.inf
    # One more, where what is not listed is written and overwritten: no processor foresees which are.
    place, found = np.empty(number + 1, dtype=np.int64), uint64(0)
    for tile in range(len(coarse.bound)):
        if coarse.bound[tile] >= least:
            for k in range(TALL * LANES):
                bound = coarse.upper[tile, k]
                place[found] = tile * TALL * LANES + k
                found += uint64((float64(bound) >= least) & (bound > -np.inf))
    return place[:number]


@compiled(INTS(INTS, INTS), called_from_python=False)
def merged(one: Ints, other: Ints) -> Ints:
    """Merge two ascending lists of numbers (n,) and (m,)."""
    both, i, j = np.empty(len(one) + len(other), dtype=np.int64), 0, 0
    for k in range(len(both)):
        if j == len(other) or (i < len(one) and one[i] < other[j]):
            both[k] = one[i]
            i += 1
        else:
            both[k] = other[j]
            j += 1
    return both


@compiled(types.UniTuple(int64, 4)(COARSE, int64), called_from_python=False)
def corner_of(coarse: Coarse, tile: int) -> tuple[int, int, int, int]:
    """Find letter, angle, row and column of the first bin of a tile."""
    columns, rows, angles = coarse.counts
    letter, angle, row, column = unravelled(tile, -(-columns // LANES), -(-rows // TALL), angles)
    return letter, angle, row * TALL, column * LANES


@compiled(INTS(COARSE, INTS), called_from_python=False)
def bins_at(coarse: Coarse, place: Ints) -> Ints:
    """Find the flat indices into (letters, angles, rows, columns) of bins at places (n,) in `Coarse.upper`."""
    columns, rows, angles = coarse.counts
    flat, last, first = np.empty_like(place), -1, 0
    for i in range(len(place)):
        tile, k = place[i] // (TALL * LANES), place[i] % (TALL * LANES)
        if tile != last:
            # Bins of a tile mostly follow each other, and divisions take long.
            letter, angle, row, column = corner_of(coarse, tile)
            last, first = tile, ((letter * angles + angle) * rows + row) * columns + column
        flat[i] = first + k // LANES * columns + k % LANES
    return flat


@compiled(void(REALS_2D, INTS, COARSE, INTS), called_from_python=False)
def states_at(state: Reals, letter: Ints, coarse: Coarse, place: Ints) -> None:
    """Find T_R^O in the middle of bins, and their letters; fills state (3, n) mm, mm, rad, and letter (n,).

    place: (n,) in `Coarse.upper`.
    """
    spacing, last, of, angle, row, column = coarse.spacing, -1, 0, 0, 0, 0
    columns, rows, angles = coarse.counts
    for i in range(len(place)):
        tile, k = place[i] // (TALL * LANES), place[i] % (TALL * LANES)
        if tile != last:
            last = tile
            of, angle, row, column = corner_of(coarse, tile)
        letter[i] = of
        state[0, i] = (column + k % LANES + 0.5 - columns / 2) * spacing[0]
        state[1, i] = (row + k // LANES + 0.5 - rows / 2) * spacing[1]
        state[2, i] = (angle + 0.5 - angles / 2) * spacing[2]


@compiled(int64(COARSE, INTS, TERMS, SAMPLED, int64), called_from_python=False)
def catch_up(coarse: Coarse, place: Ints, terms: Terms, sampled: Sampled, count: int) -> int:
    """Let bins take in all of `count` readings, and return how many times one did.

    place: (n,) their places in `Coarse.upper`.
    """
    seen, log_p = coarse.seen.reshape(coarse.seen.size), coarse.log_p.reshape(coarse.log_p.size)
    if seen[place].min() < seen[place].max():
        # Of those that waited longest first.
        place = place[np.argsort(seen[place], kind="mergesort")]
    bins, state = len(place), np.empty((3, len(place)))
    letter, here, evaluated = np.empty(bins, dtype=np.int64), log_p[place], 0
    states_at(state, letter, coarse, place)
    # The first so many bins have all seen the same readings.
    alike = 0
    while alike < bins:
        first = seen[place[alike]]
        while alike < bins and seen[place[alike]] == first:
            alike += 1
        last = count if alike == bins else seen[place[alike]]
        replay(here[:alike], state[:, :alike].copy(), letter[:alike], terms, first, last, sampled)
        evaluated += alike * (last - first)
    for i in range(bins):
        log_p[place[i]], seen[place[i]] = here[i], count
    return evaluated


@compiled(types.Tuple((float64, int64))(COARSE, INTS, TERMS, SAMPLED, int64, REALS), called_from_python=False)
def wait_no_longer(
    coarse: Coarse, place: Ints, terms: Terms, sampled: Sampled, count: int, kept: Reals
) -> tuple[float, int]:
    """Let bins take in all of `count` readings, and leave them out of the bounds until they get one again.

    place: (n,) their places in `Coarse.upper`, ascending. kept: the highest log-beliefs so far, as `replace_least`
    takes them. Returns the highest log-belief of these bins, and how many times one took in a reading.
    """
    upper, log_p = coarse.upper.reshape(coarse.upper.size), coarse.log_p.reshape(coarse.log_p.size)
    best, evaluated, last = -np.inf, 0, -1
    for begin in range(0, len(place), _BINS):
        evaluated += catch_up(coarse, place[begin : begin + _BINS], terms, sampled, count)
    for i in place:
        best = max(best, log_p[i])
        replace_least(kept, log_p[i])
        upper[i] = -np.inf
    for i in place:
        tile = i // (TALL * LANES)
        if tile != last:
            coarse.bound[tile] = float64(coarse.upper[tile].max())
        last = tile
    return best, evaluated


@compiled(
    types.Tuple((INTS, REALS, float64, int64, INTS))(
        COARSE, LEVELS, LAYOUT, TERMS, SAMPLED, REALS_2D, int64, int64, boolean, int64, float64, float64, INTS
    )
)
def best_bins(
    coarse: Coarse, levels: Levels, layout: Layout, terms: Terms, sampled: Sampled, turns: Reals, first: int,
    count: int, skip: bool, keep: int, within: float, rounding: float, likely: Ints,
) -> tuple[Ints, Reals, float, int, Ints]:  # fmt: skip
    """Take in readings number first + 1, ..., `count`, one at least, and list the bins that matter.

    turns: (angles, 2) cos and sin. skip: whether bins may wait. Listed are all bins at most `within` nats below the
    best, and in any case the best `keep` and one more; up to `rounding` nats further, for the sake of equal ones.
    likely: places in `Coarse.upper`, ascending, of bins that are evaluated first if bins may wait; any will do.

    Returns flat indices and log-beliefs, a bound of all bins that wait, how many times a bin took in a reading, and the
    places of the best `keep` and one more, which are likely to be among the best after the next reading; none if too
    many are equal to the last of them.
    """
    known, evaluated, more = np.empty(0, dtype=np.int64), 0, 1 + keep // _NEIGHBOURS
    kept, best = np.full(keep + 1, -np.inf), -np.inf
    if skip:
        for reading in range(first, count):
            bound_all(coarse, levels, layout, terms, turns, reading)
        if len(likely):
            best, evaluated = wait_no_longer(coarse, likely, terms, sampled, count, kept)
            known, more = likely, more * _AFTER_LIKELY
    while True:
        waits = -np.inf
        for bound in coarse.bound:
            waits = max(waits, bound)
        least = best - within - rounding
        if not kept[0] >= least > -np.inf:
            # Fewer than asked for are as near the best: what matters is the last of the best `keep` and one more.
            least = kept[0] - rounding
            if skip and waits >= least:
                # Until enough are known, more and more of the tiles with the highest bounds are looked at.
                least, more = bound_of_highest(coarse, more, least), more * _MORE
        if waits < least or waits == -np.inf:
            break
        place = bounded_by(coarse, least)
        if not len(place):
            break  # a log-belief is no number
        best_here, evaluated_here = wait_no_longer(coarse, place, terms, sampled, count, kept)
        best, evaluated = max(best, best_here), evaluated + evaluated_here
        known = merged(known, place)
    upper, log_p = coarse.upper.reshape(coarse.upper.size), coarse.log_p.reshape(coarse.log_p.size)
    for i in known:
        value = float32(log_p[i])
        upper[i] = value * (_LESS if value < 0 else _GREATER)
        coarse.bound[i // (TALL * LANES)] = max(coarse.bound[i // (TALL * LANES)], float64(upper[i]))
    known = known[log_p[known] >= least]
    likely = known[log_p[known] >= kept[0]]
    if len(likely) > 2 * len(kept):
        likely = likely[:0]
    return bins_at(coarse, known), log_p[known], waits, evaluated, likely
