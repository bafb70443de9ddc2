"""Clip outlines with a grid of cells: exact areas and moments of what covers each cell.

A region's area and its first to third moments follow from its boundary alone (Green's theorem). So an outline is cut
where it crosses a grid line, and each piece is added to the cell in which it lies and to the cells on its right, as a
rasteriser does. Nothing is sampled: the moments are exact for any polygon, convex or not, with or without holes.

Of a tilted face only the part on one side of a line touches. The outline is cut there too, and what lies beyond is
moved onto the line. The moved pieces run to and fro along it and close the outline without enclosing anything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray, transform

# A cell's moments are the integrals of these over its covered part, (u, v) from its centre: 1, u, v, uu, uv, vv,
# and where the pressure varies within a cell also uuu, uuv, uvv, vvv.
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
EVEN_MOMENTS = 6  # moments that pressure which is even within a cell needs
MOMENTS = len(POWERS)

LEVEL = 1e-12  # slopes below this count as level
_TINY = 1e-300  # mm: a piece that spans less lies on a line, and its slope may be above what doubles hold

# Gauss quadrature on [0, 1], points and weights: two points integrate cubics exactly, three points quintics. Along a
# straight piece the integrands of second moments are cubics, those of third moments are quartics.
_GAUSS = {
    EVEN_MOMENTS: ((0.5 - np.sqrt(1 / 12), 1 / 2), (0.5 + np.sqrt(1 / 12), 1 / 2)),
    MOMENTS: ((0.5 - np.sqrt(0.15), 5 / 18), (0.5, 8 / 18), (0.5 + np.sqrt(0.15), 5 / 18)),
}


def edges_of(contours: Sequence[FloatArray]) -> FloatArray:
    """List the edges of closed contours: (edges, 2 ends, 2) mm, in the contours' sense of rotation."""
    return np.concatenate([np.stack([c, np.roll(c, -1, axis=0)], axis=1) for c in contours])


def cell_moments(
    edges: FloatArray,
    poses: FloatArray,
    x_lines: FloatArray,
    y_lines: FloatArray,
    *,
    plane: FloatArray | None = None,
    depth: FloatArray | None = None,
    moments: int = EVEN_MOMENTS,
) -> FloatArray:
    """Integrate over the part of each cell that a posed outline covers.

    edges: (edges, 2, 2) mm, outer contours counter-clockwise, holes clockwise. poses: (n, 3), the outline's frame in
    the grid's. x_lines (columns + 1,), y_lines (rows + 1,): the grid, mm. plane: (n, 2, 2), by which the posed outline
    is mapped further, as a tilt foreshortens it. depth: (n, 3) [c, a, b]: only what lies where c + a x + b y > 0
    counts; without it everything does. moments: EVEN_MOMENTS or MOMENTS. Returns (moments, n, rows, columns): area
    mm^2, first moments mm^3, second mm^4 and third mm^5 about each cell's centre, in the order of POWERS.
    """
    count, rows, columns = len(poses), len(y_lines) - 1, len(x_lines) - 1
    ends = transform(poses, edges.reshape(-1, 2))
    if plane is not None:
        ends = ends @ plane.swapaxes(-1, -2)
    ends = ends.reshape(count * len(edges), 4)
    pose = np.repeat(np.arange(count), len(edges))
    if depth is not None:
        pose, ends = _cut_off(pose, ends, depth)
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
    # powers of v along the piece, for the cells further right.
    integrals = np.zeros((moments + (3 if moments == MOMENTS else 2), len(row)))
    for t, weight in _GAUSS[moments]:
        u, v = u0 + t * u1, v0 + t * rise
        width = (half - u) * weight  # a factor of all values but the powers of v
        first, third = (half + u) * width / 2, (half * (half + u) + u * u) * width / 3
        vv = v * v
        values = [width, first, width * v, third, first * v, width * vv]
        if moments == MOMENTS:
            values += [first * (half * half + u * u) / 2, third * v, first * vv, width * vv * v]
        values += [v * weight, vv * weight]
        if moments == MOMENTS:
            values.append(vv * v * weight)
        for total, value in zip(integrals, values, strict=True):
            total += value
    integrals *= -rise  # a rising edge has the region on its left
    cell = (pose * rows + row) * columns + column
    sums = np.empty((len(integrals) + 1, count, rows, columns))
    for total, of_pieces in zip(sums, (*integrals, -rise), strict=True):
        total[...] = np.bincount(cell, of_pieces, count * rows * columns).reshape(total.shape)
    result, along = sums[:moments], sums[moments:, ..., :-1].cumsum(axis=-1)
    width = 2 * half_widths[1:]
    result[0, ..., 1:] += along[-1] * width
    result[2, ..., 1:] += along[0] * width
    result[3, ..., 1:] += along[-1] * (width**3 / 12)
    result[5, ..., 1:] += along[1] * width
    if moments == MOMENTS:
        result[7, ..., 1:] += along[0] * (width**3 / 12)
        result[9, ..., 1:] += along[2] * width
    return result


def _cut_off(
    pose: NDArray[np.intp], ends: FloatArray, depth: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """Cut edges where a posed depth crosses 0, and move what lies beyond onto the line where it is 0.

    pose: (edges,). ends: (edges, 4) x0, y0, x1, y1. depth: (n, 3), as in `cell_moments`.
    """
    slopes = np.where(np.abs(depth[:, 1:]) < LEVEL, 0.0, depth[:, 1:])
    kept = (slopes.any(axis=1) | (depth[:, 0] > 0))[pose]  # what is level is met wholly or not at all
    pose, ends = pose[kept], ends[kept]
    level, slope = depth[pose, 0], slopes[pose]
    start, end = ends[:, :2], ends[:, 2:]
    at_start, at_end = (level + np.einsum("ed,ed->e", slope, point) for point in (start, end))
    outside = (at_start < 0) | (at_end < 0)
    if not outside.any():
        return pose, ends
    crossing = (at_start < 0) != (at_end < 0)
    steepness = np.einsum("ed,ed->e", slope, slope)
    down = np.divide(slope, steepness[:, None], out=np.zeros_like(slope), where=steepness[:, None] > 0)
    share = np.divide(at_start, at_start - at_end, out=np.zeros_like(at_start), where=crossing)[:, None]
    met = np.where(crossing[:, None], start + share * (end - start), end)
    start = start - np.minimum(at_start, 0)[:, None] * down
    end = end - np.minimum(at_end, 0)[:, None] * down
    met = np.where(crossing[:, None], met, end)
    first = np.concatenate([start, met], axis=1)
    second = np.concatenate([met, end], axis=1)[crossing]
    return np.concatenate([pose, pose[crossing]]), np.concatenate([first, second])


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
    slope = (b1 - b0) / np.where(np.abs(span) < _TINY, 1.0, span)
    b = b0[source] + (a - a0[source]) * slope[source]
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
