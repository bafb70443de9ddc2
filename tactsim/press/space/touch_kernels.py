"""The inner loops of a touch in space: how far each point of the pad is from a mesh, and where the layer balances.

Each facet that looks at the pad is drawn into a height map over the pad's lattice and the nearest wins, so nothing
has to be cut or searched to know what hides what. The force on the layer then grows with the travel as a sum of springs
that begin one after another, which Newton's method inverts exactly. That is done on every third line of the lattice,
and then again on all lines about what touches, if that is small.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, void

from tactsim.core.compiling import INTS, INTS_2D, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled

STATE = 3  # what `touch_all` finds: travel mm, force N, the layer's stiffness N/mm^3

COARSE = 3  # lines of the lattice from one to the next of those on which a touch is found
_FINE = 16_000  # points of the lattice about a contact up to which it is looked at on all lines
_MARGIN = 0.3  # mm that the pad may go further, or less far, on all lines

_EDGE_ON = 1e-9  # a facet with a smaller share of its area across the stroke is a wall that the pad passes
_ON_EDGE = 1e-9  # by which a point may miss a facet and still be on it, so that none falls between two


@compiled(void(REALS_2D, REALS, REALS_2D, REALS_2D), called_from_python=False)
def seen_from(vertices: Reals, place: Reals, rotation: Reals, corners: Reals) -> None:
    """Write vertices (v, 3) mm in the frame at place (3,) mm with the axes rotation (3, 3): fills corners (v, 3)."""
    for corner in range(len(vertices)):
        x, y, z = (
            vertices[corner, 0] - place[0],
            vertices[corner, 1] - place[1],
            vertices[corner, 2] - place[2],
        )
        for axis in range(3):
            corners[corner, axis] = rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z


@compiled(void(REALS_2D, INTS_2D, REALS, REALS, INTS, REALS), called_from_python=False)
def draw(corners: Reals, faces: Ints, origin: Reals, step: Reals, window: Ints, height: Reals) -> None:
    """Draw facets into a height map: the least z of those that look along -z, over each point of a lattice.

    corners: (v, 3) mm in the sensor frame. faces: (f, 3) numbers of corners, counter-clockwise seen from outside.
    origin, step: (2,) mm, the first point of the lattice and the way to the next. window: (4,), the first column and
    row that are wanted, and how many. Fills height mm, of the window row by row, infinite where there is nothing.
    """
    columns, rows = window[2], window[3]
    height[: columns * rows] = np.inf
    x_first, y_first = origin[0] + window[0] * step[0], origin[1] + window[1] * step[1]
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2] - az
        cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2] - az
        twice_area = bx * cy - by * cx
        if twice_area > -_EDGE_ON * (bx * bx + by * by + bz * bz + cx * cx + cy * cy + cz * cz):
            continue
        left = math.ceil((ax + min(bx, cx, 0.0) - x_first) / step[0] - _ON_EDGE)
        right = math.floor((ax + max(bx, cx, 0.0) - x_first) / step[0] + _ON_EDGE)
        low = math.ceil((ay + min(by, cy, 0.0) - y_first) / step[1] - _ON_EDGE)
        high = math.floor((ay + max(by, cy, 0.0) - y_first) / step[1] + _ON_EDGE)
        left, right, low, high = max(left, 0), min(right, columns - 1), max(low, 0), min(high, rows - 1)
        for row in range(low, high + 1):
            y = y_first + row * step[1] - ay
            for column in range(left, right + 1):
                x = x_first + column * step[0] - ax
                of_b, of_c = (x * cy - y * cx) / twice_area, (bx * y - by * x) / twice_area
                if of_b >= -_ON_EDGE and of_c >= -_ON_EDGE and of_b + of_c <= 1 + _ON_EDGE:
                    point = row * columns + column
                    height[point] = min(height[point], az + of_b * bz + of_c * cz)


@compiled(int64(REALS, REALS, INTS, int64, int64, float64, INTS, REALS), called_from_python=False)
def gather(
    height: Reals, surface: Reals, window: Ints, stride: int, columns: int, reach: float, at: Ints, gap: Reals
) -> int:  # fmt: skip
    """List the points of a window that lie less than `reach` mm behind the foremost; returns how many.

    height: mm, of the window, on every stride-th line of the lattice. surface: (points,) mm, the pad's z on the whole
    lattice, which has `columns` lines along y. Fills gap with the way mm from the pad and at with their numbers on it.
    """
    first = np.inf
    for turn in range(2):
        count = 0
        for row in range(window[3]):
            start = (stride * (window[1] + row) + stride // 2) * columns + stride * window[0] + stride // 2
            for column in range(window[2]):
                away = height[row * window[2] + column] - surface[start + stride * column]
                if turn == 0:
                    if away < first:  # not where the surface is NaN
                        first = away
                elif away <= first + reach and away < np.inf:
                    gap[count], at[count] = away, start + stride * column
                    count += 1
    return count


@compiled(float64(REALS, REALS, int64, float64), called_from_python=False)
def springs(gap: Reals, rate: Reals, count: int, travel: float) -> float:
    """Add up springs that begin at gap (count,) mm and give rate (count,) a mm: what they give after a travel."""
    total = 0.0
    for point in range(count):
        total += rate[point] * max(travel - gap[point], 0.0)
    return total


@compiled(float64(REALS, REALS, int64, float64, float64), called_from_python=False)
def balance(gap: Reals, rate: Reals, count: int, travel: float, wanted: float) -> float:
    """Find the travel, mm, at which springs give what is wanted, from a travel at which some give something.

    The sum is convex and piecewise linear, so Newton's method comes from above and ends at the answer itself.
    """
    touching = -1
    while True:
        total = moment = 0.0
        now = 0
        for point in range(count):
            if gap[point] < travel:
                total += rate[point]
                moment += rate[point] * gap[point]
                now += 1
        if now == touching or now == 0:
            return travel
        touching = now
        travel = (wanted + moment) / total


@compiled(int64(INTS, REALS, int64, int64, int64, float64, INTS), called_from_python=False)
def surround(
    at: Ints, gap: Reals, count: int, columns: int, rows: int, limit: float, window: Ints
) -> int:  # fmt: skip
    """Find the window of the whole lattice about the points whose gap is less than `limit` mm; returns its size."""
    left, right, low, high = columns, -1, rows, -1
    for point in range(count):
        if gap[point] < limit:
            row, column = at[point] // columns, at[point] % columns
            left, right, low, high = min(left, column), max(right, column), min(low, row), max(high, row)
    window[0], window[1] = max(left - COARSE, 0), max(low - COARSE, 0)
    window[2] = min(right + COARSE, columns - 1) - window[0] + 1
    window[3] = min(high + COARSE, rows - 1) - window[1] + 1
    return window[2] * window[3]


@compiled(
    void(
        REALS_2D, INTS_2D, REALS_2D, REALS_3D, REALS, REALS, int64, int64, REALS, REALS, INTS_2D, REALS_3D, REALS_3D,
        REALS, float64, float64, REALS, REALS_2D, REALS_3D,
    )
)  # fmt: skip
def touch_all(
    vertices: Reals, faces: Ints, places: Reals, rotations: Reals, origin: Reals, step: Reals, columns: int, rows: int,
    surface: Reals, facing: Reals, cell: Ints, felt_u: Reals, felt_v: Reals, forces: Reals, stiffness: float,
    thickness: float, strokes: Reals, states: Reals, images: Reals,
) -> None:  # fmt: skip
    """Let the pad come along its z axis until it carries a force, from n starts.

    vertices (v, 3) mm, faces (f, 3): the mesh. places (n, 3) mm, rotations (n, 3, 3): sensor_in_object at the starts.
    origin, step (2,) mm, columns, rows: the lattice along the pad's x and y, columns and rows multiples of COARSE.
    surface: (points,) mm, the pad's z there, NaN beside the pad. facing: (points,), the part along z of the normal.
    cell: (points, 2), where felt_u (2, cells, columns of taxels) and felt_v (2, cells, rows of taxels) hold what the
    taxels feel along u and v of a force there, that of a point on all lines and on every COARSE-th. forces: (frames,)
    N, rising, the last at rest. stiffness: N/mm^3 and thickness: mm, of the layer. strokes: (n,) mm at most.
    Fills states (n, STATE) and images (n, frames, taxels) N. A touch that meets nothing has a force of 0; one that the
    stroke ends before the force is reached rests there with what it carries.
    """
    corners, height = np.empty_like(vertices), np.empty(columns * rows)
    gap, rate, at = np.empty(columns * rows), np.empty(columns * rows), np.empty(columns * rows, np.int64)
    window = np.empty(4, np.int64)
    coarse_origin = origin + (COARSE // 2) * step
    across = felt_u.shape[2]
    for touch in range(len(places)):
        seen_from(vertices, places[touch], rotations[touch], corners)
        travel, stiff, stroke = strokes[touch], stiffness, strokes[touch]
        states[touch, 0], states[touch, 1], states[touch, 2] = stroke, 0.0, stiffness
        images[touch, :, :] = 0.0
        window[0], window[1], window[2], window[3] = 0, 0, columns // COARSE, rows // COARSE
        draw(corners, faces, coarse_origin, COARSE * step, window, height)
        level, stride = 1, COARSE
        while True:
            area = stride * stride * step[0] * step[1]
            count = gather(height, surface, window, stride, columns, thickness, at, gap)
            first = np.inf
            for point in range(count):
                # A surface under a force along its normal, by a depth along its normal: of both the part along z
                # counts, over an area larger than its shadow by one such part.
                rate[point] = area * facing[at[point]]
                first = min(first, gap[point])
            if not first < stroke:
                break
            if level or stiff > stiffness:
                # A layer that would be pressed by more than its thickness is just stiff enough not to give so far.
                stiff = max(stiffness, forces[-1] / springs(gap, rate, count, first + thickness))
            travel = balance(gap, rate, count, first + thickness, forces[-1] / stiff)
            if level == 0 or surround(at, gap, count, columns, rows, travel + _MARGIN, window) > _FINE:
                break
            draw(corners, faces, origin, step, window, height)
            level, stride = 0, 1
        if not first < stroke:
            continue
        travel = min(travel, stroke)
        states[touch, 0], states[touch, 2] = travel, stiff
        states[touch, 1] = stiff * springs(gap, rate, count, travel)
        for frame in range(len(forces)):
            rest = min(balance(gap, rate, count, travel, forces[frame] / stiff), travel)
            for point in range(count):
                if gap[point] < rest:
                    force = stiff * area * (rest - gap[point])
                    u, v = cell[at[point], 0], cell[at[point], 1]
                    for row in range(felt_v.shape[2]):
                        strip = force * felt_v[level, v, row]
                        for column in range(across):
                            images[touch, frame, row * across + column] += strip * felt_u[level, u, column]
