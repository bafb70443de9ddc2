"""Upper bounds of what a bin reads in tables, in one byte instead of four numbers, and their sums for tiles (compiled).

A bin reads four neighbouring nodes and interpolates. The largest of the four bounds that; it is kept as the lowest
value of its table and a number of steps, rounded up. A tile's bound is a sum of whole numbers of 16 bits, of which so
many are added up that they cannot overflow.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float32, float64, int64, types, uint8, uint16, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import (
    FLOATS,
    FLOATS_2D,
    INTS,
    INTS_2D,
    REALS,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.slices import LAYOUT, Layout, laid_out, lanes_of, piece, span_within
from tactsim.estimators.field.terms import TERMS, Terms, of_one_place
from tactsim.estimators.field.vectors import (
    DIVISOR,
    LANES,
    LINE,
    TALL,
    VECTOR,
    add_bytes,
    add_products,
    add_where,
    add_words,
    fetch_close,
    highest_lane,
    load_plus,
    no_words,
    plus,
    raised,
    store,
    zeros,
)

# The highest level. 16 bits hold the sum of so many levels; and of what so many entries add, each at most HIGHEST times
# HIGHEST + 1, divided by DIVISOR.
HIGHEST, ALIKE, WEIGHTED = 255, 256, 64


class Levels(NamedTuple):
    """Upper bounds of tables: lowest of the table + step * level, at the flat index of the lower left of four nodes.

    level: flat, uint8, laid out as `Slices.nodes`. lowest: (tables,) nats. step: (1,) nats, the same for all tables.
    """

    level: NDArray[np.uint8]
    lowest: Reals
    step: Reals


LEVELS = types.NamedTuple((uint8[::1], REALS, REALS), Levels)


class Looked(NamedTuple):
    """Where the tiles of all angles look up the bounds of one reading.

    at: (tiles, entries) flat index of the level of the tile's first bin for the first letter. lanes: (tiles, entries)
    bits of the tile's columns that lie in the tables; where there are none, `at` is the table's first. lowest:
    (tiles, LANES) nats, for each column the sum of the lowest values of the tables that it lies in, times their
    weights.
    """

    at: Ints
    lanes: NDArray[np.uint16]
    lowest: Floats


LOOKED = types.NamedTuple((INTS_2D, uint16[:, ::1], FLOATS_2D), Looked)


class Entries(NamedTuple):
    """The terms of one reading as bounds read them: alone, or two of one taxel together.

    term: (entries,) number of the first, counted from the reading's first. table: (entries,) where its table begins in
    `Levels.level`. other: (entries,) how far it is from there to the second's; 0 if there is none. weight,
    other_weight: (entries,) in HIGHEST parts of `heaviest`, rounded up; 0 if there is none. lowest: (entries,) nats,
    the lowest values of their tables, times their weights. heaviest: the greatest weight of an entry. alike: whether
    all weigh as much, and are alone.
    """

    term: Ints
    table: Ints
    other: Ints
    weight: NDArray[np.uint8]
    other_weight: NDArray[np.uint8]
    lowest: Floats
    heaviest: float
    alike: bool


ENTRIES = types.NamedTuple((INTS, INTS, INTS, uint8[::1], uint8[::1], FLOATS, float64, boolean), Entries)


def levels_of(nodes: NDArray[np.int16], unit: float, phases: tuple[int, int]) -> Levels:
    """Bound the nodes (tables, letters, rows, columns) of `Tables`, 0 at their rim, laid out with `phases`."""
    # Outside tables are 0.
    lowest = np.minimum(nodes.min(axis=(1, 2, 3)), 0).astype(np.int64)
    highest = np.maximum(nodes.max(axis=(1, 2, 3)), 0).astype(np.int64)
    step = max(1, -(-int((highest - lowest).max()) // HIGHEST))
    # One by one: the tables may be many.
    levels = (_bounds(table, least, step) for table, least in zip(nodes, lowest, strict=True))
    outside = (-(lowest // step)).astype(np.uint8)
    return Levels(laid_out(levels, nodes.shape, phases, outside), unit * lowest, np.array([unit * step]))


def _bounds(table: NDArray[np.int16], lowest: int, step: int) -> NDArray[np.uint8]:
    """Count the steps from the lowest up to the largest of four nodes for each place (letters, rows, columns)."""
    largest = table.copy()
    largest[..., :-1] = np.maximum(largest[..., :-1], largest[..., 1:])
    largest[..., :-1, :] = np.maximum(largest[..., :-1, :], largest[..., 1:, :])
    # In 16 bits, where differences of numbers with a sign are right without one: tables of many letters are large.
    above = largest.view(np.uint16)
    above -= np.uint16(lowest & 0xFFFF)
    steps = above // np.uint16(step)
    steps += steps * np.uint16(step) < above
    return steps.astype(np.uint8)


@compiled(ENTRIES(LEVELS, LAYOUT, TERMS, int64), called_from_python=False)
def entries_of(levels: Levels, layout: Layout, terms: Terms, reading: int) -> Entries:
    """Find how bounds read the terms of a reading."""
    begin, end = terms.start[reading], terms.start[reading + 1]
    weights, kinds = terms.weight[begin:end], terms.kind[begin:end]
    alike = end == begin or weights.min() == weights.max()
    term, number, i = np.empty(end - begin + 1, dtype=np.int64), 0, 0
    while i < end - begin:
        term[number], number = i, number + 1
        i += 1 if alike else min(2, of_one_place(terms, begin + i, end))
    term[number] = end - begin
    heaviest, weight = 0.0, np.zeros((2, number))
    other, lowest = np.zeros(number, dtype=np.int64), np.zeros(number, dtype=np.float32)
    for k in range(number):
        i, least = term[k], 0.0
        for part in range(term[k + 1] - i):
            weight[part, k] = weights[i + part]
            least += weight[part, k] * levels.lowest[kinds[i + part]]
            other[k] = (kinds[i + part] - kinds[i]) * layout.table
        lowest[k] = least
        heaviest = max(heaviest, weight[0, k] + weight[1, k])
    parts = np.zeros((2, number), dtype=np.uint8)
    if heaviest > 0:
        for k in range(number):
            # Two that are rounded up are HIGHEST + 1 together at most.
            parts[0, k] = math.ceil(weight[0, k] / heaviest * HIGHEST)
            parts[1, k] = math.ceil(weight[1, k] / heaviest * HIGHEST)
    term = term[:number]
    return Entries(term, kinds[term] * layout.table, other, parts[0], parts[1], lowest, heaviest, alike)


@compiled(
    void(LOOKED, ENTRIES, LAYOUT, TERMS, *[int64] * 4, float64, float64, INTS_2D), called_from_python=False
)
def look_up(
    looked: Looked, entries: Entries, layout: Layout, terms: Terms, reading: int, first: int, rows: int, columns: int,
    cos: float, sin: float, pieces: Ints,
) -> None:  # fmt: skip
    """Find where the tiles of one angle look up the bounds of a reading.

    first: number of the angle's first tile. rows, columns: of bins. cos, sin: of the angle. pieces: (5, entries), room.
    """
    width, begin, xy, lowest = layout.shape[5], terms.start[reading], terms.xy, entries.lowest
    count = uint64(len(lowest))
    node, first_column, last_column, first_row, last_row = pieces
    for i in range(count):
        term = begin + entries.term[i]
        here = piece(layout, xy[term, 0], xy[term, 1], cos, sin, rows, columns)
        node[i] = layout.first + entries.table[i] + here.node
        first_column[i], last_column[i] = here.first_column, here.last_column
        first_row[i], last_row[i] = here.first_row, here.last_row
    tile = first
    for row in range(0, rows, TALL):
        for column in range(0, columns, LANES):
            at, lanes, move = looked.at[tile], looked.lanes[tile], row * width + column
            for i in range(count):
                left, right = span_within(first_column[i], last_column[i], column)
                beside = (row + TALL <= first_row[i]) | (row >= last_row[i]) | (left == right)
                lanes[i] = 0 if beside else lanes_of(left, right)
                at[i] = layout.first + entries.table[i] if beside else node[i] + move
            # Two sums, because each has to wait for its last addition.
            even = odd = zeros()  # type: ignore[call-arg, var-annotated]
            pairs = count & ~uint64(1)
            for i in range(uint64(0), pairs, uint64(2)):
                even = add_where(even, lowest[i], lanes[i])
                odd = add_where(odd, lowest[i + uint64(1)], lanes[i + uint64(1)])
            if pairs < count:
                even = add_where(even, lowest[pairs], lanes[pairs])
            store(looked.lowest[tile], 0, plus(even, odd))
            tile += 1


@compiled(float64(FLOATS, FLOATS, float32, float32, VECTOR, VECTOR, VECTOR, VECTOR), called_from_python=False)
def raise_bins(
    bound: Floats, lowest: Floats, constant: float, weight: float, first: Any, second: Any, third: Any, fourth: Any
) -> float:  # fmt: skip
    """Add constant + lowest (LANES,) + weight * a vector for each of a tile's rows to the bounds of its bins (4 * 16,).

    Returns the highest bound; bounds are rounded up.
    """
    every_row = load_plus(lowest, constant)  # type: ignore[call-arg, var-annotated]
    first = raised(bound, 0, weight, first, every_row)
    second = raised(bound, LANES, weight, second, every_row)
    third = raised(bound, 2 * LANES, weight, third, every_row)
    fourth = raised(bound, 3 * LANES, weight, fourth, every_row)
    return float64(highest_lane(first, second, third, fourth))


@compiled(float64(FLOATS, LEVELS, LOOKED, int64, int64, int64, float32, float32), called_from_python=False)
def raise_alike(
    bound: Floats, levels: Levels, looked: Looked, tile: int, move: int, width: int, unit: float, constant: float
) -> float:  # fmt: skip
    """Add constant + what is looked up, where all entries are alike, to the bounds of a tile's bins (4 * 16,).

    move: from the first letter to the one asked for. width: from a row of the tile to the next. unit: nats a level.
    Returns the highest bound; bounds are rounded up.
    """
    level, at, inside = levels.level, looked.at[tile], looked.lanes[tile]
    number = len(inside)
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    # Unsigned, because a signed index is compiled with a test for negative ones.
    for begin in range(0, number, ALIKE):
        words_1 = words_2 = words_3 = words_4 = no_words()
        for i in range(uint64(begin), uint64(min(number, begin + ALIKE))):
            place, lanes = at[i] + move, inside[i]
            words_1 = add_bytes(words_1, level, place, lanes)
            words_2 = add_bytes(words_2, level, place + width, lanes)
            words_3 = add_bytes(words_3, level, place + 2 * width, lanes)
            words_4 = add_bytes(words_4, level, place + 3 * width, lanes)
        first, second = add_words(first, words_1), add_words(second, words_2)
        third, fourth = add_words(third, words_3), add_words(fourth, words_4)
    return raise_bins(bound, looked.lowest[tile], constant, unit, first, second, third, fourth)


@compiled(
    float64(FLOATS, LEVELS, LOOKED, ENTRIES, int64, int64, int64, float32, float32), called_from_python=False
)
def raise_weighted(
    bound: Floats, levels: Levels, looked: Looked, entries: Entries, tile: int, move: int, width: int, unit: float,
    constant: float,
) -> float:  # fmt: skip
    """Do what `raise_alike` does, where entries have weights of their own. unit: nats a level for a weight of 1."""
    level, at, inside, other = levels.level, looked.at[tile], looked.lanes[tile], entries.other
    # No processor foresees what the tile after the next one reads: mostly two lines of each table, rarely a third.
    soon = looked.at[min(tile + 2, len(looked.at) - 1)]
    number = len(inside)
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for begin in range(0, number, WEIGHTED):
        words_1 = words_2 = words_3 = words_4 = no_words()
        for i in range(uint64(begin), uint64(min(number, begin + WEIGHTED))):
            place, lanes = at[i] + move, inside[i]
            there, weight, other_weight = place + other[i], entries.weight[i], entries.other_weight[i]
            for line in range(uint64(0), uint64(2 * LINE), uint64(LINE)):
                fetch_close(level, soon[i] + move + line)
                fetch_close(level, soon[i] + move + other[i] + line)
            words_1 = add_products(words_1, level, place, there, lanes, weight, other_weight)
            place, there = place + width, there + width
            words_2 = add_products(words_2, level, place, there, lanes, weight, other_weight)
            place, there = place + width, there + width
            words_3 = add_products(words_3, level, place, there, lanes, weight, other_weight)
            place, there = place + width, there + width
            words_4 = add_products(words_4, level, place, there, lanes, weight, other_weight)
        first, second = add_words(first, words_1), add_words(second, words_2)
        third, fourth = add_words(third, words_3), add_words(fourth, words_4)
    # What each entry adds was rounded down by less than one.
    constant += unit * DIVISOR * number
    return raise_bins(bound, looked.lowest[tile], constant, unit * DIVISOR, first, second, third, fourth)
