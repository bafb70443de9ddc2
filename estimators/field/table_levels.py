"""Upper bounds of what a bin reads in tables, in one byte instead of four numbers, and their sums for tiles (compiled).

A bin reads four neighbouring nodes and interpolates. The largest of the four bounds that; it is kept as the lowest
value of its table and a number of steps, rounded up. Where all terms weigh the same, a tile's bound is a sum of whole
numbers: 256 bytes are added up before 16 bits can overflow.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import float32, float64, int64, types, uint8, void
from numpy.typing import NDArray

from tactsim.core.compiling import FLOATS, FLOATS_2D, INTS, INTS_2D, REALS, Floats, Ints, Reals, compiled
from tactsim.estimators.field.slices import SLICES, Slices, beside, laid_out, lanes_of, span_within
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import (
    LANES,
    TALL,
    VECTOR,
    add_bytes,
    add_times,
    add_words,
    highest_lane,
    load_bytes,
    load_plus,
    no_words,
    raised,
    zeros,
)

# The highest level, and so many levels that 16 bits hold their sum.
HIGHEST, _WORDS = 255, 256


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

    at: (tiles, most) flat index of the level of the tile's first bin for the first letter. term: (tiles, most) number
    of the term. lanes: (tiles, most) bits of the tile's columns that lie in its table. number: (tiles,) how many of
    these. lowest: (tiles, LANES) nats, for each column the sum of the lowest values of the tables that it lies in,
    times their weights.
    """

    at: Ints
    term: Ints
    lanes: Ints
    number: Ints
    lowest: Floats


LOOKED = types.NamedTuple((INTS_2D, INTS_2D, INTS_2D, INTS, FLOATS_2D), Looked)


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


@compiled(
    void(LOOKED, LEVELS, SLICES, TERMS, int64, int64, int64, int64, INTS_2D, INTS_2D),
    called_from_python=False,
)
def look_up(
    looked: Looked, levels: Levels, slices: Slices, terms: Terms, reading: int, first: int, rows: int, columns: int,
    offset: Ints, within: Ints,
) -> None:  # fmt: skip
    """Find where the tiles of one angle look up the bounds of a reading.

    first: number of the angle's first tile; it has rows x columns of them. offset, within: as `place_terms` places the
    terms.
    """
    begin, number = terms.start[reading], terms.start[reading + 1] - terms.start[reading]
    width, change = slices.shape[5], np.empty(LANES + 1)
    for row in range(rows):
        for column in range(columns):
            tile, found = first + row * columns + column, 0
            change[:] = 0  # of the lowest values' sum, from a column of the tile to the next
            for i in range(number):
                if not beside(within[i], row * TALL, column * LANES):
                    looked.at[tile, found] = offset[i, 0] + row * TALL * width + column * LANES
                    looked.term[tile, found] = begin + i
                    lowest = terms.weight[begin + i] * levels.lowest[terms.kind[begin + i]]
                    left, right = span_within(within[i], column * LANES)
                    looked.lanes[tile, found] = lanes_of(left, right)
                    change[left] += lowest
                    change[right] -= lowest
                    found += 1
            looked.number[tile], total = found, 0.0
            for lane in range(LANES):
                total += change[lane]
                looked.lowest[tile, lane] = total


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
    bound: Floats, levels: Levels, looked: Looked, tile: int, move: int, width: int, weight: float, constant: float
) -> float:  # fmt: skip
    """Add constant + what is looked up, where all terms have one weight, to the bounds of a tile's bins (4 * 16,).

    move: from the first letter to the one asked for. width: from a row of the tile to the next. weight: nats a level.
    Returns the highest bound; bounds are rounded up.
    """
    level, number = levels.level, looked.number[tile]
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for begin in range(0, number, _WORDS):
        words_1 = words_2 = words_3 = words_4 = no_words()
        for i in range(begin, min(number, begin + _WORDS)):
            place, lanes = looked.at[tile, i] + move, looked.lanes[tile, i]
            words_1 = add_bytes(words_1, level, place, lanes)
            words_2 = add_bytes(words_2, level, place + width, lanes)
            words_3 = add_bytes(words_3, level, place + 2 * width, lanes)
            words_4 = add_bytes(words_4, level, place + 3 * width, lanes)
        first, second = add_words(first, words_1), add_words(second, words_2)
        third, fourth = add_words(third, words_3), add_words(fourth, words_4)
    return raise_bins(bound, looked.lowest[tile], constant, weight, first, second, third, fourth)


@compiled(float64(FLOATS, LEVELS, LOOKED, int64, int64, int64, FLOATS, float32), called_from_python=False)
def raise_weighted(
    bound: Floats, levels: Levels, looked: Looked, tile: int, move: int, width: int, weight: Floats, constant: float
) -> float:  # fmt: skip
    """Do what `raise_alike` does, with the weight (terms,) of each level's term."""
    level = levels.level
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for i in range(looked.number[tile]):
        place, lanes = looked.at[tile, i] + move, looked.lanes[tile, i]
        factor = float32(levels.step[0] * weight[looked.term[tile, i]])
        first = add_times(first, factor, load_bytes(level, place, lanes))
        second = add_times(second, factor, load_bytes(level, place + width, lanes))
        third = add_times(third, factor, load_bytes(level, place + 2 * width, lanes))
        fourth = add_times(fourth, factor, load_bytes(level, place + 3 * width, lanes))
    return raise_bins(bound, looked.lowest[tile], constant, float32(1), first, second, third, fourth)
