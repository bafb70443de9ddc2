"""Upper bounds of what a bin reads in tables, in one byte instead of four numbers, and their sums for tiles (compiled).

A bin reads four neighbouring nodes and interpolates. The largest of the four bounds that; it is kept as the lowest
value of its table and a number of steps, rounded up. A tile's bound is a sum of whole numbers of 16 bits, of which so
many are added up that they cannot overflow.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import float32, float64, int64, types, uint8, uint16, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import (
    FLOATS,
    FLOATS_2D,
    INTS,
    INTS_2D,
    REALS,
    REALS_2D,
    Floats,
    Ints,
    Reals,
    compiled,
)
from tactsim.estimators.field.slices import LAYOUT, Layout, beside, laid_out, lanes_of, piece, span_within
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import (
    DIVISOR,
    LANES,
    TALL,
    VECTOR,
    add_bytes,
    add_products,
    add_words,
    highest_lane,
    load_plus,
    no_words,
    raised,
    zeros,
)

# The highest level. 16 bits hold the sum of so many levels; and of so many products of a level with a weight of at most
# HIGHEST, each divided by DIVISOR.
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

    at: (tiles, most) flat index of the level of the tile's first bin for the first letter. weight: (tiles, most) of the
    term, in HIGHEST parts of the heaviest, rounded up. lanes: (tiles, most) bits of the tile's columns that lie in its
    table. number: (tiles,) how many of these. lowest: (tiles, LANES) nats, for each column the sum of the lowest values
    of the tables that it lies in, times their weights.
    """

    at: Ints
    weight: NDArray[np.uint8]
    lanes: NDArray[np.uint16]
    number: Ints
    lowest: Floats


LOOKED = types.NamedTuple((INTS_2D, uint8[:, ::1], uint16[:, ::1], INTS, FLOATS_2D), Looked)


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
    largest = table.astype(np.int32)
    largest[..., :-1] = np.maximum(largest[..., :-1], largest[..., 1:])
    largest[..., :-1, :] = np.maximum(largest[..., :-1, :], largest[..., 1:, :])
    return (-((lowest - largest) // step)).astype(np.uint8)


@compiled(types.UniTuple(float64, 2)(TERMS, int64), called_from_python=False)
def weights_of(terms: Terms, reading: int) -> tuple[float, float]:
    """Find the least and the greatest weight of a reading's terms; 0 if it has none."""
    weights = terms.weight[terms.start[reading] : terms.start[reading + 1]]
    return (float64(weights.min()), float64(weights.max())) if len(weights) else (0.0, 0.0)


@compiled(
    void(LOOKED, LEVELS, LAYOUT, TERMS, *[int64] * 4, float64, float64, REALS_2D), called_from_python=False
)
def look_up(
    looked: Looked, levels: Levels, layout: Layout, terms: Terms, reading: int, first: int, rows: int, columns: int,
    cos: float, sin: float, change: Reals,
) -> None:  # fmt: skip
    """Find where the tiles of one angle look up the bounds of a reading.

    first: number of the angle's first tile. rows, columns: of bins. cos, sin: of the angle. change: (tiles of the
    angle, LANES + 1), room.
    """
    width, (_, heaviest) = layout.shape[5], weights_of(terms, reading)
    change[:] = 0  # of the lowest values' sum, from a column of a tile to the next
    looked.number[first : first + len(change)] = 0
    begin, xy = terms.start[reading], terms.xy
    for i in range(begin, terms.start[reading + 1]):
        # A taxel's terms follow each other.
        if i == begin or xy[i, 0] != xy[i - 1, 0] or xy[i, 1] != xy[i - 1, 1]:
            here = piece(layout, xy[i, 0], xy[i, 1], cos, sin, rows, columns)
        node = layout.first + terms.kind[i] * layout.table + here.node
        lowest = terms.weight[i] * levels.lowest[terms.kind[i]]
        weight = math.ceil(float64(terms.weight[i]) / heaviest * HIGHEST) if heaviest else 0
        tile = -1
        for row in range(0, rows, TALL):
            for column in range(0, columns, LANES):
                tile += 1
                if beside(here.first_column, here.last_column, here.first_row, here.last_row, row, column):
                    continue
                found = looked.number[first + tile]
                left, right = span_within(here.first_column, here.last_column, column)
                looked.at[first + tile, found] = node + row * width + column
                looked.weight[first + tile, found] = weight
                looked.lanes[first + tile, found] = lanes_of(left, right)
                looked.number[first + tile] = found + 1
                change[tile, left] += lowest
                change[tile, right] -= lowest
    for tile in range(len(change)):
        total = 0.0
        for lane in range(LANES):
            total += change[tile, lane]
            looked.lowest[first + tile, lane] = total


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
    """Add constant + what is looked up, where all terms have one weight, to the bounds of a tile's bins (4 * 16,).

    move: from the first letter to the one asked for. width: from a row of the tile to the next. unit: nats a level.
    Returns the highest bound; bounds are rounded up.
    """
    level, number, at, inside = levels.level, looked.number[tile], looked.at[tile], looked.lanes[tile]
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


@compiled(float64(FLOATS, LEVELS, LOOKED, int64, int64, int64, float32, float32), called_from_python=False)
def raise_weighted(
    bound: Floats, levels: Levels, looked: Looked, tile: int, move: int, width: int, unit: float, constant: float
) -> float:  # fmt: skip
    """Do what `raise_alike` does, where terms have weights of their own. unit: nats a level for a weight of 1."""
    level, number, at, inside = levels.level, looked.number[tile], looked.at[tile], looked.lanes[tile]
    weights = looked.weight[tile]
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for begin in range(0, number, WEIGHTED):
        words_1 = words_2 = words_3 = words_4 = no_words()
        for i in range(uint64(begin), uint64(min(number, begin + WEIGHTED))):
            place, lanes = at[i] + move, inside[i]
            weight = weights[i]
            words_1 = add_products(words_1, level, place, lanes, weight)
            words_2 = add_products(words_2, level, place + width, lanes, weight)
            words_3 = add_products(words_3, level, place + 2 * width, lanes, weight)
            words_4 = add_products(words_4, level, place + 3 * width, lanes, weight)
        first, second = add_words(first, words_1), add_words(second, words_2)
        third, fourth = add_words(third, words_3), add_words(fourth, words_4)
    # Each product was rounded down by less than one.
    constant += unit * DIVISOR * number
    return raise_bins(bound, looked.lowest[tile], constant, unit * DIVISOR, first, second, third, fourth)
