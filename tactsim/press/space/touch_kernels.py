"""The inner loops of a touch in space: how far each point of the pad is from a mesh, and where the layer balances.

Each facet that looks at the pad is drawn into a height map over the pad's lattice and the nearest wins, so nothing
has to be cut or searched to know what hides what. The force on the layer then grows with the travel as a sum of springs
that begin one after another, which Newton's method inverts exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, void

from tactsim.core.compiling import INTS_2D, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled

STATE = 3  # what `touch_all` finds: travel mm, force N, the layer's stiffness N/mm^3

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


@compiled(void(REALS_2D, INTS_2D, REALS, REALS, int64, int64, REALS), called_from_python=False)
def draw(
    corners: Reals, faces: Ints, origin: Reals, step: Reals, columns: int, rows: int, height: Reals
) -> None:
    """Draw facets into a height map: the least z of those that look along -z, over each point of a lattice.

    corners: (v, 3) mm in the sensor frame. faces: (f, 3) numbers of corners, counter-clockwise seen from outside.
    origin, step: (2,) mm, the first point of the lattice and the way to the next. Fills height (rows * columns,) mm,
    infinite where there is nothing.
    """
    height[:] = np.inf
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2] - az
        cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2] - az
        twice_area = bx * cy - by * cx
        if twice_area > -_EDGE_ON * (bx * bx + by * by + bz * bz + cx * cx + cy * cy + cz * cz):
            continue
        left = math.ceil((ax + min(bx, cx, 0.0) - origin[0]) / step[0] - _ON_EDGE)
        right = math.floor((ax + max(bx, cx, 0.0) - origin[0]) / step[0] + _ON_EDGE)
        low = math.ceil((ay + min(by, cy, 0.0) - origin[1]) / step[1] - _ON_EDGE)
        high = math.floor((ay + max(by, cy, 0.0) - origin[1]) / step[1] + _ON_EDGE)
        left, right, low, high = max(left, 0), min(right, columns - 1), max(low, 0), min(high, rows - 1)
        for row in range(low, high + 1):
            y = origin[1] + row * step[1] - ay
            for column in range(left, right + 1):
                x = origin[0] + column * step[0] - ax
                of_b, of_c = (x * cy - y * cx) / twice_area, (bx * y - by * x) / twice_area
                if of_b >= -_ON_EDGE and of_c >= -_ON_EDGE and of_b + of_c <= 1 + _ON_EDGE:
                    point = row * columns + column
                    height[point] = min(height[point], az + of_b * bz + of_c * cz)


@compiled(float64(REALS, REALS, int64, float64), called_from_python=False)
def springs(gap: Reals, rate: Reals, count: int, travel: float) -> float:
    """Add up springs that begin at gap (count,) mm and give rate (count,): returns what they give after a travel."""
    total = 0.0
    for point in range(count):
        total += rate[point] * max(travel - gap[point], 0.0)
    return total


@compiled(float64(REALS, REALS, int64, float64, float64), called_from_python=False)
def balance(gap: Reals, rate: Reals, count: int, travel: float, wanted: float) -> float:
    """Find the travel, mm, at which springs give what is wanted, from a travel that is not too short.

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
        travel = min((wanted + moment) / total, travel)


@compiled(
    void(
        REALS_2D, INTS_2D, REALS_2D, REALS_3D, REALS, REALS, int64, int64, REALS, REALS, REALS_2D, REALS,
        float64, float64, REALS, REALS_2D, REALS_3D,
    )
)  # fmt: skip
def touch_all(
    vertices: Reals, faces: Ints, places: Reals, rotations: Reals, origin: Reals, step: Reals, columns: int, rows: int,
    surface: Reals, facing: Reals, felt: Reals, forces: Reals, stiffness: float, thickness: float, strokes: Reals,
    states: Reals, images: Reals,
) -> None:  # fmt: skip
    """Let the pad come along its z axis until it carries a force, from n starts.

    vertices (v, 3) mm, faces (f, 3): the mesh. places (n, 3) mm, rotations (n, 3, 3): sensor_in_object at the starts.
    origin, step (2,) mm, columns, rows: the lattice along the pad's x and y. surface: (points,) mm, the pad's z there,
    NaN beside the pad. facing: (points,), the part along z of the pad's normal there. felt: (points, taxels), what a
    taxel reads of a unit of pressure there. forces: (frames,) N, rising, the last at rest. stiffness: N/mm^3 and
    thickness: mm, of the layer. strokes: (n,) mm at most.
    Fills states (n, STATE) and images (n, frames, taxels), in the unit of `forces` a mm^2. A touch that meets nothing
    has a force of 0; one that the stroke ends before the force is reached rests there with what it carries.
    """
    area = step[0] * step[1]
    corners, height = np.empty_like(vertices), np.empty(columns * rows)
    gap, rate = np.empty(columns * rows), np.empty(columns * rows)
    at = np.empty(columns * rows, np.int64)
    for touch in range(len(places)):
        seen_from(vertices, places[touch], rotations[touch], corners)
        draw(corners, faces, origin, step, columns, rows, height)
        first = np.inf
        for point in range(len(height)):
            height[point] -= surface[point]
            if height[point] < first:
                first = height[point]
        stroke = strokes[touch]
        states[touch, 0], states[touch, 1], states[touch, 2] = stroke, 0.0, stiffness
        images[touch, :, :] = 0.0
        if not first < stroke:
            continue
        count = 0
        for point in range(len(height)):
            if height[point] < first + thickness:
                gap[count], at[count] = height[point], point
                # Pressure is along the normal, by a depth along the normal: of both the part along z counts, over a
                # surface that is larger than its shadow by one such part.
                rate[count] = area * facing[point]
                count += 1
        most = springs(gap, rate, count, first + thickness)
        # A layer that would be pressed by more than its thickness is just stiff enough not to give so far.
        stiff = max(stiffness, forces[-1] / most)
        travel = first + thickness
        for frame in range(len(forces) - 1, -1, -1):
            travel = min(balance(gap, rate, count, travel, forces[frame] / stiff), stroke)
            if frame == len(forces) - 1:
                states[touch, 0], states[touch, 2] = travel, stiff
                states[touch, 1] = stiff * springs(gap, rate, count, travel)
            for near in range(count):
                if gap[near] < travel:
                    pressure = stiff * facing[at[near]] * (travel - gap[near])
                    for taxel in range(felt.shape[1]):
                        images[touch, frame, taxel] += pressure * felt[at[near], taxel]
