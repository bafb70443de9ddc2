"""The quick look at a pose: do the touched points lie on the surface, and does the pad's way lie outside of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled
from tactsim.estimators.space.voxels import VOXELS, Voxels, distance_at

_BOUND = 8.0  # nats that one point can count against a pose at most: a map may be wrong somewhere


class TouchPoints(NamedTuple):
    """What touches say in points, in each sensor's frame.

    sensor: (m, 7) sensor_in_robot. point: (m, points, 4) [x, y, z, weight] mm, on the surface. points: (m,) how many of
    them. free: (m, taxels, 3) mm, places on the pad with nothing above them. frees: (m,). begin: (m,) mm behind the
    pad's plane from where on its way back was free.
    """

    sensor: Reals
    point: Reals
    points: Ints
    free: Reals
    frees: Ints
    begin: Reals


TOUCH_POINTS = types.NamedTuple((REALS_2D, REALS_3D, INTS, REALS_3D, INTS, REALS), TouchPoints)


@compiled(float64(float64, float64), called_from_python=False)
def _penalty(off: float, width: float) -> float:
    """Give the nats that a distance counts: half its square in units of its width, bounded (Geman and McClure 1985)."""
    square = off * off / (width * width)
    return 0.5 * square / (1 + 0.5 * square / _BOUND)


@compiled(
    void(
        VOXELS, TOUCH_POINTS, REALS_2D, REALS_2D, int64, int64, REALS, float64, float64, float64, float64, float64, REALS
    )
)  # fmt: skip
def screen(
    voxels: Voxels, touches: TouchPoints, lattice: Reals, object_in_robot: Reals, first: int, last: int, anchor: Reals,
    turn: float, shift: float, width: float, stroke: float, least: float, score: Reals,
) -> None:  # fmt: skip
    """Add to score (n,) what touches first, ..., last - 1 say of poses object_in_robot (n, 7), in nats, at most 0.

    A pose stands for those that differ from it by up to `turn` rad about the anchor (3,) mm and `shift` mm. Distances
    change by at most as much as places move, so a point's width is `width` mm, and what the point may move in quadrature.
    lattice: (points, 2) mm over the pad, a third of it apart. stroke: mm. A score that falls to `least` or below is not
    worked out further.
    """
    radius = 0.0
    for k in range(len(lattice)):
        radius = max(radius, math.sqrt(lattice[k, 0] ** 2 + lattice[k, 1] ** 2))
    for n in range(len(object_in_robot)):
        ow, ox, oy, oz = object_in_robot[n, 3], object_in_robot[n, 4], object_in_robot[n, 5], object_in_robot[n, 6]
        total = score[n]
        for m in range(first, last):
            if total <= least:
                break
            sensor = touches.sensor[m]
            aw, ax, ay, az = ow, -ox, -oy, -oz
            bw, bx, by, bz = sensor[3], sensor[4], sensor[5], sensor[6]
            w = aw * bw - ax * bx - ay * by - az * bz
            x = aw * bx + ax * bw + ay * bz - az * by
            y = aw * by - ax * bz + ay * bw + az * bx
            z = aw * bz + ax * by - ay * bx + az * bw
            r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
            r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
            r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
            p = sensor[0] - object_in_robot[n, 0]
            q = sensor[1] - object_in_robot[n, 1]
            r = sensor[2] - object_in_robot[n, 2]
            tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
            px = p + aw * tx + ay * tz - az * ty
            py = q + aw * ty + az * tx - ax * tz
            pz = r + aw * tz + ax * ty - ay * tx
            # Where the anchor is in the object.
            p = anchor[0] - object_in_robot[n, 0]
            q = anchor[1] - object_in_robot[n, 1]
            r = anchor[2] - object_in_robot[n, 2]
            tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
            cx = p + aw * tx + ay * tz - az * ty
            cy = q + aw * ty + az * tx - ax * tz
            cz = r + aw * tz + ax * ty - ay * tx
            for k in range(touches.points[m]):
                u, v, h = touches.point[m, k, 0], touches.point[m, k, 1], touches.point[m, k, 2]
                x = px + r00 * u + r01 * v + r02 * h
                y = py + r10 * u + r11 * v + r12 * h
                z = pz + r20 * u + r21 * v + r22 * h
                lever = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
                moved = turn * lever + shift
                spread = math.sqrt(width * width + moved * moved)
                total -= touches.point[m, k, 3] * _penalty(distance_at(voxels, x, y, z), spread)
            if total <= least:
                break
            for k in range(touches.frees[m]):
                u, v, h = touches.free[m, k, 0], touches.free[m, k, 1], touches.free[m, k, 2]
                x = px + r00 * u + r01 * v + r02 * h
                y = py + r10 * u + r11 * v + r12 * h
                z = pz + r20 * u + r21 * v + r22 * h
                away = distance_at(voxels, x, y, z)
                if away < 0:
                    lever = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
                    moved = turn * lever + shift
                    total -= 0.3 * _penalty(away, math.sqrt(width * width + moved * moved))
            if total <= least:
                break
            # The pad's way: a ball about its middle may be free, and with it all of the pad; else point by point.
            worst = 0.0
            at = touches.begin[m]
            while at < stroke:
                x, y, z = px - at * r02, py - at * r12, pz - at * r22
                nearest = distance_at(voxels, x, y, z)
                if nearest > radius + 0.5:
                    at += nearest - radius
                    continue
                for k in range(len(lattice)):
                    u, v = lattice[k, 0], lattice[k, 1]
                    x = px + r00 * u + r01 * v - at * r02
                    y = py + r10 * u + r11 * v - at * r12
                    z = pz + r20 * u + r21 * v - at * r22
                    away = distance_at(voxels, x, y, z)
                    nearest = min(nearest, away)
                    if away < 0:
                        lever = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
                        moved = turn * lever + shift
                        worst = max(worst, _penalty(away, math.sqrt(width * width + moved * moved)))
                at += max(nearest, 1.5)
            total -= worst
        score[n] = total


@compiled(void(VOXELS, REALS_2D, REALS))
def distances(voxels: Voxels, place: Reals, distance: Reals) -> None:
    """Write the signed distances (n,) mm at places (n, 3) mm."""
    for n in range(len(place)):
        distance[n] = distance_at(voxels, place[n, 0], place[n, 1], place[n, 2])
