"""The kernel that says how far poses are from modes of a belief."""

from __future__ import annotations

import math

import numpy as np
from numba import void

from tactsim.core.compiling import REALS_2D, REALS_3D, Reals, compiled


@compiled(void(REALS_2D, REALS_3D, REALS_2D, REALS_2D))
def squares_away(modes: Reals, factor: Reals, poses: Reals, away: Reals) -> None:
    """Write how many squared standard deviations poses (n, 7) are from modes (k, 7): away (k, n).

    factor: (k, 6, 6), the lower Cholesky factors of the information about [shift, turn] in the mode's own frame.
    """
    off = np.empty(6)
    for k in range(len(modes)):
        w, x, y, z = modes[k, 3], -modes[k, 4], -modes[k, 5], -modes[k, 6]
        for n in range(len(poses)):
            p, q, r = poses[n, 0] - modes[k, 0], poses[n, 1] - modes[k, 1], poses[n, 2] - modes[k, 2]
            tx, ty, tz = 2 * (y * r - z * q), 2 * (z * p - x * r), 2 * (x * q - y * p)
            off[0] = p + w * tx + y * tz - z * ty
            off[1] = q + w * ty + z * tx - x * tz
            off[2] = r + w * tz + x * ty - y * tx
            a, b, c, d = poses[n, 3], poses[n, 4], poses[n, 5], poses[n, 6]
            real = w * a - x * b - y * c - z * d
            i = w * b + x * a + y * d - z * c
            j = w * c - x * d + y * a + z * b
            m = w * d + x * c - y * b + z * a
            length = math.sqrt(i * i + j * j + m * m)
            # Of the two quaternions of a turn the one of the shorter way.
            by = 2.0 if length < 1e-12 else 2 * math.atan2(length, abs(real)) / length
            by = -by if real < 0 else by
            off[3], off[4], off[5] = by * i, by * j, by * m
            total = 0.0
            for column in range(6):
                value = 0.0
                for row in range(column, 6):
                    value += off[row] * factor[k, row, column]
                total += value * value
            away[k, n] = total
