"""The Cramer-Rao bound of a trial: how near the truth any unbiased estimate of the object's place can be.

The information of a trial is the sum of that of its readings, and its inverse bounds the covariance of the object's
small move (x, y, turn). What is scored is a mean distance, so the bound is the mean length of a Gaussian of that
covariance, with the turn weighted by the square root of I/m.
"""

from __future__ import annotations

import numpy as np

from tactsim.bench.placement import Properties
from tactsim.core.poses import FloatArray

# A trial of an object at rest counts as determined by its readings if its bound is at most this. Beyond, what is known
# beforehand and what was not touched say more than the slopes of the readings: the bound is then the prior's.
MOST_MM = 0.5
FARTHEST_MM = 1000.0  # the bound where readings determine nothing: no object is lost by more
_LOGS = np.arange(-80.0, 80.5, 0.5)  # nodes of the integral in `mean_length`


def bound_mm(information: FloatArray, of: Properties) -> FloatArray:
    """Bound the mean placement error (...,) mm by the inverse of information (..., 3, 3) on an object's small move.

    A disc has no turn. Where the information is singular the bound is FARTHEST_MM, as it is beyond.
    """
    weights = np.array([1.0, 1.0, np.sqrt(of.inertia_over_mass)])[: 2 if of.symmetry == 0 else 3]
    size = len(weights)
    eigen = np.linalg.eigvalsh(information[..., :size, :size] / weights[:, None] / weights)
    # Rounding leaves some 1e-16 of the largest where there is nothing.
    whole = eigen[..., 0] > 1e-12 * np.maximum(eigen[..., -1], 1e-300)
    result = np.full(eigen.shape[:-1], FARTHEST_MM)
    result[whole] = np.minimum(mean_length(1 / eigen[whole]), FARTHEST_MM)
    return result


def walked(information: FloatArray, turns: FloatArray, walk_mm: float, walk_rad: float) -> FloatArray:
    """Sum information (n, r, 3, 3) of readings of an object that takes a random step before each but the first.

    Between two touches what is known of the last place becomes J' = (J^-1 + Q)^-1 = (1 + J Q)^-1 J, Q being the
    covariance of a step, and each reading adds its own: the recursion of Tichavsky, Muravchik and Nehorai (IEEE Trans.
    Signal Processing 46(5), 1998, eq. 21). Without a step this is the sum.

    turns: (n, r) rad, by which the object's frame turned before each touch; J is in that frame.
    """
    step = np.diag([walk_mm**2, walk_mm**2, walk_rad**2])
    result = np.array(information)
    for touch in range(1, information.shape[1]):
        cos, sin = np.cos(turns[:, touch]), np.sin(turns[:, touch])
        back = np.tile(np.eye(3), (len(turns), 1, 1))
        back[:, 0, 0], back[:, 0, 1], back[:, 1, 0], back[:, 1, 1] = cos, -sin, sin, cos
        before = back.swapaxes(1, 2) @ result[:, touch - 1] @ back
        left = np.linalg.solve(np.eye(3) + before @ step, before)
        result[:, touch] += (left + left.swapaxes(1, 2)) / 2
    return result


def mean_length(variances: FloatArray) -> FloatArray:
    """Compute the mean length (...,) of a Gaussian vector with these variances (..., k) along its principal axes.

    E sqrt(Q) = 1 / (2 sqrt(pi)) int_0^inf (1 - E exp(-t Q)) t^(-3/2) dt, and for a Gaussian E exp(-t Q) is the product
    of (1 + 2 t v)^(-1/2) over the variances v. With t = exp(u) / sum(v) the trapezoid rule is exact to 1e-9.
    """
    total = variances.sum(axis=-1)
    t = np.exp(_LOGS)
    share = variances / total[..., None]
    decay = -0.5 * np.log1p(2 * share[..., None] * t).sum(axis=-2)
    integral = (-np.expm1(decay) / np.sqrt(t)).sum(axis=-1) * (_LOGS[1] - _LOGS[0])
    return np.sqrt(total) * integral / (2 * np.sqrt(np.pi))
