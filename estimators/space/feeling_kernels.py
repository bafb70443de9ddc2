"""Kernels that foresee what a pad feels of a surface on voxels, and how well that agrees with what it felt."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled
from tactsim.estimators.space.voxels import VOXELS, Voxels, distance_at, first_hit

_HOPELESS = 2.0  # mm that an object reaches into what the pad has swept; then no ray is looked at
_WORST = 20.0  # nats that this costs at most
_WAYS = 5  # in which the pad may be displaced
_TURNS = 2  # linearisations of a touch in the pad's displacement; the second begins where the first ends


class Touching(NamedTuple):
    """How the pad feels, as it was learned from training touches.

    ray: (rays, 3) mm, where rays leave the pad's unloaded surface, on a lattice with so many columns, `step` mm apart.
    taxel: (taxels, 2) mm. start: (taxels + 1,), which, share: which rays a taxel reads, and how much of each.
    stiffness: kPa/mm. soft: mm by which a contact begins early and ends late. deepest: mm that a surface is in the
    layer at most. stroke: mm. noise: (taxels,) kPa, what a taxel reads beside the model. rough: mm, by how much the map
    errs. aside: mm, by how much it, or the pad's place, errs along the pad, which counts where the surface slopes.
    displaced: [mm, rad, rad, mm, mm], by how much the stated pose errs along z, about x and y, and along x and y.
    swept: mm by which the map errs where the pad has passed. freedom: of Student's t. counts: the weight of a taxel.
    trust: the weight of a touch.
    """

    ray: Reals
    taxel: Reals
    start: Ints
    which: Ints
    share: Reals
    stiffness: float
    soft: float
    deepest: float
    stroke: float
    noise: Reals
    rough: float
    aside: float
    columns: int
    step: float
    displaced: Reals
    swept: float
    freedom: float
    counts: float
    trust: float


TOUCHING = types.NamedTuple(
    (
        REALS_2D,
        REALS_2D,
        INTS,
        INTS,
        REALS,
        *[float64] * 4,
        REALS,
        float64,
        float64,
        int64,
        float64,
        REALS,
        *[float64] * 4,
    ),
    Touching,
)


@compiled(void(REALS, REALS, REALS, REALS_2D), called_from_python=False)
def sensor_in_object(object_in_robot: Reals, sensor_in_robot: Reals, place: Reals, turn: Reals) -> None:
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


@compiled(void(VOXELS, REALS_2D, REALS, REALS_2D, float64, float64, REALS), called_from_python=False)
def feel(
    voxels: Voxels, ray: Reals, place: Reals, turn: Reals, deepest: float, ahead: float, depth: Reals
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


@compiled(void(VOXELS, REALS_2D, REALS_2D, REALS_3D, float64, float64, REALS_2D))
def feel_all(
    voxels: Voxels, ray: Reals, places: Reals, turns: Reals, deepest: float, ahead: float, depth: Reals
) -> None:
    """Write depths (n, rays) mm for sensors at places (n, 3) mm, turned by (n, 3, 3), in the object."""
    for n in range(len(places)):
        feel(voxels, ray, places[n], turns[n], deepest, ahead, depth[n])


@compiled(float64(VOXELS, REALS_2D, REALS, REALS_2D, float64, float64), called_from_python=False)
def intrusion(
    voxels: Voxels, corner: Reals, place: Reals, turn: Reals, deepest: float, stroke: float
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


@compiled(float64(TOUCHING, REALS, REALS), called_from_python=False)
def agreement(touching: Touching, depth: Reals, reading: Reals) -> float:
    """Give log p(reading | depths at the rays): Student's t, the pad's displacement integrated out.

    The pad may be displaced along its axes and turned about x and y; the readings are linear in that where the contact
    stays as it is and the surface goes on as it slopes, so that a Gauss-Newton step and a matrix 5 by 5 (Woodbury 1950)
    do it.
    """
    taxels, rays = len(touching.taxel), len(depth)
    soft, stiffness = touching.soft, touching.stiffness
    best, change = np.zeros(_WAYS), np.empty(_WAYS)
    matrix, vector = np.empty((_WAYS, _WAYS)), np.empty(_WAYS)
    # How deep a ray is pressed, how that changes with its depth, and by how much the depth errs.
    into, open_to, wrong = np.empty(rays), np.empty(rays), np.empty(rays)
    sloped = np.empty((rays, 2))
    columns, rows = touching.columns, rays // touching.columns
    for row in range(rows):
        for column in range(columns):
            ray = row * columns + column
            left, right = ray - (column > 0), ray + (column + 1 < columns)
            low, high = ray - columns * (row > 0), ray + columns * (row + 1 < rows)
            along_x = (depth[right] - depth[left]) / (touching.step * max(right - left, 1))
            along_y = (depth[high] - depth[low]) / (touching.step * max((high - low) // columns, 1))
            sloped[ray, 0], sloped[ray, 1] = along_x, along_y
            wrong[ray] = math.sqrt(
                touching.rough**2 + touching.aside**2 * (along_x * along_x + along_y * along_y)
            )
    misfit, log_det, determinant = 0.0, 0.0, 0.0
    for turn in range(_TURNS):
        felt = False
        for ray in range(rays):
            d = depth[ray] + best[0] + best[1] * touching.ray[ray, 1] - best[2] * touching.ray[ray, 0]
            d += best[3] * sloped[ray, 0] + best[4] * sloped[ray, 1]
            begun = min(max(d + soft, 0.0), 2 * soft)
            into[ray] = begun * begun / (4 * soft) + max(d - soft, 0.0)
            open_to[ray] = begun / (2 * soft)
            felt |= begun > 0
        for a in range(_WAYS):
            vector[a] = 0.0
            for b in range(_WAYS):
                matrix[a, b] = 0.0
            matrix[a, a] = 1 / touching.displaced[a] ** 2
        misfit, product, log_det = 0.0, 1.0, 0.0
        for t in range(taxels):
            x, y = touching.taxel[t, 0], touching.taxel[t, 1]
            pressed, slope, error = 0.0, 0.0, 0.0
            change[3] = change[4] = 0.0
            if felt:
                for n in range(touching.start[t], touching.start[t + 1]):
                    ray = touching.which[n]
                    pressed += touching.share[n] * into[ray]
                    part = touching.share[n] * open_to[ray]
                    slope += part
                    error += part * wrong[ray]
                    change[3] += part * sloped[ray, 0]
                    change[4] += part * sloped[ray, 1]
            change[0], change[1], change[2] = slope, slope * y, -slope * x
            variance = touching.noise[t] ** 2 + (stiffness * error) ** 2
            # What is left is linear in the displacement from 0: its prior stands there.
            rest = reading[t] - stiffness * pressed
            for a in range(_WAYS):
                change[a] *= stiffness
                rest += change[a] * best[a]
            product *= variance
            if t % 8 == 7:
                log_det += math.log(product)
                product = 1.0
            misfit += rest * rest / variance
            if slope > 0:
                for a in range(_WAYS):
                    by = change[a] / variance
                    vector[a] += by * rest
                    for b in range(a + 1):
                        matrix[a, b] += by * change[b]
        log_det += math.log(product)
        # Cholesky's factor of the matrix, and the vector divided by it, then the displacement.
        determinant = 1.0
        for a in range(_WAYS):
            for b in range(a + 1):
                value = matrix[a, b]
                for c in range(b):
                    value -= matrix[a, c] * matrix[b, c]
                matrix[a, b] = math.sqrt(max(value, 1e-300)) if a == b else value / matrix[b, b]
            determinant *= matrix[a, a] * touching.displaced[a]
            value = vector[a]
            for c in range(a):
                value -= matrix[a, c] * vector[c]
            vector[a] = value / matrix[a, a]
            misfit -= vector[a] * vector[a]
        if not felt:  # no displacement changes anything
            break
        if turn + 1 < _TURNS:
            for a in range(_WAYS - 1, -1, -1):
                value = vector[a]
                for c in range(a + 1, _WAYS):
                    value -= matrix[c, a] * best[c]
                best[a] = value / matrix[a, a]
            for a in range(_WAYS):
                limit = 3 * touching.displaced[a]
                best[a] = min(max(best[a], -limit), limit)
    log_det += 2 * math.log(determinant)
    counts, freedom = touching.counts, touching.freedom
    spread = (freedom + counts * taxels) * math.log(1 + counts * max(misfit, 0.0) / freedom)
    return -0.5 * touching.trust * (counts * log_det + spread)


@compiled(void(VOXELS, TOUCHING, REALS_2D, REALS_2D, REALS_2D, REALS_2D, int64, int64, REALS))
def add_log_p(
    voxels: Voxels, touching: Touching, corner: Reals, object_in_robot: Reals, readings: Reals, sensor_in_robot: Reals,
    first: int, last: int, log_p: Reals,
) -> None:  # fmt: skip
    """Add to log_p (n,) for objects at (n, 7) what touches first, ..., last - 1 say.

    readings: (m, taxels) kPa. sensor_in_robot: (m, 7). corner: as in `intrusion`.
    """
    place, turn = np.empty(3), np.empty((3, 3))
    depth = np.empty(len(touching.ray))
    ahead = touching.soft + 0.5
    free, buried = np.empty(last), np.empty(last)
    for m in range(
        first, last
    ):  # what a reading says of a state in which no ray meets anything, and all begin inside
        depth[:] = -ahead
        free[m] = agreement(touching, depth, readings[m])
        depth[:] = touching.deepest
        buried[m] = agreement(touching, depth, readings[m])
    for n in range(len(object_in_robot)):
        for m in range(first, last):
            sensor_in_object(object_in_robot[n], sensor_in_robot[m], place, turn)
            into = intrusion(voxels, corner, place, turn, touching.deepest, touching.stroke)
            log_p[n] -= min(0.5 * (into / touching.swept) ** 2, _WORST)
            if into > _HOPELESS:
                log_p[n] += buried[m]
                continue
            feel(voxels, touching.ray, place, turn, touching.deepest, ahead, depth)
            felt = False
            for ray in range(len(depth)):
                felt |= depth[ray] > -touching.soft
            log_p[n] += agreement(touching, depth, readings[m]) if felt else free[m]


@compiled(void(TOUCHING, REALS_2D, REALS_2D, REALS))
def agreements(touching: Touching, depth: Reals, reading: Reals, log_p: Reals) -> None:
    """Write log p (n,) of readings (n, taxels) kPa, given depths (n, rays) mm."""
    for n in range(len(depth)):
        log_p[n] = agreement(touching, depth[n], reading[n])


@compiled(void(VOXELS, TOUCHING, REALS_2D, REALS_2D, float64, float64, REALS, REALS_2D))
def foresee_touches(
    voxels: Voxels, touching: Touching, object_in_robot: Reals, start: Reals, load: float, area: float, travel: Reals,
    image: Reals,
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
