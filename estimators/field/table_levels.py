"""Upper bounds of what a bin reads in tables, in a byte instead of four numbers, and their sums for tiles (compiled).

A bin reads four neighbouring nodes and interpolates. The largest of the four bounds that; it is kept as the lowest
value of its table and a number of steps, rounded up. A tile's bound moves a sixteenth of the memory that its sum does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, uint8
from numpy.typing import NDArray

from tactsim.core.compiling import FLOATS, INTS_2D, REALS, Floats, Ints, Reals, compiled
from tactsim.estimators.field.slices import SLICES, Slices, beside, laid_out
from tactsim.estimators.field.vectors import LANES, TALL, add_times, load_bytes, store, zeros

_MOST = 255


class Levels(NamedTuple):
    """Upper bounds of tables: lowest + step * level of the table, at the flat index of the lower left of four nodes.

    level: flat, uint8, laid out as `Slices.nodes`. lowest, step: (tables,) nats.
    """

    level: NDArray[np.uint8]
    lowest: Reals
    step: Reals


LEVELS = types.NamedTuple((uint8[::1], REALS, REALS), Levels)


def levels_of(nodes: Floats, phases: tuple[int, int]) -> Levels:
    """Bound the nodes (tables, letters, rows, columns) of `Tables`, 0 at their rim, laid out with `phases`."""
    lowest, step = np.empty((2, len(nodes)))
    levels = []
    for number, table in enumerate(nodes):  # one by one: they may be many
        largest = table.astype(float)
        largest[..., :-1] = np.maximum(largest[..., :-1], largest[..., 1:])
        largest[..., :-1, :] = np.maximum(largest[..., :-1, :], largest[..., 1:, :])
        # Outside tables are 0. At the rim they may miss it by rounding, all values may be such traces.
        lowest[number], highest = min(largest.min(), 0.0), max(float(largest.max()), 0.0)
        step[number] = max(highest - lowest[number], np.finfo(np.float32).tiny) / _MOST
        level = np.ceil((largest - lowest[number]) / step[number])
        outside = min(_MOST, int(np.ceil(-lowest[number] / step[number])))
        levels.append(laid_out(np.minimum(level, _MOST).astype(np.uint8)[None], phases, outside))
    return Levels(np.concatenate(levels, axis=None), lowest, step)


@compiled(
    float64(FLOATS, LEVELS, SLICES, int64, int64, int64, int64, INTS_2D, FLOATS, REALS, INTS_2D),
    called_from_python=False,
)
def bound_tile(
    total: Floats, levels: Levels, slices: Slices, terms: int, letter: int, row: int, column: int,
    offset: Ints, factor: Floats, lowest: Reals, within: Ints,
) -> float:  # fmt: skip
    """Bound the sum of the placed terms for the tile that begins at a row and column.

    offset, within: as `place_terms` places them. factor, lowest: (terms,) a term's weight times the step and the lowest
    value of its table. Returns a number that total (4 * 16,), which is filled, is to be added to.
    """
    level, width = levels.level, slices.shape[5] + LANES
    plane = (slices.shape[4] + 2 * TALL) * width
    move = letter * slices.shape[2] * slices.shape[3] * plane + row * width + column
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    least = 0.0
    for i in range(terms):
        if beside(within[i], row, column):
            continue
        at = offset[i, 0] + move
        first = add_times(first, factor[i], load_bytes(level, at))
        second = add_times(second, factor[i], load_bytes(level, at + width))
        third = add_times(third, factor[i], load_bytes(level, at + 2 * width))
        fourth = add_times(fourth, factor[i], load_bytes(level, at + 3 * width))
        least += lowest[i]
    store(total, 0, first)
    store(total, LANES, second)
    store(total, 2 * LANES, third)
    store(total, 3 * LANES, fourth)
    return least
