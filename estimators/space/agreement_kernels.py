"""How well what a pad felt agrees with what was foreseen: the log-likelihood of a reading, and what it depends on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled

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


@compiled(void(TOUCHING, REALS_2D, REALS_2D, REALS))
def agreements(touching: Touching, depth: Reals, reading: Reals, log_p: Reals) -> None:
    """Write log p (n,) of readings (n, taxels) kPa, given depths (n, rays) mm."""
    for n in range(len(depth)):
        log_p[n] = agreement(touching, depth[n], reading[n])
