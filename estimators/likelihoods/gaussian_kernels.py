"""The inner loop of the synthesis estimator: how probable readings are, and how that changes with the pose."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, REALS_3D, Ints, Reals, compiled


@compiled(void(REALS_2D, INTS, REALS_2D, REALS_3D, REALS_3D, float64, REALS, REALS, REALS_2D, REALS_3D))
def log_gaussian(
    reading: Reals, which: Ints, mean: Reals, by_pose: Reals, nuisance: Reals, noise: float,
    log_p: Reals, misfit: Reals, gradient: Reals, information: Reals,
) -> None:  # fmt: skip
    """Expand log N(z; mean, noise^2 1 + nuisance.T nuisance) in the pose, to second order, for n predictions.

    reading: (m, taxels) kPa, of which prediction i is compared with number which[i]. mean: (n, taxels), by_pose:
    (n, 3, taxels), nuisance: (n, q, taxels), as in `Linearised`. The inverse of the covariance follows from a
    matrix q by q (Woodbury 1950), and what changes it with the pose is left out (Gauss and Newton). Results:
    log_p (n,) at the pose, misfit (n,) the squared Mahalanobis distance, gradient (n, 3), information (n, 3, 3).
    """
    taxels, q = mean.shape[1], nuisance.shape[1]
    away, mixed = np.empty(taxels), np.empty((4, q))  # nuisance times the three derivatives and the residual
    factor = np.empty((q, q))
    constant = -0.5 * taxels * math.log(2 * math.pi * noise * noise)
    for n in range(len(mean)):
        z = reading[which[n]]
        for t in range(taxels):
            away[t] = (z[t] - mean[n, t]) / noise
        for a in range(q):
            for b in range(a + 1):
                total = 0.0
                for t in range(taxels):
                    total += nuisance[n, a, t] * nuisance[n, b, t]
                factor[a, b] = total / noise**2
            factor[a, a] += 1.0
            for i in range(3):
                total = 0.0
                for t in range(taxels):
                    total += nuisance[n, a, t] * by_pose[n, i, t]
                mixed[i, a] = total / noise**2
            total = 0.0
            for t in range(taxels):
                total += nuisance[n, a, t] * away[t]
            mixed[3, a] = total / noise
        # Cholesky's factor of 1 + nuisance nuisance.T / noise^2, and the mixed products divided by it.
        log_det = 0.0
        for a in range(q):
            for b in range(a + 1):
                total = factor[a, b]
                for k in range(b):
                    total -= factor[a, k] * factor[b, k]
                factor[a, b] = math.sqrt(total) if a == b else total / factor[b, b]
            log_det += math.log(factor[a, a])
            for i in range(4):
                total = mixed[i, a]
                for k in range(a):
                    total -= factor[a, k] * mixed[i, k]
                mixed[i, a] = total / factor[a, a]
        distance = 0.0
        for t in range(taxels):
            distance += away[t] * away[t]
        for a in range(q):
            distance -= mixed[3, a] ** 2
        misfit[n] = distance
        log_p[n] = constant - log_det - distance / 2
        for i in range(3):
            total = 0.0
            for t in range(taxels):
                total += by_pose[n, i, t] * away[t]
            total /= noise
            for a in range(q):
                total -= mixed[i, a] * mixed[3, a]
            gradient[n, i] = total
            for j in range(i + 1):
                total = 0.0
                for t in range(taxels):
                    total += by_pose[n, i, t] * by_pose[n, j, t]
                total /= noise**2
                for a in range(q):
                    total -= mixed[i, a] * mixed[j, a]
                information[n, i, j] = information[n, j, i] = total
