"""The quick look at a pose: do the touched points lie on the surface, and does the pad's way lie outside of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled
from tactsim.estimators.space.voxels import VOXELS, Voxels, distance_at

_STEP = 3.0  # mm, how far apart at least the pad is looked at on its way
_FREE = 0.6  # the weight of a place that nothing is above
_BOUND = 8.0  # nats that one point can count against a pose at most: a map may be wrong somewhere
_MOST = 20.0  # nats that one touch can


class TouchPoints(NamedTuple):
    """What touches say in points, in each sensor's frame.

    sensor: (m, 7) sensor_in_robot. point: (m, points, 4) [x, y, z, weight] mm, on the surface. points: (m,) how many of
    them. free: (m, places, 3) mm, places on the pad with nothing above them. frees: (m,). begin: (m,) mm behind the
    pad's plane, from where on its way back was free.
    """

    sensor: Reals
    point: Reals
    points: Ints
    free: Reals
    frees: Ints
    begin: Reals


TOUCH_POINTS = types.NamedTuple((REALS_2D, REALS_3D, INTS, REALS_3D, INTS, REALS), TouchPoints)


@compiled(float64(float64, float64), called_from_python=False)
def _penalty(square: float, variance: float) -> float:
    """Give the nats that a squared distance counts: half of it by its variance, bounded (Geman and McClure 1985)."""
    half = 0.5 * square / variance
    return half / (1 + half / _BOUND)


@compiled(
    void(
        VOXELS, TOUCH_POINTS, REALS_2D, float64, REALS_2D, int64, int64, REALS, float64, float64, float64, float64,
        REALS,
    )
)  # fmt: skip
def screen(
    voxels: Voxels, touches: TouchPoints, lattice: Reals, radius: float, object_in_robot: Reals, first: int, last: int,
    anchor: Reals, turn: float, shift: float, width: float, least: float, score: Reals,
) -> None:  # fmt: skip
    """Add to score (n,) what touches first, ..., last - 1 say of poses object_in_robot (n, 7), in nats, at most 0.

    A pose stands for those that are turned from it about the anchor (3,) mm by about `turn` rad and moved by about
    `shift` mm. Distances change by at most as much as places move: so the variance of a point's distance is that of the
    map, `width`^2, and how far the point may move, squared. lattice: (points, 2) mm over the pad. radius: mm about the
    object's origin that holds it. A score that falls to `least` or below is not worked out further.
    """
    pad = 0.0
    for k in range(len(lattice)):
        pad = max(pad, math.sqrt(lattice[k, 0] ** 2 + lattice[k, 1] ** 2))
    fixed, turns = width * width + shift * shift, turn * turn
    for n in range(len(object_in_robot)):
        aw, ax, ay, az = (
            object_in_robot[n, 3], -object_in_robot[n, 4], -object_in_robot[n, 5], -object_in_robot[n, 6]
        )  # fmt: skip
        # Where the anchor is in the object.
        p = anchor[0] - object_in_robot[n, 0]
        q = anchor[1] - object_in_robot[n, 1]
        r = anchor[2] - object_in_robot[n, 2]
        tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
        cx = p + aw * tx + ay * tz - az * ty
        cy = q + aw * ty + az * tx - ax * tz
        cz = r + aw * tz + ax * ty - ay * tx
        total = score[n]
        for m in range(first, last):
            if total <= least:
                break
            lost = 0.0
            bw, bx, by, bz = (
                touches.sensor[m, 3], touches.sensor[m, 4], touches.sensor[m, 5], touches.sensor[m, 6]
            )  # fmt: skip
            w = aw * bw - ax * bx - ay * by - az * bz
            x = aw * bx + ax * bw + ay * bz - az * by
            y = aw * by - ax * bz + ay * bw + az * bx
            z = aw * bz + ax * by - ay * bx + az * bw
            r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
            r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
            r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
            p = touches.sensor[m, 0] - object_in_robot[n, 0]
            q = touches.sensor[m, 1] - object_in_robot[n, 1]
            r = touches.sensor[m, 2] - object_in_robot[n, 2]
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
                lost += touches.point[m, k, 3] * _penalty(away * away, fixed + turns * lever)
            for k in range(touches.frees[m]):
                u, v, h = touches.free[m, k, 0], touches.free[m, k, 1], touches.free[m, k, 2]
                x = px + r00 * u + r01 * v + r02 * h
                y = py + r10 * u + r11 * v + r12 * h
                z = pz + r20 * u + r21 * v + r22 * h
                away = distance_at(voxels, x, y, z)
                if away < 0:
                    lever = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
                    lost += _FREE * _penalty(away * away, fixed + turns * lever)
            # The pad's way, as far as it is near the object. A ball about its middle may be free, and with it all of
            # the pad; else it is looked at point by point.
            along = px * r02 + py * r12 + pz * r22
            beside = px * px + py * py + pz * pz - along * along
            near = math.sqrt(max((radius + pad) ** 2 - beside, 0.0))
            at, end = max(touches.begin[m], along - near), (along + near if near > 0 else -np.inf)
            worst = 0.0
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
                        worst = max(worst, _penalty(away * away, fixed + turns * lever))
                at += max(nearest, _STEP)
            lost += worst
            total -= lost / (1 + lost / _MOST)
        score[n] = total


@compiled(void(VOXELS, REALS_2D, REALS))
def distances(voxels: Voxels, place: Reals, distance: Reals) -> None:
    """Write the signed distances (n,) mm at places (n, 3) mm."""
    for n in range(len(place)):
        distance[n] = distance_at(voxels, place[n, 0], place[n, 1], place[n, 2])
