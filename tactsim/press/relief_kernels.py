"""The inner loops of a press of relief: cut facets where they leave the contact, the pad or a cell, and integrate.

A facet is a triangle seen from above. Over it the depth by which the pad has given way, depth - gap +
y tilt_x - x tilt_y, is linear, so the facet's part in contact is a convex polygon, and what the springs
under it carry is an integral of polynomials: nothing is sampled.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, void

from tactsim.core.compiling import REALS, REALS_2D, REALS_3D, Reals, compiled

SUMS = 10  # what `integrate` adds up: 1, x, y, xx, xy, yy over the contact, and p, p x, p y, p p
STATE = 5  # what `settle` finds: depth mm, tilt_x and tilt_y rad, stiffness N/mm^3, and how it ended
SETTLED, NO_CONTACT, BURIED, TIPPED = 0.0, 1.0, 2.0, 3.0

_CORNERS = 16  # room for a polygon: a triangle cut by at most nine lines
_MOST_STEPS = 100
_BALANCE = 1e-10  # share of the force that may be missing
_STEEPEST = 0.3  # rad: a shape that tilts further has tipped over
_LEAST_AREA = 1e-9  # mm^2; what touches less than this does not touch


@compiled(int64(REALS_2D, int64, int64, float64, float64, REALS_2D), called_from_python=False)
def cut(corner: Reals, count: int, axis: int, sign: float, line: float, kept: Reals) -> int:
    """Keep the part of a convex polygon where sign * (its coordinate - line) >= 0; returns its corners' number.

    corner: (_CORNERS, 3), [x, y, depth], of which the first `count` are used. axis: 0, 1, 2. Fills `kept`.
    """
    found = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = sign * (corner[i, axis] - line), sign * (corner[j, axis] - line)
        if here >= 0:
            kept[found, 0], kept[found, 1], kept[found, 2] = corner[i, 0], corner[i, 1], corner[i, 2]
            found += 1
        if (here >= 0) != (there >= 0):
            share = here / (here - there)
            for k in range(3):
                kept[found, k] = corner[i, k] + share * (corner[j, k] - corner[i, k])
            kept[found, axis] = line
            found += 1
    return found


@compiled(
    int64(REALS_3D, int64, REALS, float64, float64, float64, REALS, float64, REALS_2D, REALS_2D),
    called_from_python=False,
)
def place(
    facets: Reals, index: int, pose: Reals, depth: float, tilt_x: float, tilt_y: float, bounds: Reals,
    least: float, corner: Reals, spare: Reals,
) -> int:  # fmt: skip
    """Put a facet before the pad and cut it with the pad and where it is less than `least` deep.

    facets: (facets, 3 corners, 3), [x, y, gap] mm. pose: (4,), x, y, cos, sin of sensor_in_object. bounds: (4,)
    x low, x high, y low, y high of the pad. Fills `corner` with [x, y, depth] in the sensor frame and returns the
    number of corners, 0 if nothing is left.
    """
    for i in range(3):
        u, v = facets[index, i, 0] - pose[0], facets[index, i, 1] - pose[1]
        x, y = pose[2] * u + pose[3] * v, pose[2] * v - pose[3] * u
        corner[i, 0], corner[i, 1] = x, y
        corner[i, 2] = depth - facets[index, i, 2] + y * tilt_x - x * tilt_y
    count = 3
    for axis in range(3):
        low = min(corner[0, axis], corner[1, axis], corner[2, axis])
        high = max(corner[0, axis], corner[1, axis], corner[2, axis])
        first = least if axis == 2 else bounds[2 * axis]
        last = np.inf if axis == 2 else bounds[2 * axis + 1]
        if high <= first or low >= last:
            return 0
    for axis in range(3):
        first = least if axis == 2 else bounds[2 * axis]
        low = high = corner[0, axis]
        for i in range(1, count):
            low, high = min(low, corner[i, axis]), max(high, corner[i, axis])
        if low < first:
            count = cut(corner, count, axis, 1.0, first, spare)
            corner[:count] = spare[:count]
        if axis < 2 and high > bounds[2 * axis + 1]:
            count = cut(corner, count, axis, -1.0, bounds[2 * axis + 1], spare)
            corner[:count] = spare[:count]
        if count < 3:
            return 0
    return count


@compiled(
    float64(REALS_3D, REALS, REALS, float64, float64, REALS, REALS_2D, REALS_2D), called_from_python=False
)
def foremost(
    facets: Reals, front: Reals, pose: Reals, tilt_x: float, tilt_y: float, bounds: Reals, corner: Reals,
    spare: Reals,
) -> float:  # fmt: skip
    """Find the depth, mm, at which the pad first touches; infinity if nothing lies before it."""
    reach = math.hypot(tilt_x, tilt_y) * math.hypot(max(-bounds[0], bounds[1]), max(-bounds[2], bounds[3]))
    touch = np.inf
    for index in range(len(facets)):
        if front[index] - reach > touch:
            break
        count = place(facets, index, pose, 0.0, tilt_x, tilt_y, bounds, -np.inf, corner, spare)
        for i in range(count):
            touch = min(touch, -corner[i, 2])
    return touch


@compiled(
    void(REALS_3D, REALS, REALS, float64, float64, float64, REALS, REALS_2D, REALS_2D, REALS),
    called_from_python=False,
)
def integrate(
    facets: Reals, front: Reals, pose: Reals, depth: float, tilt_x: float, tilt_y: float, bounds: Reals,
    corner: Reals, spare: Reals, total: Reals,
) -> None:  # fmt: skip
    """Add up over the contact what balances a press: fills total (SUMS,), p standing for the depth, mm."""
    total[:] = 0.0
    reach = math.hypot(tilt_x, tilt_y) * math.hypot(max(-bounds[0], bounds[1]), max(-bounds[2], bounds[3]))
    for index in range(len(facets)):
        if front[index] > depth + reach:
            break
        count = place(facets, index, pose, depth, tilt_x, tilt_y, bounds, 0.0, corner, spare)
        x0, y0, p0 = corner[0, 0], corner[0, 1], corner[0, 2]
        for i in range(1, count - 1):
            x1, y1, p1 = corner[i, 0], corner[i, 1], corner[i, 2]
            x2, y2, p2 = corner[i + 1, 0], corner[i + 1, 1], corner[i + 1, 2]
            area = abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2
            x, y, p, each = x0 + x1 + x2, y0 + y1 + y2, p0 + p1 + p2, area / 12
            total[0] += area
            total[1] += area * x / 3
            total[2] += area * y / 3
            total[3] += each * (x * x + x0 * x0 + x1 * x1 + x2 * x2)
            total[4] += each * (x * y + x0 * y0 + x1 * y1 + x2 * y2)
            total[5] += each * (y * y + y0 * y0 + y1 * y1 + y2 * y2)
            total[6] += area * p / 3
            total[7] += each * (p * x + p0 * x0 + p1 * x1 + p2 * x2)
            total[8] += each * (p * y + p0 * y0 + p1 * y1 + p2 * y2)
            total[9] += each * (p * p + p0 * p0 + p1 * p1 + p2 * p2)


@compiled(
    float64(
        REALS_3D, REALS, REALS, float64, float64, float64, float64, float64, float64, REALS, REALS_2D, REALS_2D,
        REALS,
    ),
    called_from_python=False,
)  # fmt: skip
def sink(
    facets: Reals, front: Reals, pose: Reals, touch: float, guess: float, tilt_x: float, tilt_y: float,
    force: float, stiffness: float, bounds: Reals, corner: Reals, spare: Reals, total: Reals,
) -> float:  # fmt: skip
    """Find the depth, mm, at which springs under a face that cannot turn carry the force, by Newton's method.

    The force is a convex, growing function of the depth, so a step from below overshoots, and from above
    every step stays above.
    """
    depth, low = touch + guess, touch
    for _ in range(_MOST_STEPS):
        integrate(facets, front, pose, depth, tilt_x, tilt_y, bounds, corner, spare, total)
        missing = force - stiffness * total[6]
        if abs(missing) <= _BALANCE * force:
            break
        if missing > 0:
            low = depth
        # Just behind the foremost point the contact is tiny and a step far too long.
        step = missing / (stiffness * total[0]) if total[0] > 0 else np.inf
        depth = max(min(depth + step, touch + 4 * (depth - touch)), (low + depth) / 2)
    return depth


@compiled(
    float64(
        REALS_3D, REALS, REALS, REALS, REALS, float64, float64, float64, REALS, REALS_2D, REALS_2D, REALS
    ),
    called_from_python=False,
)
def lean(
    facets: Reals, front: Reals, pose: Reals, tilt: Reals, at: Reals, wrist: float, force: float,
    stiffness: float, bounds: Reals, corner: Reals, spare: Reals, total: Reals,
) -> float:  # fmt: skip
    """Find where springs, force and a wrist balance: the lowest point of a convex energy, by Newton's method.

    tilt: (2,) rad, where the wrist pushes nowhere. at: (3,) depth and tilts to begin with, which are changed.
    wrist: N mm / rad. Returns how it ended.
    """
    before = np.inf
    gradient, step, kept = np.zeros(3), np.zeros(3), at.copy()
    share = 1.0
    for _ in range(_MOST_STEPS):
        integrate(facets, front, pose, at[0], at[1], at[2], bounds, corner, spare, total)
        turn_x, turn_y = at[1] - tilt[0], at[2] - tilt[1]
        energy = stiffness * total[9] / 2 - force * at[0] + wrist * (turn_x * turn_x + turn_y * turn_y) / 2
        if energy > before + 1e-14 * abs(before) and share > 1e-6:
            share /= 4
            for i in range(3):
                at[i] = kept[i] + share * step[i]
            continue
        gradient[0] = stiffness * total[6] - force
        gradient[1] = stiffness * total[8] + wrist * turn_x
        gradient[2] = -stiffness * total[7] + wrist * turn_y
        if max(abs(gradient[0]), abs(gradient[1]), abs(gradient[2])) <= _BALANCE * force:
            return SETTLED
        before, share = energy, 1.0
        area, x, y = stiffness * total[0], stiffness * total[1], stiffness * total[2]
        xx, xy, yy = stiffness * total[3] + wrist, stiffness * total[4], stiffness * total[5] + wrist
        # [[area, y, -x], [y, yy, -xy], [-x, -xy, xx]] step = -gradient, the depth eliminated first
        a, b, c = yy - y * y / area, -xy + x * y / area, xx - x * x / area
        f, g = gradient[1] - y * gradient[0] / area, gradient[2] + x * gradient[0] / area
        step[1], step[2] = (b * g - c * f) / (a * c - b * b), (b * f - a * g) / (a * c - b * b)
        step[0] = (-gradient[0] - y * step[1] + x * step[2]) / area
        for i in range(3):
            kept[i] = at[i]
            at[i] += step[i]
        if math.hypot(at[1], at[2]) > _STEEPEST:
            return TIPPED
    return TIPPED


@compiled(
    void(REALS_3D, REALS, REALS_2D, REALS_2D, REALS, float64, float64, float64, float64, float64, REALS_2D)
)
def settle(
    facets: Reals, front: Reals, poses: Reals, tilts: Reals, bounds: Reals, force: float, stiffness: float,
    thickness: float, wrist: float, height: float, states: Reals,
) -> None:  # fmt: skip
    """Find where each press rests: fills states (presses, STATE).

    facets: (facets, 3, 3) [x, y, gap] mm, ordered by front (facets,), the least gap of each. poses: (presses, 4)
    x, y, cos, sin. tilts: (presses, 2) rad. stiffness: N/mm^3. wrist: N mm / rad, infinite for a rigid one.
    height: mm to which the shape may sink in.
    """
    corner, spare, total = np.zeros((_CORNERS, 3)), np.zeros((_CORNERS, 3)), np.zeros(SUMS)
    at = np.zeros(3)
    for press in range(len(poses)):
        pose, state = poses[press], states[press]
        state[:] = 0.0
        state[4] = NO_CONTACT
        touch = foremost(facets, front, pose, 0.0, 0.0, bounds, corner, spare)
        if touch == np.inf:
            continue
        integrate(facets, front, pose, touch + thickness, 0.0, 0.0, bounds, corner, spare, total)
        if total[0] < _LEAST_AREA:
            continue
        # A layer that the level shape would press by more than its thickness is just stiff enough not to give so far.
        stiff = max(stiffness, force / total[6])
        # A paraboloid's force grows as the square of the depth.
        guess = thickness * math.sqrt(force / (stiff * total[6]))
        at[1], at[2] = tilts[press, 0], tilts[press, 1]
        touch = foremost(facets, front, pose, at[1], at[2], bounds, corner, spare)
        at[0] = sink(
            facets, front, pose, touch, guess, at[1], at[2], force, stiff, bounds, corner, spare, total
        )
        state[4] = SETTLED
        if wrist < np.inf:
            state[4] = lean(
                facets, front, pose, tilts[press], at, wrist, force, stiff, bounds, corner, spare, total
            )
        if state[4] == SETTLED and at[0] > height:
            state[4] = BURIED
        state[:3] = at
        state[3] = stiff


@compiled(void(REALS_2D, int64, float64, float64, float64, REALS, int64, int64), called_from_python=False)
def add_part(
    corner: Reals, count: int, x: float, y: float, stiffness: float, load: Reals, cell: int, cells: int
) -> None:
    """Add what one polygon carries to the moments of a cell about its centre (x, y): load (6 * cells,).

    A part's pressure is linear and the moments' powers quadratic, so four points integrate each triangle exactly
    (Strang and Fix, degree 3).
    """
    for i in range(1, count - 1):
        area = abs(
            (corner[i, 0] - corner[0, 0]) * (corner[i + 1, 1] - corner[0, 1])
            - (corner[i + 1, 0] - corner[0, 0]) * (corner[i, 1] - corner[0, 1])
        ) * (stiffness / 2)
        for point in range(4):
            third = 0.6 if point == 1 else 0.2
            first, second = 0.6 if point == 2 else 0.2, 0.6 if point == 3 else 0.2
            weight = area * 25 / 48
            if point == 0:
                first = second = third = 1 / 3
                weight = area * -27 / 48
            u = first * corner[0, 0] + second * corner[i, 0] + third * corner[i + 1, 0] - x
            v = first * corner[0, 1] + second * corner[i, 1] + third * corner[i + 1, 1] - y
            weight *= first * corner[0, 2] + second * corner[i, 2] + third * corner[i + 1, 2]
            load[cell] += weight
            load[cell + cells] += weight * u
            load[cell + 2 * cells] += weight * v
            load[cell + 3 * cells] += weight * u * u
            load[cell + 4 * cells] += weight * u * v
            load[cell + 5 * cells] += weight * v * v


@compiled(void(REALS_3D, REALS, REALS_2D, REALS_2D, REALS, REALS, REALS_2D))
def carry(
    facets: Reals, front: Reals, poses: Reals, states: Reals, x_lines: Reals, y_lines: Reals, loads: Reals
) -> None:
    """Add up what each cell of the pad carries in presses that rest: fills loads (presses, 6 * cells).

    Of each cell N times 1, u, v, uu, uv, vv (mm from its centre), the order of `clip.MOMENTS`.
    """
    columns, rows = len(x_lines) - 1, len(y_lines) - 1
    cells = columns * rows
    bounds = np.array([x_lines[0], x_lines[-1], y_lines[0], y_lines[-1]])
    farthest = math.hypot(max(-bounds[0], bounds[1]), max(-bounds[2], bounds[3]))
    corner, spare = np.zeros((_CORNERS, 3)), np.zeros((_CORNERS, 3))
    strip, part = np.zeros((_CORNERS, 3)), np.zeros((_CORNERS, 3))
    loads[:] = 0.0
    for press in range(len(poses)):
        depth, tilt_x, tilt_y, stiffness = (
            states[press, 0],
            states[press, 1],
            states[press, 2],
            states[press, 3],
        )
        if states[press, 4] != SETTLED:
            continue
        load, deepest = loads[press], depth + farthest * math.hypot(tilt_x, tilt_y)
        for index in range(len(facets)):
            if front[index] > deepest:
                break
            count = place(facets, index, poses[press], depth, tilt_x, tilt_y, bounds, 0.0, corner, spare)
            if count < 3:
                continue
            low_x = high_x = corner[0, 0]
            low_y = high_y = corner[0, 1]
            for i in range(1, count):
                low_x, high_x = min(low_x, corner[i, 0]), max(high_x, corner[i, 0])
                low_y, high_y = min(low_y, corner[i, 1]), max(high_y, corner[i, 1])
            left = min(np.searchsorted(x_lines, low_x, side="right") - 1, columns - 1)
            right = max(np.searchsorted(x_lines, high_x, side="left") - 1, left)
            bottom = min(np.searchsorted(y_lines, low_y, side="right") - 1, rows - 1)
            top = max(np.searchsorted(y_lines, high_y, side="left") - 1, bottom)
            for row in range(bottom, top + 1):
                y = (y_lines[row] + y_lines[row + 1]) / 2
                here = count
                strip[:count] = corner[:count]
                if row > bottom:
                    here = cut(strip, here, 1, 1.0, y_lines[row], spare)
                    strip[:here] = spare[:here]
                if row < top:
                    here = cut(strip, here, 1, -1.0, y_lines[row + 1], spare)
                    strip[:here] = spare[:here]
                for column in range(left, right + 1):
                    now = here
                    part[:here] = strip[:here]
                    if column > left:
                        now = cut(part, now, 0, 1.0, x_lines[column], spare)
                        part[:now] = spare[:now]
                    if column < right:
                        now = cut(part, now, 0, -1.0, x_lines[column + 1], spare)
                        part[:now] = spare[:now]
                    x = (x_lines[column] + x_lines[column + 1]) / 2
                    add_part(part, now, x, y, stiffness, load, row * columns + column, cells)
