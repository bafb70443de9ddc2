"""Clip outlines with a grid of cells: exact areas and moments of what covers each cell.

Every covered region's area, first and second moments follow from its boundary alone (Green's
theorem), so an outline is cut where it crosses a grid line and each piece is added to the cell that
it lies in, and to the cells on its right, as a rasteriser does. Nothing is sampled: the moments are
exact for any polygon, convex or not, with or without holes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactsim.poses import FloatArray, transform

# A cell's moments are the integrals of 1, u, v, uu, uv, vv over its covered part, (u, v) from its centre.
MOMENTS = 6

# Two points integrate cubics exactly; every integrand below is a cubic along a straight piece.
_GAUSS = (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12))


def edges_of(contours: Sequence[FloatArray]) -> FloatArray:
    """List the edges of closed contours: (edges, 2 ends, 2) mm, in the contours' sense of rotation."""
    return np.concatenate([np.stack([c, np.roll(c, -1, axis=0)], axis=1) for c in contours])


def cell_moments(
    edges: FloatArray, poses: FloatArray, x_lines: FloatArray, y_lines: FloatArray
) -> FloatArray:
    """Integrate over the part of each cell that a posed outline covers.

    edges: (edges, 2, 2) mm, outer contours counter-clockwise, holes clockwise. poses: (n, 3), the
    outline's frame in the grid's. x_lines (columns + 1,), y_lines (rows + 1,): the grid, mm.
    Returns (n, rows, columns, 6): area mm^2, first moments mm^3 and second moments mm^4 about each
    cell's centre, in the order above.
    """
    count, rows, columns = len(poses), len(y_lines) - 1, len(x_lines) - 1
    ends = transform(poses, edges.reshape(-1, 2)).reshape(count * len(edges), 4)
    pose = np.repeat(np.arange(count), len(edges))
    x0, y0, x1, y1 = ends.T
    # What lies above, below or to the right of the grid bounds no covered region in it.
    near = (
        (np.maximum(y0, y1) > y_lines[0])
        & (np.minimum(y0, y1) < y_lines[-1])
        & (np.minimum(x0, x1) < x_lines[-1])
    )
    pose, x0, y0, x1, y1 = pose[near], x0[near], y0[near], x1[near], y1[near]
    piece, y0, y1, x0, x1 = _cut(y0, y1, x0, x1, y_lines)
    pose = pose[piece]
    piece, x0, x1, y0, y1 = _cut(x0, x1, y0, y1, x_lines)
    pose = pose[piece]
    # A piece lies in one row and one column, told by its middle; beyond the left border it covers
    # whole rows, as a piece on that border would.
    row = np.searchsorted(y_lines, (y0 + y1) / 2) - 1
    column = np.searchsorted(x_lines, (x0 + x1) / 2) - 1
    inside = (row >= 0) & (row < rows) & (column < columns)
    pose, row, column = pose[inside], row[inside], column[inside]
    x0, y0, x1, y1 = x0[inside], y0[inside], x1[inside], y1[inside]
    left = column < 0
    x0[left] = x1[left] = x_lines[0]
    column[left] = 0

    u0, u1 = x0 - (x_lines[column] + x_lines[column + 1]) / 2, x1 - x0
    v0, v1 = y0 - (y_lines[row] + y_lines[row + 1]) / 2, y1 - y0
    half = (x_lines[column + 1] - x_lines[column]) / 2
    moments = np.zeros((MOMENTS, len(row)))  # of the region between a piece and its cell's right side
    cover = np.zeros((3, len(row)))  # integrals of 1, v, vv along a piece, for the cells further right
    for t in _GAUSS:
        u, v = u0 + t * u1, v0 + t * v1
        width, first = half - u, (half * half - u * u) / 2
        moments += (width, first, width * v, (half**3 - u**3) / 3, first * v, width * v * v)
        cover += (np.ones_like(v), v, v * v)
    weight = -v1 / len(_GAUSS)  # a rising edge has the region on its left
    cells = count * rows * columns
    cell = (pose * rows + row) * columns + column
    own = np.stack([np.bincount(cell, weight * m, cells) for m in moments], axis=-1).astype(float)
    right = np.stack([np.bincount(cell, weight * c, cells) for c in cover], axis=-1)
    own = own.reshape(count, rows, columns, MOMENTS)
    right = right.reshape(count, rows, columns, 3)[:, :, :-1].cumsum(axis=2)
    width = np.diff(x_lines)[1:]
    own[:, :, 1:, 0] += right[..., 0] * width
    own[:, :, 1:, 2] += right[..., 1] * width
    own[:, :, 1:, 3] += right[..., 0] * width**3 / 12
    own[:, :, 1:, 5] += right[..., 2] * width
    return own


def _cut(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, lines: FloatArray
) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cut straight pieces (a0, b0)-(a1, b1) where coordinate a crosses a line.

    Returns, for each piece after cutting, which one it came from, and its ends a0, a1, b0, b1.
    """
    first, last = np.searchsorted(lines, a0, side="right"), np.searchsorted(lines, a1, side="right")
    crossings = np.abs(last - first)
    source = np.repeat(np.arange(len(a0)), crossings + 1)
    start = np.concatenate([[0], np.cumsum(crossings + 1)])[:-1]
    order = np.arange(len(source)) - start[source]  # 0 .. crossings along each piece
    rising = last >= first
    # The k-th crossed line: upwards first, first + 1, ...; downwards first - 1, first - 2, ...
    line = np.where(rising[source], first[source] + order, first[source] - 1 - order)
    is_last = order == crossings[source]
    a = np.where(is_last, a1[source], lines[np.minimum(np.maximum(line, 0), len(lines) - 1)])
    span = a1 - a0
    part = np.where(is_last, 1.0, (a - a0[source]) / np.where(span == 0, 1.0, span)[source])
    b = np.where(is_last, b1[source], b0[source] + part * (b1 - b0)[source])
    begin = order == 0
    a_start, b_start = np.empty_like(a), np.empty_like(b)
    a_start[1:], b_start[1:] = a[:-1], b[:-1]
    a_start[begin], b_start[begin] = a0, b0
    return source, a_start, a, b_start, b


def covers(contours: Sequence[FloatArray], points: FloatArray) -> NDArray[np.bool_]:
    """Tell which points (n, 2) mm lie inside closed contours (even-odd rule): (n,) True inside."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in edges_of(contours):
        if y0 != y1:
            crossed = (y0 <= y) != (y1 <= y)
            inside ^= crossed & (x < x0 + (y - y0) * ((x1 - x0) / (y1 - y0)))
    return inside
