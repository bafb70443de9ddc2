"""Steps of a pose that least squares ask for: six equations, and where a step leads."""

from __future__ import annotations

import math

from tactsim.core.compiling import Reals1D, Reals2D, compiled


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
