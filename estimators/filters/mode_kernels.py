"""The inner loops of the synthesis estimator: score a bank of readings, and solve the Gaussians of its modes."""

from __future__ import annotations

import math

import numpy as np
from numba import boolean, float64, int64, void

from tactsim.core.compiling import (
    FLOATS_2D,
    INTS,
    REALS,
    REALS_2D,
    REALS_3D,
    REALS_4D,
    Floats,
    Ints,
    Reals,
    compiled,
)


@compiled(
    int64(
        FLOATS_2D, REALS, REALS, REALS_2D, REALS, FLOATS_2D, REALS, float64, INTS, INTS, REALS_2D, REALS
    )
)  # fmt: skip
def score_places(
    mean: Floats, precision: Reals, constant: Reals, xy: Reals, angle: Reals, reading: Floats, sensor_in_robot: Reals,
    reach: float, entry: Ints, turn: Ints, state: Reals, score: Reals,
) -> int:  # fmt: skip
    """Score the poses of a bank at which T_R^O has x and y within `reach`; returns how many there are.

    mean: (m * k, taxels), precision: (m * k,) 1 / variance, constant: (m * k,) the log-density's. xy: (k, 2),
    angle: (m,). reading: (turns, taxels), as it is and as a pad turned on itself reads it. entry, turn, score
    (turns * m * k,) and state (turns * m * k, 3): filled from the front.
    """
    found, taxels = 0, mean.shape[1]
    turns = len(reading)
    for t in range(turns):
        z = reading[t]
        for a in range(len(angle)):
            theta = angle[a] + t * 2 * math.pi / turns - sensor_in_robot[2]
            cos, sin = math.cos(theta), math.sin(theta)
            x = cos * sensor_in_robot[0] - sin * sensor_in_robot[1]
            y = sin * sensor_in_robot[0] + cos * sensor_in_robot[1]
            for k in range(len(xy)):
                state_x, state_y = xy[k, 0] - x, xy[k, 1] - y
                if abs(state_x) > reach or abs(state_y) > reach:
                    continue
                i = a * len(xy) + k
                away = np.float32(0)
                for s in range(taxels):
                    apart = z[s] - mean[i, s]
                    away += apart * apart
                entry[found], turn[found] = i, t
                state[found, 0], state[found, 1], state[found, 2] = state_x, state_y, theta
                score[found] = constant[i] - 0.5 * precision[i] * away
                found += 1
    return found


@compiled(float64(REALS_2D, REALS_2D), called_from_python=False)
def invert_3(matrix: Reals, inverse: Reals) -> float:
    """Invert a symmetric positive definite matrix (3, 3); returns its determinant."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * aa + b * bb + c * cc
    inverse[0, 0] = aa / determinant
    inverse[0, 1] = inverse[1, 0] = bb / determinant
    inverse[0, 2] = inverse[2, 0] = cc / determinant
    inverse[1, 1] = (a * f - c * c) / determinant
    inverse[1, 2] = inverse[2, 1] = (b * c - a * e) / determinant
    inverse[2, 2] = (a * d - b * b) / determinant
    return determinant


@compiled(
    void(
        REALS_2D, REALS_3D, REALS, REALS_3D, REALS_2D, REALS_3D, REALS_4D, REALS, REALS_2D, boolean, REALS_2D,
        REALS_3D, REALS,
    )
)  # fmt: skip
def solve_modes(
    prior_mean: Reals, prior_cov: Reals, log_prior: Reals, at: Reals, log_p: Reals, gradient: Reals,
    information: Reals, floor: Reals, now: Reals, doubt: bool, mean: Reals, cov: Reals, log_weight: Reals,
) -> None:  # fmt: skip
    """Multiply the Gaussian priors of n modes with the expanded likelihoods of k readings (`Modes`).

    floor: (k,) the log-density of each reading as an outlier. now: (n, 3) where the modes are. If `doubt`, a reading
    that is less likely than its floor there is one, and says nothing of the pose. Results: mean, cov, log_weight.
    """
    precision, of_prior, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    away, slope, step, bent = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(log_prior)):
        from_prior = now[n] - prior_mean[n]
        prior_det = invert_3(prior_cov[n], of_prior)
        value = log_prior[n]
        for i in range(3):
            slope[i] = 0.0
            for j in range(3):
                precision[i, j] = of_prior[i, j]
                slope[i] -= of_prior[i, j] * from_prior[j]
            value += slope[i] * from_prior[i] / 2
        for k in range(len(floor)):
            here = log_p[n, k]
            for i in range(3):
                away[i] = now[n, i] - at[n, k, i]
            for i in range(3):
                bent[i] = 0.0
                for j in range(3):
                    bent[i] += information[n, k, i, j] * away[j]
                here += (gradient[n, k, i] - bent[i] / 2) * away[i]
            if doubt and here < floor[k]:
                value += floor[k]
                continue
            value += here
            for i in range(3):
                slope[i] += gradient[n, k, i] - bent[i]
                for j in range(3):
                    precision[i, j] += information[n, k, i, j]
        determinant = invert_3(precision, inverse)
        for i in range(3):
            step[i] = 0.0
            for j in range(3):
                step[i] += inverse[i, j] * slope[j]
                cov[n, i, j] = inverse[i, j]
        for i in range(3):
            mean[n, i] = now[n, i] + step[i]
            value += slope[i] * step[i] / 2
        log_weight[n] = value - 0.5 * math.log(prior_det * determinant)
