"""The inner loops of the forward model: cut an outline to what touches, balance it, integrate along its border.

Over a flat face the depth is linear, and what a taxel feels of a point is a product of functions of x and y. So area,
moments and every taxel's pressure are integrals along the border of what touches (Green's theorem), and their
derivatives by the pose are integrals along the part of it that is the letter's own outline, which moves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, Reals3D, compiled
from tactsim.press.facet_kernels import STEEPEST, cut

LEAST_AREA = 1e-9  # mm^2; what touches less than this does not touch
_MOST_STEPS = 60
_MOST_HALVINGS = 30
_BALANCE = 1e-10  # share of the force that may be missing
_REACH = 5.0  # mm, about half a pad: the arm by which a moment is compared with a force

# Gauss quadrature on [0, 1] with three points.
_AT = (0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15))
_WEIGHT = (5 / 18, 8 / 18, 5 / 18)


class Outline(NamedTuple):
    """A flat face: corners (n, 2) mm in the object frame, of closed contours that begin at start (contours + 1,)."""

    corners: Reals2D
    start: Ints1D


class Layer(NamedTuple):
    """What is pressed: bounds (4,) x low, x high, y low, y high of the pad, mm, and its springs and wrist.

    springs: (4,) force N, stiffness N/mm^3, thickness mm, wrist N mm/rad (negative: rigid).
    """

    bounds: Reals1D
    springs: Reals1D


class Touch(NamedTuple):
    """What touches in one press, found or to be found.

    corner: (contours, room, 4) x, y mm, depth mm, and 1 where the edge that begins there is the letter's, 0 where it
    lies on a cut. counts: (contours,) how many. spare: (room, 4). state: (3,) depth mm and tilts rad. moment: (6,)
    integrals of 1, x, y, xx, xy, yy. matrix: (3, 3), second derivatives of the energy by the depth and the slopes
    along x and y.
    """

    corner: Reals3D
    counts: Ints1D
    spare: Reals2D
    state: Reals1D
    moment: Reals1D
    matrix: Reals2D


class Felt(NamedTuple):
    """What taxels feel of a unit force, at nodes equally far apart; it is linear between them.

    x: (nodes, 3, columns) what a column of taxels feels, its integral from the left and that of x times it, 1/mm, 1
    and mm. y: (nodes, 1, rows). nodes: (3,) first node along x and y and the distance of nodes, mm.
    """

    x: Reals3D
    y: Reals3D
    nodes: Reals1D


@compiled(called_from_python=False)
def room_for(outline: Outline) -> Touch:
    """Make room for what touches of an outline."""
    contours, room = len(outline.start) - 1, 0
    for k in range(contours):
        room = max(room, outline.start[k + 1] - outline.start[k])
    room = 8 * room + 64
    return Touch(
        np.empty((contours, room, 4)),
        np.zeros(contours, dtype=np.int64),
        np.empty((room, 4)),
        np.zeros(3),
        np.zeros(6),
        np.zeros((3, 3)),
    )


@compiled(called_from_python=False)
def lay(outline: Outline, pose: Reals1D, bounds: Reals1D, lifts: int, touch: Touch) -> None:
    """Find what of an outline touches the pad in the state of `touch`, and its moments: fills the rest of `touch`.

    pose: (3,) sensor_in_object. bounds: as in `Layer`. If `lifts`, what is above the pad's surface does not touch.
    Pieces that run to and fro along a cut enclose nothing.
    """
    state, moment = touch.state, touch.moment
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    cos_x, sin_x = math.cos(state[1]), math.sin(state[1])
    cos_y, sin_y = math.cos(state[2]), math.sin(state[2])
    slope_x, slope_y = -math.tan(state[2]) / cos_x, math.tan(state[1])
    moment[:] = 0.0
    for k in range(len(outline.start) - 1):
        first = outline.start[k]
        n = outline.start[k + 1] - first
        corner = touch.corner[k]
        for i in range(n):
            u, v = outline.corners[first + i, 0] - pose[0], outline.corners[first + i, 1] - pose[1]
            x, y = cos * u + sin * v, -sin * u + cos * v
            # Seen along the pad's normal, a tilted face is shorter.
            x, y = cos_y * x, sin_x * sin_y * x + cos_x * y
            corner[i, 0], corner[i, 1], corner[i, 3] = x, y, 1.0
            corner[i, 2] = state[0] + slope_x * x + slope_y * y
        for axis in range(2):
            n = cut(corner, n, axis, 1.0, bounds[2 * axis], touch.spare)
            n = cut(corner, n, axis, -1.0, bounds[2 * axis + 1], touch.spare)
        if lifts:
            n = cut(corner, n, 2, 1.0, 0.0, touch.spare)
        touch.counts[k] = n
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            x0, y0, x1, y1 = corner[i, 0], corner[i, 1], corner[j, 0], corner[j, 1]
            # Sums over the triangle to the origin, twice its signed area first.
            twice = x0 * y1 - x1 * y0
            moment[0] += twice / 2
            moment[1] += twice * (x0 + x1) / 6
            moment[2] += twice * (y0 + y1) / 6
            moment[3] += twice * (x0 * x0 + x0 * x1 + x1 * x1) / 12
            moment[4] += twice * (x0 * (2 * y0 + y1) + x1 * (y0 + 2 * y1)) / 24
            moment[5] += twice * (y0 * y0 + y0 * y1 + y1 * y1) / 12


@compiled(called_from_python=False)
def solve_3(matrix: Reals2D, vector: Reals1D) -> None:
    """Solve a symmetric positive definite system of three equations in place, by Cholesky's method."""
    a, b, c = matrix[0, 0], matrix[1, 0] / matrix[0, 0], matrix[2, 0] / matrix[0, 0]
    d = matrix[1, 1] - b * b * a
    e = (matrix[2, 1] - b * c * a) / d
    f = matrix[2, 2] - c * c * a - e * e * d
    y = vector[1] - b * vector[0]
    z = (vector[2] - c * vector[0] - e * y) / f
    y = y / d - e * z
    vector[0] = vector[0] / a - b * y - c * z
    vector[1], vector[2] = y, z


@compiled(called_from_python=False)
def balance(outline: Outline, pose: Reals1D, tilt: Reals1D, layer: Layer, touch: Touch) -> float:
    """Find depth and tilts at rest by Newton's method; returns the springs' stiffness N/mm^3, 0 without contact.

    pose: (3,) sensor_in_object. tilt: (2,) nominal, rad. Fills `touch`.
    A step is halved where it neither lowers the energy k/2 int d^2 + wrist/2 |tilt - nominal|^2 - force depth nor
    halves what is missing in the balance: the energy alone would not do, as a tilted face is shorter, seen along the
    pad's normal, by which it loses energy without a force.
    """
    bounds, springs = layer.bounds, layer.springs
    state, moment, matrix = touch.state, touch.moment, touch.matrix
    force, wrist = springs[0], springs[3]
    state[0], state[1], state[2] = 0.0, tilt[0], tilt[1]
    lay(outline, pose, bounds, 0, touch)
    if moment[0] < LEAST_AREA:
        return 0.0
    stiffness = max(springs[1], force / (moment[0] * springs[2]))
    step, best = np.zeros(3), np.zeros(3)
    lowest = least = math.inf
    lifts, halvings = 0, 0
    for _ in range(_MOST_STEPS):
        cos_x, sin_x, cos_y, sin_y = (
            math.cos(state[1]),
            math.sin(state[1]),
            math.cos(state[2]),
            math.sin(state[2]),
        )
        slope_x, slope_y = -math.tan(state[2]) / cos_x, math.tan(state[1])
        a, sx, sy, sxx, sxy, syy = moment[0], moment[1], moment[2], moment[3], moment[4], moment[5]
        depth = state[0]
        load = stiffness * (depth * a + slope_x * sx + slope_y * sy)
        moment_x = stiffness * (depth * sx + slope_x * sxx + slope_y * sxy)
        moment_y = stiffness * (depth * sy + slope_x * sxy + slope_y * syy)
        energy = (depth * load + slope_x * moment_x + slope_y * moment_y) / 2 - force * depth
        missing, by_x, by_y = abs(force - load) / force, 0.0, 0.0
        if wrist >= 0:
            gave_x, gave_y = state[1] - tilt[0], state[2] - tilt[1]
            energy += wrist / 2 * (gave_x * gave_x + gave_y * gave_y)
            # The work of the layer and the wrist by the tilts, as in `balance._Problem.at`.
            by_x = moment_y / cos_x**2 - moment_x * sin_x * sin_y / (cos_y * cos_x**2) + wrist * gave_x
            by_y = -moment_x / (cos_y**2 * cos_x) + wrist * gave_y
            missing = max(missing, max(abs(by_x), abs(by_y)) / (_REACH * force))
        if lifts:
            worse = a < LEAST_AREA or (energy > lowest and missing > least / 2)
            if worse and halvings < _MOST_HALVINGS:
                halvings += 1
                for i in range(3):
                    step[i] /= 2
                    state[i] = best[i] + step[i]
                lay(outline, pose, bounds, 1, touch)
                continue
            if worse:
                return 0.0
            lowest, least, halvings = energy, missing, 0
        matrix[0, 0] = stiffness * a
        matrix[1, 0] = matrix[0, 1] = stiffness * sx
        matrix[2, 0] = matrix[0, 2] = stiffness * sy
        matrix[1, 1], matrix[2, 2] = stiffness * sxx + max(wrist, 0.0), stiffness * syy + max(wrist, 0.0)
        matrix[2, 1] = matrix[1, 2] = stiffness * sxy
        if lifts and missing <= _BALANCE:
            break
        lifts = 1  # the first step was that of a face which touches all over
        # A step in depth and in the slopes along x and y, which are -tan(tilt_y) and tan(tilt_x), nearly.
        step[0], step[1], step[2] = force - load, by_y, -by_x
        if wrist < 0:
            step[0] /= matrix[0, 0]
        else:
            solve_3(matrix, step)
            step[1], step[2] = step[2] * cos_x**2, -step[1] * cos_y**2
        for i in range(3):
            best[i] = state[i]
            state[i] += step[i]
        lay(outline, pose, bounds, 1, touch)
    if abs(state[1]) > STEEPEST or abs(state[2]) > STEEPEST or moment[0] < LEAST_AREA:
        return 0.0
    return stiffness


@compiled()
def rest_all(
    outline: Outline, poses: Reals2D, tilts: Reals2D, layer: Layer, forces: Reals1D, states: Reals2D
) -> None:
    """Find where an outline rests at poses (n, 3) with tilts (n, 2) under forces (n,) N instead of the layer's.

    Fills states (n, 4): depth mm, tilts rad and the springs' stiffness N/mm^3, 0 without contact or balance.
    """
    touch = room_for(outline)
    under = Layer(layer.bounds, layer.springs.copy())
    for n in range(len(poses)):
        under.springs[0] = forces[n]
        states[n, 3] = balance(outline, poses[n], tilts[n], under, touch)
        states[n, :3] = touch.state


@compiled()
def press_all(
    outline: Outline,
    poses: Reals2D,
    tilts: Reals2D,
    layer: Layer,
    felt: Felt,
    derive: int,
    mean: Reals2D,
    by: Reals3D,
) -> None:
    """Press an outline at poses (n, 3) with tilts (n, 2): mean (n, taxels) kPa; if `derive`, by (n, 6, taxels) too.

    by: derivatives by the sensor's own motion [mm, mm, rad], the nominal tilts [rad, rad] and the log of the force.
    """
    springs, felt_x, felt_y, table = layer.springs, felt.x, felt.y, felt.nodes
    columns, rows = felt_x.shape[2], felt_y.shape[2]
    touch = room_for(outline)
    corner, count, state, matrix = touch.corner, touch.counts, touch.state, touch.matrix
    contours, unit = len(count), np.zeros(3)
    # Of the felt base functions 1, x, y; and of what the moving outline brings, by each of the three motions.
    base, flux = np.empty((3, rows, columns)), np.empty((3, rows, columns))
    pushed = np.empty((3, 3))
    at_x, at_y = np.empty((3, columns)), np.empty(rows)
    for n in range(len(poses)):
        mean[n] = 0.0
        by[n] = 0.0
        stiffness = balance(outline, poses[n], tilts[n], layer, touch)
        if stiffness == 0:
            continue
        slope_x, slope_y = -math.tan(state[2]) / math.cos(state[1]), math.tan(state[1])
        base[:] = 0.0
        flux[:] = 0.0
        pushed[:] = 0.0
        for k in range(contours):
            for i in range(count[k]):
                j = i + 1 if i + 1 < count[k] else 0
                x0, y0 = corner[k, i, 0], corner[k, i, 1]
                dx, dy = corner[k, j, 0] - x0, corner[k, j, 1] - y0
                moves = derive and corner[k, i, 3] > 0
                if dy == 0 and not moves:
                    continue
                pieces = math.ceil(math.hypot(dx, dy) / (60 * table[2]))
                for piece in range(pieces):
                    for g in range(3):
                        share = (piece + _AT[g]) / pieces
                        x, y = x0 + share * dx, y0 + share * dy
                        place = (x - table[0]) / table[2]
                        node = min(max(int(place), 0), felt_x.shape[0] - 2)
                        part = place - node
                        for d in range(3):
                            for c in range(columns):
                                at_x[d, c] = felt_x[node, d, c] + part * (
                                    felt_x[node + 1, d, c] - felt_x[node, d, c]
                                )
                        place = (y - table[1]) / table[2]
                        node = min(max(int(place), 0), felt_y.shape[0] - 2)
                        part = place - node
                        for r in range(rows):
                            at_y[r] = felt_y[node, 0, r] + part * (
                                felt_y[node + 1, 0, r] - felt_y[node, 0, r]
                            )
                        across = dy * _WEIGHT[g] / pieces
                        along = dx * _WEIGHT[g] / pieces
                        for r in range(rows):
                            one = across * at_y[r]
                            up = one * y
                            for c in range(columns):
                                base[0, r, c] += one * at_x[1, c]
                                base[1, r, c] += one * at_x[2, c]
                                base[2, r, c] += up * at_x[1, c]
                        if moves:
                            depth = state[0] + slope_x * x + slope_y * y
                            # How fast the outline gains ground, outward normal times length, for each motion.
                            gain_x, gain_y, gain_turn = (
                                -across * depth,
                                along * depth,
                                (y * across + x * along) * depth,
                            )
                            for r in range(rows):
                                for c in range(columns):
                                    both = at_y[r] * at_x[0, c]
                                    flux[0, r, c] += gain_x * both
                                    flux[1, r, c] += gain_y * both
                                    flux[2, r, c] += gain_turn * both
                            for m in range(3):
                                gain = gain_x if m == 0 else (gain_y if m == 1 else gain_turn)
                                pushed[m, 0] += gain
                                pushed[m, 1] += gain * x
                                pushed[m, 2] += gain * y
        kilo = 1e3 * stiffness
        for r in range(rows):
            for c in range(columns):
                mean[n, r * columns + c] = kilo * (
                    state[0] * base[0, r, c] + slope_x * base[1, r, c] + slope_y * base[2, r, c]
                )
        if not derive:
            continue
        for m in range(6):
            if m < 3:
                for i in range(3):
                    unit[i] = -stiffness * pushed[m, i]
            else:
                unit[:] = 0.0
                if m == 3:  # a nominal tilt about x makes the face slope along y
                    unit[2] = springs[3]
                elif m == 4:
                    unit[1] = -springs[3]
                else:
                    unit[0] = springs[0]
            if springs[3] < 0:
                turn_x = -1.0 if m == 4 else 0.0
                turn_y = 1.0 if m == 3 else 0.0
                lost = unit[0] if m < 3 or m == 5 else 0.0
                unit[0] = (lost - matrix[1, 0] * turn_x - matrix[2, 0] * turn_y) / matrix[0, 0]
                unit[1], unit[2] = turn_x, turn_y
            else:
                solve_3(matrix, unit)
            for r in range(rows):
                for c in range(columns):
                    value = unit[0] * base[0, r, c] + unit[1] * base[1, r, c] + unit[2] * base[2, r, c]
                    if m < 3:
                        value += flux[m, r, c]
                    by[n, m, r * columns + c] = kilo * value
