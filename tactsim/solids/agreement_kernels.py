"""How well what a pad felt agrees with what was foreseen: the log-likelihood of a reading, and what it depends on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from tactsim.core.compiling import Ints1D, Reals, Reals1D, Reals2D, compiled

WAYS = 5  # in which the pad may be displaced: along z, about x and y, along x and y


class Touching(NamedTuple):
    """How the pad feels, as it was learned from training touches.

    ray: (rays, 3) mm, where rays leave the pad's unloaded surface, on a lattice with so many columns, `step` mm apart.
    taxel: (taxels, 2) mm. start: (taxels + 1,), which, share: which rays a taxel reads, and how much of each.
    stiffness: kPa/mm. soft: mm by which a contact begins early and ends late. deepest: mm that a surface is in the
    layer at most. stroke: mm. noise: (taxels,) kPa, what a taxel reads beside the model. rough: mm, by how much the map
    errs. aside: mm, by how much it, or the pad's place, errs along the pad, which counts where the surface slopes.
    displaced: [mm, rad, rad, mm, mm], by how much the stated pose errs along z, about x and y, and along x and y.
    swept: mm by which the map errs where the pad has passed. freedom: of Student's t. counts: the weight of a taxel.
    worst: about what log p falls to at most, where nothing explains a touch. full: kPa
    summed over rays that carry a touch's load. stiffer, softer: by how much the logarithm of the stiffness that the
    load asks for is off, above and below. split: by how much that of the part of the load that taxels read is off.
    """

    ray: Reals2D
    taxel: Reals2D
    start: Ints1D
    which: Ints1D
    share: Reals1D
    stiffness: float
    soft: float
    deepest: float
    stroke: float
    noise: Reals1D
    rough: float
    aside: float
    columns: int
    step: float
    displaced: Reals1D
    swept: float
    freedom: float
    counts: float
    worst: float
    full: float
    stiffer: float
    softer: float
    split: float


class Room(NamedTuple):
    """Arrays that `agreement` works in, made once for many touches.

    near: (rays,) the rays that may touch. into: (rays,) mm, how deep they are pressed; open_to: how that changes with
    their depth; sloped: (rays, 2) how their depth changes along x and y; wrong: mm by which it errs. pressed, error:
    (taxels,) mm and changes: (taxels, ways), the same of what taxels feel. matrix, vector: the normal equations of the
    displacement. of_load, of_image: (ways,) how sums over rays and taxels change. best, change: (ways,). counted: (1,)
    how much a touch counts, which is less the worse it agrees.
    """

    near: Ints1D
    into: Reals1D
    open_to: Reals1D
    sloped: Reals2D
    wrong: Reals1D
    pressed: Reals1D
    error: Reals1D
    changes: Reals2D
    matrix: Reals2D
    vector: Reals1D
    of_load: Reals1D
    of_image: Reals1D
    best: Reals1D
    change: Reals1D
    counted: Reals1D


@compiled(called_from_python=False)
def room_for(touching: Touching) -> Room:
    """Make room for touches by such a pad."""
    rays, taxels = len(touching.ray), len(touching.taxel)
    return Room(
        np.empty(rays, np.int64), np.zeros(rays), np.zeros(rays), np.zeros((rays, 2)), np.zeros(rays),
        np.empty(taxels), np.empty(taxels), np.empty((taxels, WAYS)), np.empty((WAYS, WAYS)), np.empty(WAYS),
        np.empty(WAYS), np.empty(WAYS), np.empty(WAYS), np.empty(WAYS), np.empty(1),
    )  # fmt: skip


_TURNS = 2  # linearisations of a touch in the pad's displacement; the second begins where the first ends
LOUD = 5.0  # by how much more than noise the sum of a reading must be for a contact
AHEAD = 0.5  # mm beyond where a contact begins, up to which a surface is looked for
_LEAST = 0.02  # of a touch's load: with less foreseen, nothing is foreseen
_TAILS = 3.0  # of Cauchy's kind: the larger, the lighter


@register_jitable
def _list_near(touching: Touching, depth: Reals, ahead: float, room: Room) -> int:
    """List the rays whose surface is less than `ahead` mm away, with their slopes and errors; returns how many."""
    columns, rows = touching.columns, len(depth) // touching.columns
    count = 0
    for ray in range(len(depth)):
        room.into[ray] = room.open_to[ray] = 0.0
        if depth[ray] <= -ahead:
            continue
        row, column = ray // columns, ray % columns
        left, right = ray - (column > 0), ray + (column + 1 < columns)
        low, high = ray - columns * (row > 0), ray + columns * (row + 1 < rows)
        along_x = (depth[right] - depth[left]) / (touching.step * max(right - left, 1))
        along_y = (depth[high] - depth[low]) / (touching.step * max((high - low) // columns, 1))
        room.sloped[ray, 0], room.sloped[ray, 1] = along_x, along_y
        room.wrong[ray] = math.sqrt(
            touching.rough**2 + touching.aside**2 * (along_x * along_x + along_y * along_y)
        )
        room.near[count] = ray
        count += 1
    return count


@register_jitable
def _press(touching: Touching, depth: Reals, near: int, room: Room) -> float:
    """Press the layer with the pad displaced by `best`; returns the sum of how deep rays are pressed, mm."""
    soft, best, load = touching.soft, room.best, 0.0
    room.of_load[:] = 0.0
    for n in range(near):
        ray = room.near[n]
        x, y = touching.ray[ray, 0], touching.ray[ray, 1]
        along_x, along_y = room.sloped[ray, 0], room.sloped[ray, 1]
        d = depth[ray] + best[0] + best[1] * y - best[2] * x + best[3] * along_x + best[4] * along_y
        begun = min(max(d + soft, 0.0), 2 * soft)
        room.into[ray], room.open_to[ray] = (
            begun * begun / (4 * soft) + max(d - soft, 0.0),
            begun / (2 * soft),
        )
        load += room.into[ray]
        room.of_load[0] += room.open_to[ray]
        room.of_load[1] += room.open_to[ray] * y
        room.of_load[2] -= room.open_to[ray] * x
        room.of_load[3] += room.open_to[ray] * along_x
        room.of_load[4] += room.open_to[ray] * along_y
    return load


@register_jitable
def _feel_taxels(touching: Touching, room: Room) -> float:
    """Let taxels feel the rays about them; returns the sum of how deep taxels are pressed, mm."""
    changes, image = room.changes, 0.0
    room.of_image[:] = 0.0
    for t in range(len(touching.taxel)):
        pressed, slope, error, along_x, along_y = 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(touching.start[t], touching.start[t + 1]):
            ray = touching.which[n]
            if room.open_to[ray] > 0:
                pressed += touching.share[n] * room.into[ray]
                part = touching.share[n] * room.open_to[ray]
                slope += part
                error += part * room.wrong[ray]
                along_x += part * room.sloped[ray, 0]
                along_y += part * room.sloped[ray, 1]
        room.pressed[t], room.error[t] = pressed, error
        changes[t, 0], changes[t, 1], changes[t, 2] = (
            slope, slope * touching.taxel[t, 1], -slope * touching.taxel[t, 0]
        )  # fmt: skip
        changes[t, 3], changes[t, 4] = along_x, along_y
        image += pressed
        if slope > 0:
            for a in range(WAYS):
                room.of_image[a] += changes[t, a]
    return image


@register_jitable
def _add(room: Room, rest: float, variance: float) -> float:
    """Add what is left of a quantity, which changes by `change` with the displacement; returns its misfit.

    What is left is taken to a displacement of 0, because the prior stands there.
    """
    change, best = room.change, room.best
    for a in range(WAYS):
        rest += change[a] * best[a]
    for a in range(WAYS):
        by = change[a] / variance
        room.vector[a] += by * rest
        for b in range(a + 1):
            room.matrix[a, b] += by * change[b]
    return rest * rest / variance


@register_jitable
def _solve(room: Room) -> float:
    """Factor the matrix (Cholesky), divide the vector by the factor; returns the factor's determinant."""
    matrix, vector, determinant = room.matrix, room.vector, 1.0
    for a in range(WAYS):
        for b in range(a + 1):
            value = matrix[a, b]
            for c in range(b):
                value -= matrix[a, c] * matrix[b, c]
            matrix[a, b] = math.sqrt(max(value, 1e-300)) if a == b else value / matrix[b, b]
        determinant *= matrix[a, a]
        value = vector[a]
        for c in range(a):
            value -= matrix[a, c] * vector[c]
        vector[a] = value / matrix[a, a]
    return determinant


@register_jitable
def _back(factor: Reals, vector: Reals, solved: Reals) -> None:
    """Divide a vector by the transposed factor, into `solved`."""
    for a in range(WAYS - 1, -1, -1):
        value = vector[a]
        for c in range(a + 1, WAYS):
            value -= factor[c, a] * solved[c]
        solved[a] = value / factor[a, a]


@compiled(called_from_python=False)
def agreement(touching: Touching, depth: Reals1D, reading: Reals1D, room: Room) -> float:
    """Give log p(reading | depths at the rays): Student's t, the pad's displacement integrated out.

    A touch carries a load that is known. A layer of the usual stiffness that is pressed by these depths might carry
    more or less: where it is pressed flat it is stiffer. So the image is as bright as the reading, and how far the load
    is off counts beside it, and how much of it taxels read.
    The pad may be displaced along its axes and turned about x and y; the readings are linear in that where the contact
    stays as it is and the surface goes on as it slopes, so that a Gauss-Newton step and a matrix 5 by 5 (Woodbury 1950)
    do it.
    """
    taxels, stiffness, counts = len(touching.taxel), touching.stiffness, touching.counts
    best, vector, matrix, change = room.best, room.vector, room.matrix, room.change
    near = _list_near(touching, depth, touching.soft + AHEAD, room)
    total, noise = 0.0, 0.0
    for t in range(taxels):
        total += reading[t]
        noise += touching.noise[t] ** 2
    met = total > LOUD * math.sqrt(noise)
    best[:] = 0.0
    if met:  # the linearisation begins where something touches
        highest = -np.inf
        for n in range(near):
            highest = max(highest, depth[room.near[n]])
        best[0] = min(max(touching.soft - highest, 0.0), 3 * touching.displaced[0])
    usual = touching.full / stiffness
    misfit, log_det, determinant = 0.0, 0.0, 1.0
    for turn in range(_TURNS):
        load = _press(touching, depth, near, room)
        image = _feel_taxels(touching, room)
        matrix[:] = 0.0
        vector[:] = 0.0
        for a in range(WAYS):
            matrix[a, a] = 1 / touching.displaced[a] ** 2
        misfit, log_det, scale, scaled = 0.0, 0.0, stiffness, False
        if met:
            loaded = load > _LEAST * usual
            faintest = _LEAST * total / stiffness
            scaled = image > faintest
            load, image = max(load, _LEAST * usual), max(image, faintest)
            scale = total / image
            # The load, beside that of a layer as stiff as it usually is.
            rest = math.log(usual / load)
            for a in range(WAYS):
                change[a] = room.of_load[a] / load if loaded else 0.0
            variance = touching.stiffer**2 + rest * rest / _TAILS if rest > 0 else touching.softer**2
            misfit += _add(room, rest, counts * variance)
            log_det += math.log(variance) / counts
            # The part of it that taxels read.
            rest = math.log(total / touching.full * load / image)
            for a in range(WAYS):
                change[a] = (room.of_image[a] / image if scaled else 0.0) - change[a]
            variance = touching.split**2 + noise / total**2 + rest * rest / _TAILS
            misfit += _add(room, rest, counts * variance)
            log_det += math.log(variance) / counts
        product = 1.0
        for t in range(taxels):
            variance = touching.noise[t] ** 2 + (scale * room.error[t]) ** 2
            rest = reading[t] - scale * room.pressed[t]
            product *= variance
            if t % 8 == 7:
                log_det += math.log(product)
                product = 1.0
            if room.changes[t, 0] > 0:
                dimmer = room.pressed[t] / image if scaled else 0.0
                for a in range(WAYS):
                    change[a] = scale * (room.changes[t, a] - dimmer * room.of_image[a])
                misfit += _add(room, rest, variance)
            else:
                misfit += rest * rest / variance
        log_det += math.log(product)
        determinant = _solve(room)
        for a in range(WAYS):
            determinant *= touching.displaced[a]
            misfit -= vector[a] * vector[a]
        if near == 0:  # no displacement changes anything
            break
        if turn + 1 < _TURNS:
            _back(matrix, vector, best)
            for a in range(WAYS):
                limit = 3 * touching.displaced[a]
                best[a] = min(max(best[a], -limit), limit)
    log_det += 2 * math.log(determinant)
    wide = touching.freedom + counts * max(misfit, 0.0)
    room.counted[0] = counts * (touching.freedom + counts * taxels) / wide
    spread = (touching.freedom + counts * taxels) * math.log(wide / touching.freedom)
    return -0.5 * (counts * log_det + spread)


@compiled(called_from_python=False)
def pull(touching: Touching, room: Room, information: Reals2D, towards: Reals1D) -> None:
    """Say what the touch that `agreement` has weighed last asks for: where the pad should be, seen from the object.

    With N and v the normal equations of the displacement and P its prior covariance, the displacement that would
    explain the reading is N^-1 v, with a covariance of N^-1 + P. Writes information (ways, ways), that covariance's
    inverse, and towards (ways,), the information times the displacement.
    """
    factor, solved = room.matrix, room.change
    for column in range(WAYS):
        for a in range(WAYS):
            value = 1.0 if a == column else 0.0
            for c in range(a):
                value -= factor[a, c] * solved[c]
            solved[a] = value / factor[a, a]
        _back(factor, solved, solved)
        by = 1 / touching.displaced[column] ** 2
        for a in range(WAYS):
            information[a, column] = -solved[a] * by / touching.displaced[a] ** 2
        information[column, column] += by
    _back(factor, room.vector, solved)
    for a in range(WAYS):
        towards[a] = room.counted[0] * solved[a] / touching.displaced[a] ** 2
        for b in range(WAYS):
            information[a, b] *= room.counted[0]


@compiled()
def agreements(touching: Touching, depth: Reals2D, reading: Reals2D, log_p: Reals1D) -> None:
    """Write log p (n,) of readings (n, taxels) kPa, given depths (n, rays) mm."""
    room = room_for(touching)
    for n in range(len(depth)):
        log_p[n] = agreement(touching, depth[n], reading[n], room)
