"""The inner loops of a touch in space: how far each point of the pad is from a mesh, and where the layer balances.

Each facet that looks at the pad is drawn into a height map over the pad's lattice and the nearest wins, so nothing
has to be cut or searched to know what hides what. The force on the layer then grows with the travel as a sum of springs
that begin one after another, which Newton's method inverts exactly. That is done on every third line of the lattice,
and then again on all lines about what touches, if that is small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.attach.layer_balance import approach
from tactsim.core.compiling import Ints1D, Ints2D, Reals1D, Reals2D, Reals3D, compiled
from tactsim.press.facet_kernels import cut

STATE = 3  # what `touch_all` finds: travel mm, force N, the layer's stiffness N/mm^3

COARSE = 3  # lines of the lattice from one to the next of those on which a touch is found
_CORNERS = 8  # room for a polygon: a triangle cut by four lines
_FINE = 16_000  # points of the lattice about a contact up to which it is looked at on all lines
_MARGIN = 0.5  # mm that the pad may go further, or less far, on all lines

_EDGE_ON = 1e-9  # a facet with a smaller share of its area across the stroke is a wall that the pad passes
_ON_EDGE = 1e-9  # by which a point may miss a facet and still be on it, so that none falls between two


class Mesh(NamedTuple):
    """The object: vertices (v, 3) mm, and faces (f, 3), the numbers of corners, counter-clockwise seen from outside."""

    vertices: Reals2D
    faces: Ints2D


class Starts(NamedTuple):
    """Where n touches begin: places (n, 3) mm and rotations (n, 3, 3), sensor_in_object; strokes (n,) mm at most."""

    places: Reals2D
    rotations: Reals3D
    strokes: Reals1D


class Lattice(NamedTuple):
    """Points of the pad's unloaded surface, even along its x and y.

    origin, step: (2,) mm, the first point and the way to the next. columns, rows: how many along x and y, multiples of
    COARSE. bounds: (4,) mm, x low, x high, y low, y high of a flat pad, NaN of a curved one. surface: (points,) mm, z
    there, NaN beside the pad. facing: (points,), the part along z of the normal.
    cell: (points, 2), where each is in felt_u (2, cells, columns of taxels) and felt_v (2, cells, rows of taxels): the
    share of a force that the taxels feel along the surface, for points on all lines and on every COARSE-th.
    """

    origin: Reals1D
    step: Reals1D
    columns: int
    rows: int
    bounds: Reals1D
    surface: Reals1D
    facing: Reals1D
    cell: Ints2D
    felt_u: Reals3D
    felt_v: Reals3D


class Layer(NamedTuple):
    """The pad's layer: its stiffness, N/mm^3, and its thickness, mm."""

    stiffness: float
    thickness: float


@compiled(called_from_python=False)
def seen_from(vertices: Reals2D, place: Reals1D, rotation: Reals2D, corners: Reals2D) -> None:
    """Write vertices (v, 3) mm in the frame at place (3,) mm with the axes rotation (3, 3): fills corners (v, 3)."""
    for corner in range(len(vertices)):
        x, y, z = (
            vertices[corner, 0] - place[0],
            vertices[corner, 1] - place[1],
            vertices[corner, 2] - place[2],
        )
        for axis in range(3):
            corners[corner, axis] = rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z


@compiled(called_from_python=False)
def draw(
    corners: Reals2D, faces: Ints2D, origin: Reals1D, step: Reals1D, window: Ints1D, height: Reals1D
) -> None:
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


@compiled(called_from_python=False)
def foremost(corners: Reals2D, faces: Ints2D, bounds: Reals1D, corner: Reals2D, spare: Reals2D) -> float:
    """Find the least z of all facets that look along -z before a flat pad: mm, infinite if there is none.

    A point of the lattice may miss a sharp tip by much. bounds: (4,) x low, x high, y low, y high of the pad, mm.
    corner, spare: room for a polygon.
    """
    first = np.inf
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        if min(corners[a, 2], corners[b, 2], corners[c, 2]) >= first:
            continue
        low_x, high_x = (
            min(corners[a, 0], corners[b, 0], corners[c, 0]),
            max(corners[a, 0], corners[b, 0], corners[c, 0]),
        )
        low_y, high_y = (
            min(corners[a, 1], corners[b, 1], corners[c, 1]),
            max(corners[a, 1], corners[b, 1], corners[c, 1]),
        )
        if high_x <= bounds[0] or low_x >= bounds[1] or high_y <= bounds[2] or low_y >= bounds[3]:
            continue
        bx, by = corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1]
        cx, cy = corners[c, 0] - corners[a, 0], corners[c, 1] - corners[a, 1]
        if bx * cy - by * cx >= 0:
            continue
        for k in range(3):
            corner[0, k], corner[1, k], corner[2, k] = corners[a, k], corners[b, k], corners[c, k]
        count = 3
        for axis in range(2):
            count = cut(corner, count, axis, 1.0, bounds[2 * axis], spare)
            count = cut(corner, count, axis, -1.0, bounds[2 * axis + 1], spare)
        for k in range(count):
            first = min(first, corner[k, 2])
    return first


@compiled(called_from_python=False)
def gather(
    height: Reals1D, lattice: Lattice, window: Ints1D, stride: int, front: float, reach: float, point_number: Ints1D,
    gap: Reals1D,
) -> int:  # fmt: skip
    """List the points of a window that lie less than `reach` mm behind the foremost; returns how many.

    height: mm, of the window, on every stride-th line of the lattice. front: mm, where something is known to be, or
    infinite. Fills gap with the ways mm from the pad and point_number with the points' numbers on the lattice.
    """
    surface, columns = lattice.surface, lattice.columns
    first = front
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
                    gap[count], point_number[count] = away, start + stride * column
                    count += 1
    return count


@compiled(called_from_python=False)
def springs(gap: Reals1D, rate: Reals1D, count: int, travel: float) -> float:
    """Add up springs that begin at gap (count,) mm and give rate (count,) a mm: what they give after a travel."""
    total = 0.0
    for point in range(count):
        total += rate[point] * max(travel - gap[point], 0.0)
    return total


@compiled(called_from_python=False)
def surround(
    point_number: Ints1D, gap: Reals1D, count: int, columns: int, rows: int, limit: float, window: Ints1D
) -> int:  # fmt: skip
    """Find the window of the whole lattice about the points whose gap is less than `limit` mm; returns its size."""
    left, right, low, high = columns, -1, rows, -1
    for point in range(count):
        if gap[point] < limit:
            row, column = point_number[point] // columns, point_number[point] % columns
            left, right, low, high = min(left, column), max(right, column), min(low, row), max(high, row)
    window[0], window[1] = max(left - COARSE, 0), max(low - COARSE, 0)
    window[2] = min(right + COARSE, columns - 1) - window[0] + 1
    window[3] = min(high + COARSE, rows - 1) - window[1] + 1
    return window[2] * window[3]


@compiled()
def touch_all(
    mesh: Mesh, starts: Starts, lattice: Lattice, layer: Layer, force: float, states: Reals2D, images: Reals2D
) -> None:
    """Let the pad come along its z axis until it carries a force, N, from n starts.

    Fills states (n, STATE) and images (n, taxels) N. A touch that meets nothing has a force of 0; one that the
    stroke ends before the force is reached rests there with what it carries.
    """
    vertices, faces, bounds = mesh.vertices, mesh.faces, lattice.bounds
    origin, step, columns, rows = lattice.origin, lattice.step, lattice.columns, lattice.rows
    stiffness, thickness = layer.stiffness, layer.thickness
    corners, height = np.empty_like(vertices), np.empty(columns * rows)
    gap, rate = np.empty(columns * rows), np.empty(columns * rows)
    along = np.ones(columns * rows)  # springs are pressed along the pad's normal alone
    point_number = np.empty(columns * rows, np.int64)
    window, corner, spare = np.empty(4, np.int64), np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    coarse_origin = origin + (COARSE // 2) * step
    across = lattice.felt_u.shape[2]
    for touch in range(len(starts.places)):
        seen_from(vertices, starts.places[touch], starts.rotations[touch], corners)
        travel, stiff, stroke = starts.strokes[touch], stiffness, starts.strokes[touch]
        states[touch, 0], states[touch, 1], states[touch, 2] = stroke, 0.0, stiffness
        images[touch, :] = 0.0
        window[0], window[1], window[2], window[3] = 0, 0, columns // COARSE, rows // COARSE
        front = foremost(corners, faces, bounds, corner, spare)
        draw(corners, faces, coarse_origin, COARSE * step, window, height)
        level, stride, deep = 1, COARSE, True
        while True:
            area = stride * stride * step[0] * step[1]
            count = gather(height, lattice, window, stride, front, thickness, point_number, gap)
            first = front
            for point in range(count):
                # A surface under a force along its normal, by a depth along its normal: of both the part along z
                # counts, over an area larger than its shadow by one such part.
                rate[point] = area * lattice.facing[point_number[point]]
                first = min(first, gap[point])
            if not (count and first < stroke):
                break
            if deep:
                # A layer that would be pressed by more than its thickness is just stiff enough not to give so far.
                stiff = max(stiffness, force / springs(gap, rate, count, first + thickness))
            travel = approach(gap[:count], rate, along, force / stiff)
            if (
                level == 0
                or surround(point_number, gap, count, columns, rows, travel + _MARGIN, window) > _FINE
            ):
                break
            draw(corners, faces, origin, step, window, height)
            level, stride, deep = 0, 1, travel + _MARGIN >= first + thickness
        if not (count and first < stroke):
            continue
        travel = min(travel, stroke)
        states[touch, 0], states[touch, 2] = travel, stiff
        states[touch, 1] = stiff * springs(gap, rate, count, travel)
        for point in range(count):
            if gap[point] < travel:
                carried = stiff * area * (travel - gap[point])
                u, v = lattice.cell[point_number[point], 0], lattice.cell[point_number[point], 1]
                for row in range(lattice.felt_v.shape[2]):
                    strip = carried * lattice.felt_v[level, v, row]
                    for column in range(across):
                        images[touch, row * across + column] += strip * lattice.felt_u[level, u, column]
