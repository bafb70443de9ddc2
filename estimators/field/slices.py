"""Tables as a grid of bins reads them, and their sums for tiles of bins (compiled).

For one angle of T_R^O, all bins see a taxel through the same fraction of a table cell. So a term of a
reading adds one shifted piece of the table to all of them, with four bilinear weights in common: no
bin is looked up by itself. Bins are summed in tiles of 4 rows of 16, which stay in registers while
all terms are added.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float64, int16, int64, types, uint16, void
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

# A slice further out than this many bins, or nowhere, is off the map, and its index might overflow.
_FAR = 1e9
# So many numbers before and after all tables may be read, and left out.
_BESIDE = LANES - 1


class Layout(NamedTuple):
    """Where bins, or blocks of bins, find the numbers of tables: flat, those one bin apart are neighbours.

    shape: (tables, letters, phases_y, phases_x, rows, columns): the lattice node [row * phases_y + phase_y,
    column * phases_x + phase_x] is in that row and column of the plane of those phases. first: index of the first
    table's first node. plane, table: how many numbers it is to the next of them; rows follow each other. Before and
    after each plane there are more rows, with what a table says outside, so that a tile may hang over. Beside its rows
    a tile reads what it must leave out. place: [x, y] of bin (0, 0) less that of node (0, 0), then the bins' spacing
    in x and y, mm.
    """

    shape: Ints
    first: int
    plane: int
    table: int
    place: Reals


LAYOUT = types.NamedTuple((INTS, int64, int64, int64, REALS), Layout)


class Slices(NamedTuple):
    """Tables as bins, or blocks of bins, read them. nodes: as `layout` says, each times `unit` nats."""

    nodes: NDArray[np.int16]
    unit: float
    layout: Layout


SLICES = types.NamedTuple((int16[::1], float64, LAYOUT), Slices)


def layout_of(nodes: Sequence[int], phases: tuple[int, int], place: Reals) -> Layout:
    """Say how nodes of a shape (tables, letters, rows, columns), with the phases of `Tables`, are laid out."""
    shape = nodes[0], nodes[1], *phases, nodes[2] // phases[0], nodes[3] // phases[1]
    return Layout(np.array(shape), *_strides(*shape[1:]), place)


def laid_out(
    tables: Iterable[NDArray[Any]], shape: Sequence[int], phases: tuple[int, int], outside: NDArray[Any]
) -> NDArray[Any]:
    """Lay out nodes as `Layout` says, flat, with each table's value `outside` where that has zeros.

    tables: nodes (letters, rows, columns), which may be made one by one. shape: (tables, letters, rows, columns).
    outside: (tables,), of the type that all get.
    """
    kinds, letters, rows, columns = shape
    tall, wide = rows // phases[0], columns // phases[1]
    first, plane, table = _strides(letters, *phases, tall, wide)
    flat = np.zeros(2 * _BESIDE + kinds * table, dtype=outside.dtype)
    inside = flat[_BESIDE:-_BESIDE].reshape(kinds, table)
    for values, there, nodes in zip(inside, outside, tables, strict=True):
        values[:] = there
        split = nodes.reshape(letters, tall, phases[0], wide, phases[1]).transpose(0, 2, 4, 1, 3)
        planes = values[first - _BESIDE :].reshape(letters, *phases, plane // wide, wide)
        planes[..., :tall, :] = split
    return flat


def _strides(letters: int, phases_y: int, phases_x: int, rows: int, columns: int) -> tuple[int, int, int]:
    """Find `first`, `plane` and `table` of `Layout`.

    The rows that follow a plane also come before the next.
    """
    before, plane = (TALL - 1) * columns, (rows + TALL - 1) * columns
    return _BESIDE + before, plane, before + letters * phases_y * phases_x * plane


class Piece(NamedTuple):
    """The piece of a table that the bins of one angle read for one taxel.

    node: number of the node at or before bin (0, 0), counted from a table's first. right, above: how far the next nodes
    are from it. right_share, above_share: of the way to them. first_column, last_column, first_row, last_row: of the
    bins whose nodes are all on the lattice (from, to).
    """

    node: int
    right: int
    above: int
    right_share: float
    above_share: float
    first_column: int
    last_column: int
    first_row: int
    last_row: int


PIECE = types.NamedTuple((*[int64] * 3, *[float64] * 2, *[int64] * 4), Piece)


@compiled(PIECE(LAYOUT, float64, float64, float64, float64, int64, int64), called_from_python=False)
def piece(layout: Layout, x: float, y: float, cos: float, sin: float, rows: int, columns: int) -> Piece:
    """Find the piece that rows x columns of bins read for a taxel at x, y mm in the robot's frame."""
    phases_y, phases_x = layout.shape[2], layout.shape[3]
    width, plane = layout.shape[5], layout.plane
    # To the next node, from the last of a bin's nodes to the first of the next bin's.
    carry_x, carry_y = 1 - phases_x * plane, width - phases_y * phases_x * plane
    u: Any = (cos * x - sin * y + layout.place[0]) / layout.place[2]
    v: Any = (sin * x + cos * y + layout.place[1]) / layout.place[3]
    u, v = u if abs(u) < _FAR else -_FAR, v if abs(v) < _FAR else -_FAR
    left, below = int64(math.floor(u)), int64(math.floor(v))
    # The node to the left is number `step_x` of the nodes that lie between two bins.
    u, v = (u - left) * phases_x, (v - below) * phases_y
    step_x, step_y = min(int64(u), phases_x - 1), min(int64(v), phases_y - 1)
    last_x, last_y = int64(step_x + 1 == phases_x), int64(step_y + 1 == phases_y)
    return Piece(
        below * width + left + (step_y * phases_x + step_x) * plane,
        plane + last_x * carry_x, phases_x * plane + last_y * carry_y,
        u - step_x, v - step_y,
        max(0, -left), min(columns, width - left - last_x),
        max(0, -below), min(rows, layout.shape[4] - below - last_y),
    )  # fmt: skip


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
    layout, begin = slices.layout, terms.start[reading]
    for i in range(terms.start[reading + 1] - begin):
        here = piece(layout, terms.xy[begin + i, 0], terms.xy[begin + i, 1], cos, sin, rows, columns)
        within[i, 0], within[i, 1] = here.first_column, here.last_column
        within[i, 2], within[i, 3] = here.first_row, here.last_row
        node = layout.first + terms.kind[begin + i] * layout.table + here.node
        offset[i, 0], offset[i, 1] = node, node + here.right
        offset[i, 2], offset[i, 3] = node + here.above, node + here.above + here.right
        factor, right_share, above_share = (
            terms.weight[begin + i] * slices.unit, here.right_share, here.above_share,
        )  # fmt: skip
        share[i, 0] = factor * (1 - above_share) * (1 - right_share)
        share[i, 1] = factor * (1 - above_share) * right_share
        share[i, 2] = factor * above_share * (1 - right_share)
        share[i, 3] = factor * above_share * right_share


@compiled(boolean(*[int64] * 6), called_from_python=False)
def beside(first_column: int, last_column: int, first_row: int, last_row: int, row: int, column: int) -> bool:
    """Tell whether all of a tile that begins at a row and column lies outside what a `Piece` covers."""
    return (
        column + LANES <= first_column or column >= last_column or row + TALL <= first_row or row >= last_row
    )


@compiled(types.UniTuple(int64, 2)(int64, int64, int64), called_from_python=False)
def span_within(first_column: int, last_column: int, column: int) -> tuple[int, int]:
    """Find from which to which of a tile's columns, `column` and on, a `Piece` covers."""
    begin = min(max(first_column - column, 0), LANES)
    return begin, min(max(last_column - column, begin), LANES)


@compiled(uint16(int64, int64), called_from_python=False)
def lanes_of(begin: int, end: int) -> Any:
    """Set the bits of the lanes from `begin` to `end`, as `load` takes them."""
    return (1 << end) - (1 << begin)


@compiled(
    void(FLOATS, SLICES, int64, int64, int64, int64, INTS_2D, FLOATS_2D, INTS_2D),
    called_from_python=False,
)
def sum_tile(
    total: Floats, slices: Slices, terms: int, letter: int, row: int, column: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Add up the placed terms for the tile that begins at a row and column; fills total (4 * 16,)."""
    nodes, shape = slices.nodes, slices.layout.shape
    width = shape[5]
    move = letter * shape[2] * shape[3] * slices.layout.plane + row * width + column
    first = second = third = fourth = zeros()  # type: ignore[call-arg, var-annotated]
    for i in range(terms):
        if beside(within[i, 0], within[i, 1], within[i, 2], within[i, 3], row, column):
            continue
        begin, end = span_within(within[i, 0], within[i, 1], column)
        lanes = lanes_of(begin, end)
        for corner in range(4):
            weight, at = share[i, corner], offset[i, corner] + move
            first = add_times(first, weight, load(nodes, at, lanes))
            second = add_times(second, weight, load(nodes, at + width, lanes))
            third = add_times(third, weight, load(nodes, at + 2 * width, lanes))
            fourth = add_times(fourth, weight, load(nodes, at + 3 * width, lanes))
    store(total, 0, first)
    store(total, LANES, second)
    store(total, 2 * LANES, third)
    store(total, 3 * LANES, fourth)
