"""The inner loops of a press of relief: put facets before the pad, find the balance, add up what each cell carries.

A facet is a triangle seen from above. Over it the depth by which the pad has given way, depth - gap + y tilt_x
- x tilt_y, is linear, so the part in contact is a convex polygon and what the springs under it carry is an
integral of polynomials: nothing is sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.core.compiling import Reals1D, Reals2D, Reals3D, compiled

STATE = 5  # what `press_all` finds: depth mm, tilt_x and tilt_y rad, stiffness N/mm^3, and how it ended
SETTLED, NO_CONTACT, BURIED, TIPPED = 0.0, 1.0, 2.0, 3.0

_SUMS = 10  # what `integrate` adds up over the contact: 1, x, y, xx, xy, yy, and p, p x, p y, p p
_CORNERS = 16  # room for a polygon: a triangle cut by nine lines at most
_MOST_STEPS = 100
_BALANCE = 1e-10  # share of the force that may be missing
STEEPEST = (
    0.35  # rad, 20 degrees: what tilts further has tipped over; `touches.MOST_TILT` for those without kernels
)
_LEAST_AREA = 1e-9  # mm^2; what touches less than this does not touch


class Field(NamedTuple):
    """The shape from above: facets (n, 3 corners, 3), [x, y, gap] mm, ordered by front (n,), each one's least gap."""

    facets: Reals3D
    front: Reals1D


class Cells(NamedTuple):
    """The pad: the edges of its cells along x (columns + 1,) and y (rows + 1,), mm."""

    x_lines: Reals1D
    y_lines: Reals1D


class Layer(NamedTuple):
    """What gives way: stiffness N/mm^3, thickness mm; wrist N mm / rad, infinite for a rigid one; height mm to which
    the shape may sink in.
    """

    stiffness: float
    thickness: float
    wrist: float
    height: float


class Room(NamedTuple):
    """Room to work in: four polygons (_CORNERS, 3), and total (_SUMS,), what `integrate` adds up."""

    corner: Reals2D
    spare: Reals2D
    strip: Reals2D
    part: Reals2D
    total: Reals1D


@compiled(called_from_python=False)
def cut(corner: Reals2D, count: int, axis: int, sign: float, line: float, spare: Reals2D) -> int:
    """Cut a polygon to where sign * (a coordinate - line) >= 0 (Sutherland and Hodgman); returns its corners' number.

    corner: (room, 3 or more), of which the first `count` are used, changed in place: x, y, depth or gap, and if there
    is a fourth, what is true of the edge that begins there, 0 of an edge along a cut. axis: 0, 1 or 2. spare: as large.
    Of a polygon that is not convex, pieces may run to and fro along a cut; they enclose nothing.
    """
    found = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = sign * (corner[i, axis] - line), sign * (corner[j, axis] - line)
        if here >= 0:
            for k in range(corner.shape[1]):
                spare[found, k] = corner[i, k]
            found += 1
        if (here >= 0) != (there >= 0):
            share = here / (here - there)
            for k in range(3):
                spare[found, k] = corner[i, k] + share * (corner[j, k] - corner[i, k])
            spare[found, axis] = line
            if corner.shape[1] > 3:
                spare[found, 3] = 0.0 if here >= 0 else corner[i, 3]
            found += 1
    for i in range(found):
        for k in range(corner.shape[1]):
            corner[i, k] = spare[i, k]
    return found


@compiled(called_from_python=False)
def gather(
    field: Field, pose: Reals1D, bounds: Reals1D, thickness: float, lean: float, before: Reals3D, room: Room
) -> tuple[Reals3D, int, float]:
    """Put before the pad all facets that it can reach: triangles [x, y, gap] in the sensor frame, cut with the pad.

    pose: (4,) x, y, cos, sin of sensor_in_object. bounds: (4,) x low, x high, y low, y high of the pad, which reaches
    what lies less than `thickness` behind its first touch, and `lean` more because it may tilt.
    before: room for triangles. Returns the triangles, in `before` or larger room; their number; and the depth at which
    the pad, level, first touches: infinite if nothing lies before it.
    """
    facets, front, corner, spare = field.facets, field.front, room.corner, room.spare
    used, touch = 0, np.inf
    cos, sin = pose[2], pose[3]
    for index in range(len(facets)):
        if front[index] > touch + thickness + lean:
            break
        low_x = low_y = np.inf
        high_x = high_y = -np.inf
        for i in range(3):
            u, v = facets[index, i, 0] - pose[0], facets[index, i, 1] - pose[1]
            x, y = cos * u + sin * v, cos * v - sin * u
            corner[i, 0], corner[i, 1], corner[i, 2] = x, y, facets[index, i, 2]
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        if high_x <= bounds[0] or low_x >= bounds[1] or high_y <= bounds[2] or low_y >= bounds[3]:
            continue
        count = 3
        if low_x < bounds[0]:
            count = cut(corner, count, 0, 1.0, bounds[0], spare)
        if high_x > bounds[1]:
            count = cut(corner, count, 0, -1.0, bounds[1], spare)
        if low_y < bounds[2]:
            count = cut(corner, count, 1, 1.0, bounds[2], spare)
        if high_y > bounds[3]:
            count = cut(corner, count, 1, -1.0, bounds[3], spare)
        if used + _CORNERS > len(before):
            more = np.empty((2 * len(before) + _CORNERS, 3, 3))
            more[:used] = before[:used]
            before = more
        for i in range(1, count - 1):
            for k in range(3):
                before[used, 0, k] = corner[0, k]
                before[used, 1, k] = corner[i, k]
                before[used, 2, k] = corner[i + 1, k]
            touch = min(touch, corner[0, 2], corner[i, 2], corner[i + 1, 2])
            used += 1
    return before, used, touch


@compiled(called_from_python=False)
def bear(before: Reals3D, count: int, depth: float, tilt_x: float, tilt_y: float) -> tuple[float, float]:
    """Integrate the depth over the contact, and the contact: returns mm^3 and mm^2.

    Over a triangle whose corners lie at gaps low <= middle <= high, both are powers of the depth in closed form.
    """
    volume = contact = 0.0
    for index in range(count):
        one = before[index]
        low = one[0, 2] - one[0, 1] * tilt_x + one[0, 0] * tilt_y
        middle = one[1, 2] - one[1, 1] * tilt_x + one[1, 0] * tilt_y
        high = one[2, 2] - one[2, 1] * tilt_x + one[2, 0] * tilt_y
        if low > middle:
            low, middle = middle, low
        if middle > high:
            middle, high = high, middle
            if low > middle:
                low, middle = middle, low
        if low >= depth:
            continue
        area = (
            abs(
                (one[1, 0] - one[0, 0]) * (one[2, 1] - one[0, 1])
                - (one[2, 0] - one[0, 0]) * (one[1, 1] - one[0, 1])
            )
            / 2
        )
        if depth >= high:
            volume += area * (depth - (low + middle + high) / 3)
            contact += area
        elif depth <= middle:
            part = area * (depth - low) ** 2 / ((middle - low) * (high - low))
            contact += part
            volume += part * (depth - low) / 3
        else:
            part = area * (high - depth) ** 2 / ((high - middle) * (high - low))
            contact += area - part
            volume += area * (depth - (low + middle + high) / 3) + part * (high - depth) / 3
    return volume, contact


@compiled(called_from_python=False)
def touching(before: Reals3D, index: int, depth: float, tilt_x: float, tilt_y: float, room: Room) -> int:
    """Take the part of a triangle that is in contact: fills room.corner with [x, y, depth] and returns their number."""
    corner, least = room.corner, np.inf
    for i in range(3):
        x, y = before[index, i, 0], before[index, i, 1]
        corner[i, 0], corner[i, 1] = x, y
        corner[i, 2] = depth - before[index, i, 2] + y * tilt_x - x * tilt_y
        least = min(least, corner[i, 2])
    return 3 if least >= 0 else cut(corner, 3, 2, 1.0, 0.0, room.spare)


@compiled(called_from_python=False)
def integrate(before: Reals3D, count: int, depth: float, tilt_x: float, tilt_y: float, room: Room) -> None:
    """Add up over the contact what balances a press: fills room.total, p standing for the depth, mm."""
    corner, total = room.corner, room.total
    total[:] = 0.0
    for index in range(count):
        corners = touching(before, index, depth, tilt_x, tilt_y, room)
        x0, y0, p0 = corner[0, 0], corner[0, 1], corner[0, 2]
        for i in range(1, corners - 1):
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


@compiled(called_from_python=False)
def sink(
    before: Reals3D, count: int, touch: float, guess: float, tilt_x: float, tilt_y: float, force: float,
    stiffness: float,
) -> float:  # fmt: skip
    """Find the depth, mm, at which springs under a face that does not turn carry the force, by Newton's method.

    The force is a convex, growing function of the depth, so a step from below overshoots, and from above
    every step stays above.
    """
    depth, low = touch + guess, touch
    for _ in range(_MOST_STEPS):
        volume, contact = bear(before, count, depth, tilt_x, tilt_y)
        missing = force - stiffness * volume
        if abs(missing) <= _BALANCE * force:
            break
        if missing > 0:
            low = depth
        # Just behind the foremost point the contact is tiny and a step far too long.
        step = missing / (stiffness * contact) if contact > 0 else np.inf
        depth = max(min(depth + step, touch + 4 * (depth - touch)), (low + depth) / 2)
    return depth


@compiled(called_from_python=False)
def turn(
    before: Reals3D,
    count: int,
    tilt: Reals1D,
    at: Reals1D,
    wrist: float,
    force: float,
    stiffness: float,
    room: Room,
) -> float:
    """Find where springs, force and a wrist balance: the lowest point of a convex energy, by Newton's method.

    tilt: (2,) rad, where the wrist pushes nowhere. at: (3,) depth and tilts to begin with, which are changed.
    wrist: N mm / rad. Returns how it ended.
    """
    total, lowest, share = room.total, np.inf, 1.0
    step, kept = np.zeros(3), at.copy()
    for _ in range(_MOST_STEPS):
        integrate(before, count, at[0], at[1], at[2], room)
        turn_x, turn_y = at[1] - tilt[0], at[2] - tilt[1]
        first = stiffness * total[6] - force
        second, third = stiffness * total[8] + wrist * turn_x, -stiffness * total[7] + wrist * turn_y
        if max(abs(first), abs(second), abs(third)) <= _BALANCE * force:
            return SETTLED
        energy = stiffness * total[9] / 2 - force * at[0] + wrist * (turn_x * turn_x + turn_y * turn_y) / 2
        if (energy > lowest + 1e-13 * abs(lowest) and share > 1e-4) or total[0] == 0:
            share /= 4
            for i in range(3):
                at[i] = kept[i] + share * step[i]
            continue
        lowest, share = energy, 1.0
        area, x, y = stiffness * total[0], stiffness * total[1], stiffness * total[2]
        # [[area, y, -x], [y, yy, -xy], [-x, -xy, xx]] step = -[first, second, third], the depth eliminated
        a, c = stiffness * total[5] + wrist - y * y / area, stiffness * total[3] + wrist - x * x / area
        b = x * y / area - stiffness * total[4]
        f, g = second - y * first / area, third + x * first / area
        step[1], step[2] = (b * g - c * f) / (a * c - b * b), (b * f - a * g) / (a * c - b * b)
        step[0] = (-first - y * step[1] + x * step[2]) / area
        for i in range(3):
            kept[i] = at[i]
            at[i] += step[i]
        if math.hypot(at[1], at[2]) > STEEPEST:
            return TIPPED
    return TIPPED


@compiled(called_from_python=False)
def add_part(
    corner: Reals2D, count: int, x: float, y: float, stiffness: float, load: Reals1D, cell: int, cells: int
) -> None:
    """Add what one polygon carries to the moments of a cell about its centre (x, y): load (6 * cells,).

    The pressure is linear and the moments' powers quadratic, so four points integrate each triangle exactly
    (Strang and Fix, degree 3).
    """
    for i in range(1, count - 1):
        j = i + 1
        area = abs(
            (corner[i, 0] - corner[0, 0]) * (corner[j, 1] - corner[0, 1])
            - (corner[j, 0] - corner[0, 0]) * (corner[i, 1] - corner[0, 1])
        ) * (stiffness / 96)
        u = corner[0, 0] + corner[i, 0] + corner[j, 0]
        v = corner[0, 1] + corner[i, 1] + corner[j, 1]
        p = corner[0, 2] + corner[i, 2] + corner[j, 2]
        for k in range(4):
            if k == 3:
                at_u, at_v, weight = u / 3 - x, v / 3 - y, -27 * area * p / 3
            else:
                at = 0 if k == 0 else i + k - 1
                at_u = 0.2 * u + 0.4 * corner[at, 0] - x
                at_v = 0.2 * v + 0.4 * corner[at, 1] - y
                weight = 25 * area * (0.2 * p + 0.4 * corner[at, 2])
            load[cell] += weight
            load[cell + cells] += weight * at_u
            load[cell + 2 * cells] += weight * at_v
            load[cell + 3 * cells] += weight * at_u * at_u
            load[cell + 4 * cells] += weight * at_u * at_v
            load[cell + 5 * cells] += weight * at_v * at_v


@compiled(called_from_python=False)
def carry(before: Reals3D, count: int, state: Reals1D, pad: Cells, load: Reals1D, room: Room) -> None:
    """Add up what each cell of the pad carries in a press at rest: adds to load (6 * cells,)."""
    x_lines, y_lines, corner, spare = pad.x_lines, pad.y_lines, room.corner, room.spare
    strip, part = room.strip, room.part
    columns, rows = len(x_lines) - 1, len(y_lines) - 1
    for index in range(count):
        corners = touching(before, index, state[0], state[1], state[2], room)
        if corners < 3:
            continue
        low_x = high_x = corner[0, 0]
        low_y = high_y = corner[0, 1]
        for i in range(1, corners):
            low_x, high_x = min(low_x, corner[i, 0]), max(high_x, corner[i, 0])
            low_y, high_y = min(low_y, corner[i, 1]), max(high_y, corner[i, 1])
        left = right = min(np.searchsorted(x_lines, low_x, side="right") - 1, columns - 1)
        bottom = top = min(np.searchsorted(y_lines, low_y, side="right") - 1, rows - 1)
        while right < columns - 1 and x_lines[right + 1] < high_x:
            right += 1
        while top < rows - 1 and y_lines[top + 1] < high_y:
            top += 1
        for row in range(bottom, top + 1):
            y = (y_lines[row] + y_lines[row + 1]) / 2
            high = corners
            strip[:corners] = corner[:corners]
            if row > bottom:
                high = cut(strip, high, 1, 1.0, y_lines[row], spare)
            if row < top:
                high = cut(strip, high, 1, -1.0, y_lines[row + 1], spare)
            for column in range(left, right + 1):
                x = (x_lines[column] + x_lines[column + 1]) / 2
                wide = high
                part[:high] = strip[:high]
                if column > left:
                    wide = cut(part, wide, 0, 1.0, x_lines[column], spare)
                if column < right:
                    wide = cut(part, wide, 0, -1.0, x_lines[column + 1], spare)
                add_part(part, wide, x, y, state[3], load, row * columns + column, columns * rows)


@compiled()
def press_all(
    field: Field,
    poses: Reals2D,
    tilts: Reals2D,
    forces: Reals1D,
    pad: Cells,
    layer: Layer,
    states: Reals2D,
    loads: Reals2D,
) -> None:
    """Find where each press rests, and what each cell of the pad carries there.

    poses: (presses, 4) x, y, cos, sin of sensor_in_object. tilts: (presses, 2) rad. forces: (presses,) N.
    Fills states (presses, STATE) and loads (presses, 6 * cells): of each cell N times 1, u, v, uu, uv, vv, mm from
    its centre.
    """
    room = Room(
        np.zeros((_CORNERS, 3)),
        np.zeros((_CORNERS, 3)),
        np.zeros((_CORNERS, 3)),
        np.zeros((_CORNERS, 3)),
        np.zeros(_SUMS),
    )
    x_lines, y_lines, thickness, wrist, at = (
        pad.x_lines,
        pad.y_lines,
        layer.thickness,
        layer.wrist,
        np.zeros(3),
    )
    bounds = np.array([x_lines[0], x_lines[-1], y_lines[0], y_lines[-1]])
    farthest = math.hypot(max(-bounds[0], bounds[1]), max(-bounds[2], bounds[3]))
    before = np.empty((len(field.facets) + 4 * _CORNERS, 3, 3))
    for press in range(len(poses)):
        state, tilt, force = states[press], tilts[press], forces[press]
        state[:] = 0.0
        loads[press, :] = 0.0
        slope = math.hypot(tilt[0], tilt[1]) if wrist == np.inf else STEEPEST
        before, count, touch = gather(
            field, poses[press], bounds, thickness, 2 * farthest * slope, before, room
        )
        state[4] = NO_CONTACT
        if count == 0:
            continue
        volume, contact = bear(before, count, touch + thickness, 0.0, 0.0)
        if contact < _LEAST_AREA:
            continue
        # A layer that the level shape would press by more than its thickness is just stiff enough not to give so far.
        state[3] = max(layer.stiffness, force / volume)
        # The force on a paraboloid grows as the square of the depth.
        guess = thickness * math.sqrt(force / (state[3] * volume))
        at[1], at[2] = tilt[0], tilt[1]
        for index in range(count):
            for i in range(3):
                x, y, gap = before[index, i, 0], before[index, i, 1], before[index, i, 2]
                touch = min(touch, gap - y * at[1] + x * at[2])
        at[0] = sink(before, count, touch, guess, at[1], at[2], force, state[3])
        state[4] = SETTLED
        if wrist < np.inf:
            state[4] = turn(before, count, tilt, at, wrist, force, state[3], room)
        if state[4] == SETTLED and at[0] > layer.height:
            state[4] = BURIED
        state[:3] = at
        if state[4] == SETTLED:
            carry(before, count, state, pad, loads[press], room)
