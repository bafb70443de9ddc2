"""How sure an estimator is of the place: covariance, regions that hold a share of its belief, and where the truth lies.

A region is all placements at most so far from the estimated one, in the metric of the placement error, that they
hold a share of the belief. So it respects a letter's symmetry and an O's free angle, and it takes any shape of
belief as it is, weighted poses, without a kernel. Its radius is the error that the estimator itself expects not to
exceed with that probability. An estimator is calibrated if regions of the share a hold the truth in the share a of
trials: the test of Lemos et al. 2023 (expected coverage, with distances to a point) with the estimate as the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactsim.bench.placement_error import Properties, fold_angle, placement_error
from tactsim.bench.placement_kernels import radius
from tactsim.core import invert, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PoseSamples


@dataclass(frozen=True)
class Certainty:
    """How an estimator's belief of the place lies about its estimate.

    credibility: the share of the belief that is nearer to the estimate than the truth is: a region of a larger
    share holds the truth. radius: mm, of the region that holds 90 % of the belief. Both are NaN if the estimator
    does not say how sure it is.
    """

    credibility: float
    radius: float


def certainty(estimate: Estimate, true: ArrayLike, of: Properties) -> Certainty:
    """Compare an estimate's belief with the truth, T_R^O (3,), and the properties of the true letter."""
    if estimate.samples is None:
        return Certainty(np.nan, np.nan)
    weights = estimate.samples.weights
    away = placement_error(estimate.samples.poses, estimate.robot_in_object, of)
    nearer = away < placement_error(true, estimate.robot_in_object, of)
    return Certainty(float(weights[nearer].sum() / weights.sum()), radius(away, weights, 0.9))


def covariance(samples: PoseSamples, estimated: ArrayLike, of: Properties) -> tuple[FloatArray, FloatArray]:
    """Compute mean and covariance of the object's placement, about the estimated pose T_R^O (3,).

    Returns the mean (3,) and the covariance (3, 3) of [x, y, turn]: the centre of mass in the robot's frame, mm, and
    the turn from the estimated angle, rad, folded by the letter's symmetry; of a disc all turns are 0.
    """
    placed, centre = invert(samples.poses), np.array([of.centre])
    turn = fold_angle(placed[:, 2] - invert(np.asarray(estimated, dtype=float))[2], of.symmetry)
    place = np.column_stack([transform(placed, centre)[:, 0, :], turn])
    weights = samples.weights / samples.weights.sum()
    mean = weights @ place
    return mean, (place - mean).T @ ((place - mean) * weights[:, None])
