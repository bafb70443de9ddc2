"""Clip outlines with a grid of cells: exact areas and moments of what covers each cell.

A region's area, first and second moments follow from its boundary alone (Green's theorem). So an
outline is cut where it crosses a grid line, and each piece is added to the cell in which it lies and to
the cells on its right, as a rasteriser does. Nothing is sampled: the moments are exact for any polygon,
convex or not, with or without holes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray, transform

# A cell's moments are the integrals of 1, u, v, uu, uv, vv over its covered part, (u, v) from its centre.
MOMENTS = 6

# Gauss quadrature on [0, 1]: two points integrate cubics exactly, and every integrand below is a cubic along a
# straight piece.
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
    Returns (6, n, rows, columns): area mm^2, first moments mm^3 and second moments mm^4 about each
    cell's centre, in the order above.
    """
    count, rows, columns = len(poses), len(y_lines) - 1, len(x_lines) - 1
    ends = transform(poses, edges.reshape(-1, 2)).reshape(count * len(edges), 4)
    pose = np.repeat(np.arange(count), len(edges))
    x0, y0, x1, y1 = ends.T
    # Edges above, below or to the right of the grid bound nothing that is covered in it.
    near = (
        (np.maximum(y0, y1) > y_lines[0])
        & (np.minimum(y0, y1) < y_lines[-1])
        & (np.minimum(x0, x1) < x_lines[-1])
    )
    pose, x0, y0, x1, y1 = pose[near], x0[near], y0[near], x1[near], y1[near]
    piece, row, y0, y1, x0, x1 = _cut(y0, y1, x0, x1, y_lines)
    inside = (row >= 0) & (row < rows)
    pose, row = pose[piece][inside], row[inside]
    piece, column, x0, x1, y0, y1 = _cut(x0[inside], x1[inside], y0[inside], y1[inside], x_lines)
    inside = column < columns
    piece, column = piece[inside], column[inside]
    pose, row = pose[piece], row[piece]
    x0, x1, y0, y1 = x0[inside], x1[inside], y0[inside], y1[inside]
    # A piece left of the grid counts as one on the grid's left border: all cells of its row lie to its right.
    left = column < 0
    x0[left] = x1[left] = x_lines[0]
    column[left] = 0

    half_widths = np.diff(x_lines) / 2
    half, rise = half_widths[column], y1 - y0
    u0, u1 = x0 - (x_lines[:-1] + half_widths)[column], x1 - x0
    v0 = y0 - ((y_lines[:-1] + y_lines[1:]) / 2)[row]
    # Integrals over the region between a piece and its cell's right side, in the order of the moments, and of
    # v and vv along the piece, for the cells further right.
    integrals = np.zeros((MOMENTS + 2, len(row)))
    for t in _GAUSS:
        u, v = u0 + t * u1, v0 + t * rise
        width = half - u
        first, third = (half + u) * width / 2, (half * (half + u) + u * u) * width / 3
        vv = v * v
        for total, value in zip(
            integrals, (width, first, width * v, third, first * v, width * vv, v, vv), strict=True
        ):
            total += value
    integrals *= rise / -len(_GAUSS)  # a rising edge has the region on its left
    cell = (pose * rows + row) * columns + column
    sums = np.empty((len(integrals) + 1, count, rows, columns))
    for total, values in zip(sums, (*integrals, -rise), strict=True):
        total[...] = np.bincount(cell, values, count * rows * columns).reshape(total.shape)
    moments, (along_v, along_vv, along) = sums[:MOMENTS], sums[MOMENTS:, ..., :-1].cumsum(axis=-1)
    width = 2 * half_widths[1:]
    moments[0, ..., 1:] += along * width
    moments[2, ..., 1:] += along_v * width
    moments[3, ..., 1:] += along * (width**3 / 12)
    moments[5, ..., 1:] += along_vv * width
    return moments


def _cut(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, lines: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cut straight pieces (a0, b0)-(a1, b1) where coordinate a crosses a line.

    Returns, for each piece after cutting, which one it came from, between which lines it lies (k: beyond
    line k, -1: before the first), and its ends a0, a1, b0, b1.
    """
    first, last = np.searchsorted(lines, a0, side="right") - 1, np.searchsorted(lines, a1, side="right") - 1
    crossings = np.abs(last - first)
    source = np.repeat(np.arange(len(a0)), crossings + 1)
    begin = np.cumsum(crossings + 1) - (crossings + 1)
    order = np.arange(len(source)) - begin[source]  # 0 .. crossings along each piece
    direction = np.where(last >= first, 1, -1)
    between = first[source] + direction[source] * order
    # Each piece but the last ends on the line before it: the upper one going up, the lower one going down.
    ends = begin + crossings
    a = lines[np.clip(between + (direction[source] > 0), 0, len(lines) - 1)]
    span = a1 - a0
    b = b0[source] + (a - a0[source]) * ((b1 - b0) / np.where(span == 0, 1.0, span))[source]
    a[ends], b[ends] = a1, b1
    a_start, b_start = np.empty_like(a), np.empty_like(b)
    a_start[1:], b_start[1:] = a[:-1], b[:-1]
    a_start[begin], b_start[begin] = a0, b0
    return source, between, a_start, a, b_start, b


def covers(contours: Sequence[FloatArray], points: FloatArray) -> NDArray[np.bool_]:
    """Tell which points (n, 2) mm lie inside closed contours (even-odd rule): (n,) True inside."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in edges_of(contours):
        if y0 != y1:
            crossed = (y0 <= y) != (y1 <= y)
            inside ^= crossed & (x < x0 + (y - y0) * ((x1 - x0) / (y1 - y0)))
    return inside
