"""Estimate how far each press is off, and the spread of these errors, from linearised readings.

Readings y (n, taxels) are taken as y = J e + D s + noise: e (n, q) the errors of each press, drawn from one normal
distribution with a mean and a variance for each of its groups; s (m,) numbers that all presses share. This is a linear
mixed model. Expectation maximisation finds mean and variances, and generalised least squares finds s (Laird and Ware,
Biometrics 38, 1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray

_EXPECTATIONS = 200
_LEAST_VARIANCE = 1e-8  # of an error, over that of its first guess


@dataclass(frozen=True, eq=False)
class PressErrors:
    """What linearised readings say of the presses.

    errors: (n, q) the mean of each press's errors, given its readings. mean, sd: (q,) of their distribution.
    shared, shared_error: the first of the shared numbers and its standard error. log_likelihood: of the readings
    over all errors that the presses may have, up to a constant of the readings alone.
    """

    errors: FloatArray
    mean: FloatArray
    sd: FloatArray
    shared: float
    shared_error: float
    log_likelihood: float


def press_errors(
    readings: FloatArray,
    slopes: FloatArray,
    variance: float,
    guess: FloatArray,
    groups: Sequence[Sequence[int]],
    shared: FloatArray,
    bounds: tuple[float, float],
) -> PressErrors:
    """Estimate errors and their distribution.

    readings: (n, taxels) y. slopes: (n, taxels, q) J. variance: of the noise. guess: (q,) standard deviations to
    begin with. groups: indices of errors that have one variance. shared: (n, taxels, m) D; the first of s is kept
    within `bounds`.
    """
    scale = slopes * guess  # errors are counted in units of their guess here
    information = np.einsum("nti,ntj->nij", scale, scale) / variance
    told = np.einsum("nti,nt->ni", scale, readings) / variance
    mean, prior = np.zeros(len(guess)), np.ones(len(guess))
    across = np.einsum("nti,ntk->nik", scale, shared) / variance
    own = np.einsum("ntk,ntl->kl", shared, shared) / variance
    seen = np.einsum("ntk,nt->k", shared, readings) / variance
    for _ in range(_EXPECTATIONS):
        covariance = np.linalg.inv(information + np.diag(1 / prior))
        explained = np.einsum("nij,njk->nik", covariance, across)
        of_shared = own - np.einsum("nik,nil->kl", across, explained)
        target = seen - np.einsum("nik,i->k", across, mean)
        target -= np.einsum("nik,ni->k", explained, told - information @ mean)
        s = np.linalg.lstsq(of_shared, target, rcond=None)[0]
        bounded = min(max(s[0], bounds[0]), bounds[1])
        if bounded != s[0]:  # the others have to make up for it
            rest = target[1:] - of_shared[1:, 0] * bounded
            s = np.array([bounded, *np.linalg.lstsq(of_shared[1:, 1:], rest, rcond=None)[0]])
        errors = np.einsum("nij,nj->ni", covariance, told - across @ s + mean / prior)
        mean = errors.mean(axis=0)
        second = ((errors - mean) ** 2 + np.diagonal(covariance, axis1=1, axis2=2)).mean(axis=0)
        for group in groups:
            prior[list(group)] = max(float(second[list(group)].mean()), _LEAST_VARIANCE)
    left = readings - scale @ mean - shared @ s
    pull = np.einsum("nti,nt->ni", scale, left) / variance
    covariance = np.linalg.inv(information + np.diag(1 / prior))
    squares = (left**2).sum() / variance - np.einsum("ni,nij,nj->", pull, covariance, pull)
    determinant = np.linalg.slogdet(np.eye(len(prior)) + information * prior)[1].sum()
    return PressErrors(
        errors=errors * guess,
        mean=mean * guess,
        sd=np.sqrt(prior) * guess,
        shared=float(s[0]),
        shared_error=float(np.sqrt(max(np.linalg.pinv(of_shared)[0, 0], 0))),
        log_likelihood=float(-(squares + determinant) / 2),
    )
