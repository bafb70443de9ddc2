"""The quick look at a pose: do the touched points lie on the surface, and the pad's way outside; and steps of poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from tactsim.core.compiling import Ints1D, Reals, Reals1D, Reals2D, Reals3D, compiled
from tactsim.solids.voxels import Voxels, distance_at, slope_at


@compiled(called_from_python=False)
def solve(matrix: Reals2D, vector: Reals1D) -> None:
    """Solve six equations by Cholesky's factor; both are overwritten, the vector by what is found."""
    for i in range(6):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(max(value, 1e-12)) if i == j else value / matrix[j, j]
        value = vector[i]
        for k in range(i):
            value -= matrix[i, k] * vector[k]
        vector[i] = value / matrix[i, i]
    for i in range(5, -1, -1):
        value = vector[i]
        for k in range(i + 1, 6):
            value -= matrix[k, i] * vector[k]
        vector[i] = value / matrix[i, i]


@compiled(called_from_python=False)
def shortened(step: Reals1D, longest_shift: float, longest_turn: float) -> float:
    """Give the part of a step (6,), mm and rad, that is within both lengths: at most 1."""
    shift = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    angle = math.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    return min(1.0, longest_shift / max(shift, 1e-9), longest_turn / max(angle, 1e-9))


@compiled(called_from_python=False)
def advance(pose: Reals1D, step: Reals1D, by: float) -> None:
    """Move a pose (7,) by a part `by` of a step (6,) in its own frame: shift, mm, and turn, rad, to first order."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    p, q, r = by * step[0], by * step[1], by * step[2]
    tx, ty, tz = 2 * (y * r - z * q), 2 * (z * p - x * r), 2 * (x * q - y * p)
    pose[0] += p + w * tx + y * tz - z * ty
    pose[1] += q + w * ty + z * tx - x * tz
    pose[2] += r + w * tz + x * ty - y * tx
    a, b, c = 0.5 * by * step[3], 0.5 * by * step[4], 0.5 * by * step[5]
    pose[3], pose[4] = w - x * a - y * b - z * c, x + w * a + y * c - z * b
    pose[5], pose[6] = y + w * b + z * a - x * c, z + w * c + x * b - y * a
    pose[3:] /= math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)


@compiled(called_from_python=False)
def advance_about(pose: Reals1D, anchor: Reals1D, center: Reals1D, step: Reals1D, by: float) -> None:
    """Move a pose (7,) by a part of a step (6,) that turns the object about its place `center` (3,), at `anchor` (3,).

    After it the anchor is where center - shift is in the object.
    """
    x, y, z = center[0] - by * step[0], center[1] - by * step[1], center[2] - by * step[2]
    advance(pose, step, by)
    w, a, b, c = pose[3], pose[4], pose[5], pose[6]
    tx, ty, tz = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    pose[0] = anchor[0] - x - w * tx - b * tz + c * ty
    pose[1] = anchor[1] - y - w * ty - c * tx + a * tz
    pose[2] = anchor[2] - z - w * tz - a * ty + b * tx


_STEP = 3.0  # mm, how far apart at least the pad is looked at on its way
_FREE = 0.6  # the weight of a place that nothing is above
_BOUND = 8.0  # nats that one point can count against a pose at most: a map may be wrong somewhere
_MOST = 20.0  # nats that one touch can
_SHRINK = 0.6  # of how far a pose may be off, after a step


class TouchPoints(NamedTuple):
    """What touches say in points, in each sensor's frame.

    sensor: (m, 7) sensor_in_robot. point: (m, points, 4) [x, y, z, weight] mm, on the surface. points: (m,) how many of
    them. free: (m, places, 3) mm, places on the pad with nothing above them. frees: (m,). begin: (m,) mm behind the
    pad's plane, from where on its way back was free.
    """

    sensor: Reals2D
    point: Reals3D
    points: Ints1D
    free: Reals3D
    frees: Ints1D
    begin: Reals1D


class PadWay(NamedTuple):
    """What tells where the pad came along.

    lattice: (points, 2) mm over the pad. radius: mm about the object's origin that holds the object.
    """

    lattice: Reals2D
    radius: float


class Slack(NamedTuple):
    """How far poses may be off.

    turn: rad about the anchor (3,) mm in the robot frame. shift: mm. width: mm, how far off the map's distances are.
    """

    anchor: Reals1D
    turn: float
    shift: float
    width: float


class Step(NamedTuple):
    """Room for a Gauss-Newton step: the normal equations, matrix (6, 6) and vector (6,), and two vectors to work in."""

    matrix: Reals
    vector: Reals
    change: Reals
    slope: Reals


@compiled(called_from_python=False)
def _penalty(square: float, variance: float) -> float:
    """Give the nats that a squared distance counts: half of it by its variance, bounded (Geman and McClure 1985)."""
    return square / (2 * variance + square / _BOUND)


@register_jitable
def _counted(square: float, variance: float) -> float:
    """Give the weight of a squared distance in least squares whose minimum is that of `_penalty`."""
    wider = variance + 0.5 * square / _BOUND
    return variance / (wider * wider)


@register_jitable
def _ask(voxels: Voxels, place: Reals, center: Reals, away: float, by: float, room: Step) -> None:
    """Ask for a step of the object that brings its surface, `away` mm off, to a place (3,) mm in the object.

    by: the weight of that. The distance is linear in the step where the surface goes on as it is.
    """
    slope_at(voxels, place[0], place[1], place[2], room.slope)
    p, q, r = room.slope[0], room.slope[1], room.slope[2]
    x, y, z = place[0] - center[0], place[1] - center[1], place[2] - center[2]
    change = room.change
    change[0], change[1], change[2] = -p, -q, -r
    change[3], change[4], change[5] = z * q - y * r, x * r - z * p, y * p - x * q
    for i in range(6):
        room.vector[i] -= by * away * change[i]
        for j in range(i + 1):
            room.matrix[i, j] += by * change[i] * change[j]


@compiled()
def screen(
    voxels: Voxels, touches: TouchPoints, way: PadWay, object_in_robot: Reals2D, slack: Slack, steps: int, least: float,
    score: Reals1D,
) -> None:  # fmt: skip
    """Add to score (n,) what touches say of poses object_in_robot (n, 7), in nats, at most 0.

    A pose stands for those around it that `slack` tells. Distances change by at most as much as places move: so the
    variance of a point's distance is that of the map, `width`^2, and how far the point may move, squared. A score that
    falls to `least` or below is not worked out further.

    Before they are scored poses are moved, in place, by so many Gauss-Newton steps to where touches agree better. Each
    leaves them `_SHRINK` times as far from where they might be.
    """
    lattice, radius, anchor, width = way.lattice, way.radius, slack.anchor, slack.width
    pad = 0.0
    for k in range(len(lattice)):
        pad = max(pad, math.sqrt(lattice[k, 0] ** 2 + lattice[k, 1] ** 2))
    room = Step(np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(3))
    center, place = np.empty(3), np.empty(3)
    for n in range(len(object_in_robot)):
        pose = object_in_robot[n]
        may_turn, may_shift = slack.turn, slack.shift
        for done in range(steps + 1):
            stepping = done < steps
            fixed, turns = width * width + may_shift * may_shift, may_turn * may_turn
            aw, ax, ay, az = pose[3], -pose[4], -pose[5], -pose[6]
            # Where the anchor is in the object.
            p, q, r = anchor[0] - pose[0], anchor[1] - pose[1], anchor[2] - pose[2]
            tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
            cx = p + aw * tx + ay * tz - az * ty
            cy = q + aw * ty + az * tx - ax * tz
            cz = r + aw * tz + ax * ty - ay * tx
            center[0], center[1], center[2] = cx, cy, cz
            if stepping:
                room.vector[:] = 0.0
                room.matrix[:] = 0.0
                for axis in range(3):
                    room.matrix[axis, axis] = 1 / may_shift**2
                    room.matrix[axis + 3, axis + 3] = 1 / may_turn**2
            total = score[n]
            for m in range(len(touches.sensor)):
                if total <= least:
                    break
                lost = 0.0
                sensor = touches.sensor[m]
                bw, bx, by, bz = sensor[3], sensor[4], sensor[5], sensor[6]
                w = aw * bw - ax * bx - ay * by - az * bz
                x = aw * bx + ax * bw + ay * bz - az * by
                y = aw * by - ax * bz + ay * bw + az * bx
                z = aw * bz + ax * by - ay * bx + az * bw
                r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
                r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
                r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
                p, q, r = sensor[0] - pose[0], sensor[1] - pose[1], sensor[2] - pose[2]
                tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
                px = p + aw * tx + ay * tz - az * ty
                py = q + aw * ty + az * tx - ax * tz
                pz = r + aw * tz + ax * ty - ay * tx
                for k in range(touches.points[m]):
                    u, v, h = touches.point[m, k, 0], touches.point[m, k, 1], touches.point[m, k, 2]
                    x = px + r00 * u + r01 * v + r02 * h
                    y = py + r10 * u + r11 * v + r12 * h
                    z = pz + r20 * u + r21 * v + r22 * h
                    away = distance_at(voxels, x, y, z)
                    lever = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
                    variance = fixed + turns * lever
                    lost += touches.point[m, k, 3] * _penalty(away * away, variance)
                    if stepping:
                        place[0], place[1], place[2] = x, y, z
                        counted = touches.point[m, k, 3] * _counted(away * away, variance)
                        _ask(voxels, place, center, away, counted, room)
                for k in range(touches.frees[m]):
                    u, v, h = touches.free[m, k, 0], touches.free[m, k, 1], touches.free[m, k, 2]
                    x = px + r00 * u + r01 * v + r02 * h
                    y = py + r10 * u + r11 * v + r12 * h
                    z = pz + r20 * u + r21 * v + r22 * h
                    away = distance_at(voxels, x, y, z)
                    if away < 0:
                        lever = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
                        variance = fixed + turns * lever
                        lost += _FREE * _penalty(away * away, variance)
                        if stepping:
                            place[0], place[1], place[2] = x, y, z
                            _ask(voxels, place, center, away, _FREE * _counted(away * away, variance), room)
                # The pad's way, as far as it is near the object. A ball about its middle may be free, and with it all
                # of the pad; else it is looked at point by point.
                along = px * r02 + py * r12 + pz * r22
                beside = px * px + py * py + pz * pz - along * along
                near = math.sqrt(max((radius + pad) ** 2 - beside, 0.0))
                at, end = max(touches.begin[m], along - near), (along + near if near > 0 else -np.inf)
                worst, asked, deepest = 0.0, 0.0, 0.0
                while at < end:
                    x, y, z = px - at * r02, py - at * r12, pz - at * r22
                    nearest = distance_at(voxels, x, y, z)
                    if nearest > pad:
                        at += max(nearest - pad, 0.5)
                        continue
                    for k in range(len(lattice)):
                        u, v = lattice[k, 0], lattice[k, 1]
                        x = px + r00 * u + r01 * v - at * r02
                        y = py + r10 * u + r11 * v - at * r12
                        z = pz + r20 * u + r21 * v - at * r22
                        away = distance_at(voxels, x, y, z)
                        nearest = min(nearest, away)
                        if away < 0:
                            lever = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
                            penalty = _penalty(away * away, fixed + turns * lever)
                            if penalty > worst:
                                worst, deepest = penalty, away
                                asked = _counted(away * away, fixed + turns * lever)
                                place[0], place[1], place[2] = x, y, z
                    at += max(nearest, _STEP)
                if stepping and worst > 0:
                    _ask(voxels, place, center, deepest, asked, room)
                lost += worst
                total -= lost / (1 + lost / _MOST)
            if stepping:
                solve(room.matrix, room.vector)
                advance_about(
                    pose, anchor, center, room.vector, shortened(room.vector, 2 * may_shift, 2 * may_turn)
                )
                may_turn, may_shift = _SHRINK * may_turn, _SHRINK * may_shift
            else:
                score[n] = total
