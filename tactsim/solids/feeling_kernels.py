"""Kernels that foresee what a pad feels of a surface on voxels, weigh touches by it, and move poses to agree better."""

from __future__ import annotations

import math

import numpy as np
from numba.extending import register_jitable

from tactsim.core.compiling import Reals, Reals1D, Reals2D, Reals3D, compiled
from tactsim.solids.agreement_kernels import AHEAD, LOUD, WAYS, Touching, agreement, pull, room_for
from tactsim.solids.screen_kernels import advance, shortened, solve
from tactsim.solids.voxels import Voxels, distance_at, first_hit

HOPELESS = 2.0  # mm that an object reaches into what the pad has swept; then no ray is looked at
_WORST = 200.0  # nats that this costs at most


@compiled(called_from_python=False)
def sensor_in_object(
    object_in_robot: Reals1D, sensor_in_robot: Reals1D, place: Reals1D, turn: Reals2D
) -> None:
    """Write the sensor's pose in the object as a place (3,) mm and a rotation matrix (3, 3)."""
    aw, ax, ay, az = object_in_robot[3], -object_in_robot[4], -object_in_robot[5], -object_in_robot[6]
    bw, bx, by, bz = sensor_in_robot[3], sensor_in_robot[4], sensor_in_robot[5], sensor_in_robot[6]
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    p = sensor_in_robot[0] - object_in_robot[0]
    q = sensor_in_robot[1] - object_in_robot[1]
    r = sensor_in_robot[2] - object_in_robot[2]
    tx, ty, tz = 2 * (ay * r - az * q), 2 * (az * p - ax * r), 2 * (ax * q - ay * p)
    place[0] = p + aw * tx + ay * tz - az * ty
    place[1] = q + aw * ty + az * tx - ax * tz
    place[2] = r + aw * tz + ax * ty - ay * tx


@compiled(called_from_python=False)
def feel(
    voxels: Voxels, ray: Reals2D, place: Reals1D, turn: Reals2D, deepest: float, ahead: float, depth: Reals1D
) -> None:
    """Write for each ray how deep the surface lies in the layer, mm in [-ahead, deepest]; below 0, it is ahead.

    What is ahead counts by its distance, along the ray or not. A look at the rays' feet all together is quick; only a
    ray that begins inside the object walks back to where it came in.
    """
    dx, dy, dz = turn[0, 2], turn[1, 2], turn[2, 2]
    for n in range(len(ray)):
        x = place[0] + turn[0, 0] * ray[n, 0] + turn[0, 1] * ray[n, 1] + dx * ray[n, 2]
        y = place[1] + turn[1, 0] * ray[n, 0] + turn[1, 1] * ray[n, 1] + dy * ray[n, 2]
        z = place[2] + turn[2, 0] * ray[n, 0] + turn[2, 1] * ray[n, 1] + dz * ray[n, 2]
        depth[n] = -distance_at(voxels, x, y, z)
    for n in range(len(ray)):
        here = -depth[n]
        if here >= deepest:
            depth[n] = -ahead
            continue
        x = place[0] + turn[0, 0] * ray[n, 0] + turn[0, 1] * ray[n, 1] + dx * ray[n, 2]
        y = place[1] + turn[1, 0] * ray[n, 0] + turn[1, 1] * ray[n, 1] + dy * ray[n, 2]
        z = place[2] + turn[2, 0] * ray[n, 0] + turn[2, 1] * ray[n, 1] + dz * ray[n, 2]
        inside = here < 0
        # A step a little too far back ends the search, with a secant.
        step = 1.2 * here if inside else -(here + deepest) / 2
        at, value = 0.0, here
        while True:
            before, last = at, value
            at = max(at + min(step, -0.2), -deepest)
            value = distance_at(voxels, x + at * dx, y + at * dy, z + at * dz)
            if value >= 0 or at == -deepest or not inside:
                break
            step = 1.2 * value / min(max((value - last) / (before - at), 0.3), 1.0)
        if inside:
            depth[n] = deepest if value < 0 else value / (value - last) * (at - before) - at
        elif value > 0:
            depth[n] = max(-here, -ahead)
        else:  # something thin lies behind the place
            depth[n] = -first_hit(voxels, x, y, z, dx, dy, dz, -deepest, ahead)


@compiled()
def feel_all(
    voxels: Voxels,
    ray: Reals2D,
    places: Reals2D,
    turns: Reals3D,
    deepest: float,
    ahead: float,
    depth: Reals2D,
) -> None:
    """Write depths (n, rays) mm for sensors at places (n, 3) mm, turned by (n, 3, 3), in the object."""
    for n in range(len(places)):
        feel(voxels, ray, places[n], turns[n], deepest, ahead, depth[n])


@compiled(called_from_python=False)
def intrusion(
    voxels: Voxels, corner: Reals2D, place: Reals1D, turn: Reals2D, deepest: float, stroke: float
) -> float:
    """Give how far the object reaches into the slab that the pad has swept, mm; 0 if it does not.

    corner: (points, 2) mm over the pad, the middle first.
    """
    dx, dy, dz = turn[0, 2], turn[1, 2], turn[2, 2]
    radius = 0.0
    for n in range(1, len(corner)):
        radius = max(
            radius, math.sqrt((corner[n, 0] - corner[0, 0]) ** 2 + (corner[n, 1] - corner[0, 1]) ** 2)
        )
    most = 0.0
    at = deepest
    while at < stroke:
        x = place[0] + turn[0, 0] * corner[0, 0] + turn[0, 1] * corner[0, 1] - at * dx
        y = place[1] + turn[1, 0] * corner[0, 0] + turn[1, 1] * corner[0, 1] - at * dy
        z = place[2] + turn[2, 0] * corner[0, 0] + turn[2, 1] * corner[0, 1] - at * dz
        nearest = distance_at(voxels, x, y, z)
        if nearest > radius + 0.5:  # a ball about the middle is free, and with it all of the pad
            at += nearest - radius
            continue
        for n in range(1, len(corner)):
            x = place[0] + turn[0, 0] * corner[n, 0] + turn[0, 1] * corner[n, 1] - at * dx
            y = place[1] + turn[1, 0] * corner[n, 0] + turn[1, 1] * corner[n, 1] - at * dy
            z = place[2] + turn[2, 0] * corner[n, 0] + turn[2, 1] * corner[n, 1] - at * dz
            nearest = min(nearest, distance_at(voxels, x, y, z))
        most = max(most, -nearest)
        at += max(nearest, 1.5)
    return most


@register_jitable
def bounded(touching: Touching, agreed: float, into: float) -> float:
    """Give log p of a touch that agrees so much, of a pad that came through so many mm of the object.

    At least about touching.worst: something that no map knows may explain it, too.
    """
    over = agreed - min(0.5 * (into / touching.swept) ** 2, _WORST) - touching.worst
    return touching.worst + max(over, 0.0) + math.log1p(math.exp(-abs(over)))


@compiled()
def add_log_p(
    voxels: Voxels, touching: Touching, corner: Reals2D, object_in_robot: Reals2D, readings: Reals2D,
    sensor_in_robot: Reals2D, first: int, last: int, log_p: Reals1D,
) -> None:  # fmt: skip
    """Add to log_p (n,) for objects at (n, 7) what touches first, ..., last - 1 say.

    readings: (m, taxels) kPa. sensor_in_robot: (m, 7). corner: as in `intrusion`.
    """
    place, turn = np.empty(3), np.empty((3, 3))
    depth = np.empty(len(touching.ray))
    ahead, room = touching.soft + AHEAD, room_for(touching)
    free, buried = np.empty(last), np.empty(last)
    for m in range(
        first, last
    ):  # what a reading says of a state in which no ray meets anything, and all begin inside
        depth[:] = -ahead
        free[m] = agreement(touching, depth, readings[m], room)
        depth[:] = touching.deepest
        buried[m] = agreement(touching, depth, readings[m], room)
    for n in range(len(object_in_robot)):
        for m in range(first, last):
            sensor_in_object(object_in_robot[n], sensor_in_robot[m], place, turn)
            into = intrusion(voxels, corner, place, turn, touching.deepest, touching.stroke)
            if into > HOPELESS:
                said = buried[m]
            else:
                feel(voxels, touching.ray, place, turn, touching.deepest, ahead, depth)
                felt = False
                for ray in range(len(depth)):
                    felt |= depth[ray] > -ahead
                said = agreement(touching, depth, readings[m], room) if felt else free[m]
            log_p[n] += bounded(touching, said, into)


@compiled()
def foresee_touches(
    voxels: Voxels, touching: Touching, object_in_robot: Reals2D, start: Reals2D, load: float, area: float,
    travel: Reals1D, image: Reals2D,
) -> None:  # fmt: skip
    """Write how far pads go from `start` (n, 7) until they carry `load` N, mm, and what they then read, kPa.

    object_in_robot: (n, 7). area: mm^2 that a ray stands for. travel: (n,), image: (n, taxels).
    """
    place, turn = np.empty(3), np.empty((3, 3))
    rays = len(touching.ray)
    depth = np.empty(rays)
    for n in range(len(start)):
        sensor_in_object(object_in_robot[n], start[n], place, turn)
        dx, dy, dz = turn[0, 2], turn[1, 2], turn[2, 2]
        for i in range(rays):
            x, y, z = touching.ray[i, 0], touching.ray[i, 1], touching.ray[i, 2]
            depth[i] = first_hit(
                voxels,
                place[0] + turn[0, 0] * x + turn[0, 1] * y + dx * z,
                place[1] + turn[1, 0] * x + turn[1, 1] * y + dy * z,
                place[2] + turn[2, 0] * x + turn[2, 1] * y + dz * z,
                dx, dy, dz, 0.0, touching.stroke + touching.deepest,
            )  # fmt: skip
        low, high = 0.0, touching.stroke
        for _ in range(30):
            at = (low + high) / 2
            force = 0.0
            for i in range(rays):
                force += min(max(at - depth[i], 0.0), touching.deepest)
            if force * touching.stiffness * area / 1000 < load:
                low = at
            else:
                high = at
        travel[n] = high
        for t in range(len(touching.taxel)):
            image[n, t] = 0.0
            for i in range(touching.start[t], touching.start[t + 1]):
                into = min(max(high - depth[touching.which[i]], 0.0), touching.deepest)
                image[n, t] += touching.share[i] * touching.stiffness * into


_FAR = 2.5  # mm up to which a surface is looked for that a touch has met
_VAGUE = 1.0  # mm by which such a surface may be off
_HELD = 3.0, 0.3  # mm and rad: the standard deviation of a step, if touches say nothing
_LONGEST = 2.0, 0.2  # mm and rad of a step
_SHORTER = 0.4  # times as long is the next step from where one has ended worse


@register_jitable
def _displaced(place: Reals, turn: Reals, ways: Reals) -> None:
    """Write how a pad is displaced, in its own frame, when the object moves in its own: (ways, 6)."""
    for a in range(WAYS):
        axis = (2, 0, 1, 0, 1)[a]
        x, y, z = turn[0, axis], turn[1, axis], turn[2, axis]
        if a == 1 or a == 2:
            ways[a, 0] = ways[a, 1] = ways[a, 2] = 0.0
            ways[a, 3], ways[a, 4], ways[a, 5] = -x, -y, -z
        else:
            ways[a, 0], ways[a, 1], ways[a, 2] = -x, -y, -z
            ways[a, 3] = place[2] * y - place[1] * z
            ways[a, 4] = place[0] * z - place[2] * x
            ways[a, 5] = place[1] * x - place[0] * y


@compiled()
def climb(
    voxels: Voxels, touching: Touching, corner: Reals2D, object_in_robot: Reals2D, readings: Reals2D,
    sensor_in_robot: Reals2D, steps: int, information: Reals3D, log_p: Reals1D,
) -> None:  # fmt: skip
    """Move objects at (n, 7) by at most so many Gauss-Newton steps, changed in place, never to where less is agreed on.

    Every touch asks for a displacement of its pad (`pull`), which the object's pose is to give it. A step that ends
    worse is taken again from where it began, and shorter. corner: as in `intrusion`. readings: (m, taxels) kPa at
    sensor_in_robot (m, 7). Fills information (n, 6, 6) about [x, y, z, about x, about y, about z] in the object's
    frame, mm and rad, and log_p (n,), that of `add_log_p`, both at the poses that are reached.
    """
    place, turn, depth = np.empty(3), np.empty((3, 3)), np.empty(len(touching.ray))
    room, ahead = room_for(touching), touching.soft + AHEAD
    asked, towards, ways = np.empty((WAYS, WAYS)), np.empty(WAYS), np.empty((WAYS, 6))
    matrix, step, best_step, pose = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(7)
    for n in range(len(object_in_robot)):
        best, pace = -np.inf, 1.0
        pose[:] = object_in_robot[n]
        for turns in range(steps + 1):
            matrix[:] = 0.0
            step[:] = 0.0
            for axis in range(3):
                matrix[axis, axis], matrix[axis + 3, axis + 3] = 1 / _HELD[0] ** 2, 1 / _HELD[1] ** 2
            total = 0.0
            for m in range(len(readings)):
                sensor_in_object(pose, sensor_in_robot[m], place, turn)
                into = intrusion(voxels, corner, place, turn, touching.deepest, touching.stroke)
                feel(voxels, touching.ray, place, turn, touching.deepest, _FAR, depth)
                highest = -np.inf
                for ray in range(len(depth)):
                    highest = max(highest, depth[ray])
                    depth[ray] = max(depth[ray], -ahead)
                total += bounded(touching, agreement(touching, depth, readings[m], room), into)
                if into > HOPELESS:
                    continue
                if highest > -ahead:
                    pull(touching, room, asked, towards)
                elif highest > -_FAR and readings[m].sum() > LOUD * math.sqrt((touching.noise**2).sum()):
                    asked[:] = 0.0
                    towards[:] = 0.0
                    asked[0, 0], towards[0] = 1 / _VAGUE**2, -highest / _VAGUE**2
                else:
                    continue
                _displaced(place, turn, ways)
                for i in range(6):
                    for a in range(WAYS):
                        step[i] += ways[a, i] * towards[a]
                        by = 0.0
                        for b in range(WAYS):
                            by += ways[b, i] * asked[b, a]
                        for j in range(6):
                            matrix[i, j] += by * ways[a, j]
            if total > best:
                best, pace = total, 1.0
                object_in_robot[n], information[n], log_p[n] = pose, matrix, total
                solve(matrix, step)
                best_step[:] = step
            else:
                pace *= _SHORTER
            if turns < steps:
                pose[:] = object_in_robot[n]
                advance(pose, best_step, pace * shortened(best_step, *_LONGEST))
