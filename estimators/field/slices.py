"""Tables as a grid of bins reads them, and their sums for tiles of bins (compiled).

For one angle of T_R^O, all bins see a taxel through the same fraction of a table cell. So a term of a
reading adds one shifted piece of the table to all of them, with four bilinear weights in common: no
bin is looked up by itself. Bins are summed in tiles of 4 rows of 16, which stay in registers while
all terms are added.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float64, int64, types, void
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
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES, TALL, add_times, load, store, zeros

# A slice further out than this many bins is off the map, and its index might overflow.
_FAR = 1e9


class Slices(NamedTuple):
    """Tables as bins, or blocks of bins, read them.

    nodes: flat; those of the lattice that are one bin apart are neighbours, with TALL rows of zeros before and after
    each plane and LANES zeros after each row, so that a tile may hang over the edge. shape: (tables, letters,
    phases_y, phases_x, rows, columns) without these zeros: the lattice node [row * phases_y + phase_y,
    column * phases_x + phase_x] is in that row and column of the plane of those phases.
    place: [x, y] of bin (0, 0) less that of node (0, 0), then the bins' spacing in x and y, mm.
    """

    nodes: Floats
    shape: Ints
    place: Reals


SLICES = types.NamedTuple((FLOATS, INTS, REALS), Slices)


def slices_of(nodes: Floats, phases: tuple[int, int], place: Reals) -> Slices:
    """Lay out the nodes and phases of `Tables` for the kernels; place as in `Slices`."""
    framed = laid_out(nodes, phases, 0)
    rows, columns = framed.shape[4] - 2 * TALL, framed.shape[5] - LANES
    return Slices(framed.reshape(-1), np.array([*framed.shape[:4], rows, columns]), place)


def laid_out(nodes: NDArray[Any], phases: tuple[int, int], outside: float) -> NDArray[Any]:
    """Lay out nodes (tables, letters, rows, columns) as `Slices` says, with another value than zero outside.

    Returns (tables, letters, phases_y, phases_x, rows + 2 * TALL, columns + LANES).
    """
    kinds, letters, rows, columns = nodes.shape
    phases_y, phases_x = phases
    shape = kinds, letters, phases_y, phases_x, rows // phases_y, columns // phases_x
    framed = np.full((*shape[:4], shape[4] + 2 * TALL, shape[5] + LANES), outside, dtype=nodes.dtype)
    split = nodes.reshape(kinds, letters, shape[4], phases_y, shape[5], phases_x)
    framed[..., TALL:-TALL, :-LANES] = split.transpose(0, 1, 3, 5, 2, 4)
    return framed


@compiled(
    void(TERMS, int64, SLICES, float64, float64, int64, int64, INTS_2D, FLOATS_2D, INTS_2D),
    called_from_python=False,
)
def place_terms(
    terms: Terms, reading: int, slices: Slices, cos: float, sin: float, rows: int, columns: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Find the pieces of the tables that the bins of one angle read for one reading.

    Fills for each term: offset (4,), the flat index of the nodes around bin (0, 0) in the first
    letter's tables; share (4,), their weights; within (4,), first and last column and row (from, to)
    of the bins whose nodes are on the lattice. Elsewhere tables are 0.
    """
    letters, phases_y, phases_x = slices.shape[1], slices.shape[2], slices.shape[3]
    width, plane = slices.shape[5] + LANES, (slices.shape[4] + 2 * TALL) * (slices.shape[5] + LANES)
    # To the next node, from the last of a bin's nodes to the first of the next bin's.
    carry_x, carry_y = 1 - phases_x * plane, width - phases_y * phases_x * plane
    begin = terms.start[reading]
    for i in range(terms.start[reading + 1] - begin):
        x, y = terms.xy[begin + i, 0], terms.xy[begin + i, 1]
        u = (cos * x - sin * y + slices.place[0]) / slices.place[2]
        v = (sin * x + cos * y + slices.place[1]) / slices.place[3]
        u, v = min(max(u, -_FAR), _FAR), min(max(v, -_FAR), _FAR)
        left, below = int64(math.floor(u)), int64(math.floor(v))
        # The node to the left is number `step_x` of the nodes that lie between two bins.
        u, v = (u - left) * phases_x, (v - below) * phases_y
        step_x, step_y = min(int64(u), phases_x - 1), min(int64(v), phases_y - 1)
        last_x, last_y = int64(step_x + 1 == phases_x), int64(step_y + 1 == phases_y)
        within[i, 0], within[i, 1] = max(0, -left), min(columns, slices.shape[5] - left - last_x)
        within[i, 2], within[i, 3] = max(0, -below), min(rows, slices.shape[4] - below - last_y)
        phase = (terms.kind[begin + i] * letters * phases_y + step_y) * phases_x + step_x
        node = phase * plane + (below + TALL) * width + left
        right, above = plane + last_x * carry_x, phases_x * plane + last_y * carry_y
        offset[i, 0], offset[i, 1] = node, node + right
        offset[i, 2], offset[i, 3] = node + above, node + above + right
        factor, right_share, above_share = float64(terms.weight[begin + i]), u - step_x, v - step_y
        share[i, 0] = factor * (1 - above_share) * (1 - right_share)
        share[i, 1] = factor * (1 - above_share) * right_share
        share[i, 2] = factor * above_share * (1 - right_share)
        share[i, 3] = factor * above_share * right_share


@compiled(boolean(INTS, int64, int64), called_from_python=False)
def beside(within: Ints, row: int, column: int) -> bool:
    """Tell whether all of a tile that begins at a row and column lies outside `within` (4,), see `place_terms`."""
    return column + LANES <= within[0] or column >= within[1] or row + TALL <= within[2] or row >= within[3]


@compiled(
    void(FLOATS, SLICES, int64, int64, int64, int64, INTS_2D, FLOATS_2D, INTS_2D),
    called_from_python=False,
)
def sum_tile(
    total: Floats, slices: Slices, terms: int, letter: int, row: int, column: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Add up the placed terms for the tile that begins at a row and column; fills total (4 * 16,)."""
    nodes, width = slices.nodes, slices.shape[5] + LANES
    plane = (slices.shape[4] + 2 * TALL) * width
    move = letter * slices.shape[2] * slices.shape[3] * plane + row * width + column
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for i in range(terms):
        if beside(within[i], row, column):
            continue
        for corner in range(4):
            weight, at = share[i, corner], offset[i, corner] + move
            first = add_times(first, weight, load(nodes, at))
            second = add_times(second, weight, load(nodes, at + width))
            third = add_times(third, weight, load(nodes, at + 2 * width))
            fourth = add_times(fourth, weight, load(nodes, at + 3 * width))
    store(total, 0, first)
    store(total, LANES, second)
    store(total, 2 * LANES, third)
    store(total, 3 * LANES, fourth)
