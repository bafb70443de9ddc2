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
_SILENT = 1e-9  # of the most that readings say of a shared number: they say nothing
_LEAST_VARIANCE = 1e-8  # of an error, over that of its first guess


@dataclass(frozen=True, eq=False)
class PressErrors:
    """What linearised readings say of the presses.

    errors: (n, q) the mean of each press's errors, given its readings. mean, sd: (q,) of their distribution;
    sd_low, sd_high: (q,) the 95 % interval of `sd` by Fisher's information on a variance, 0 where it is open below.
    shared, shared_error: (m,) the shared numbers and their standard errors, which hold also if what is left is no
    white noise (H. White, Econometrica 48, 1980: the sandwich, a press for a cluster); infinite for a number that the
    readings say nothing of. told: (n, m, m) and (n, m), what each press says of the shared numbers: the sum of the
    first times the shared numbers is the sum of the second. log_likelihood: of the readings
    over all errors that the presses may have, up to a constant of the readings alone. gains: (taxels,) by how much the
    taxels' gains are off, if they were fitted along (`tactsim.hardware.taxel_fit.with_gains`).
    """

    errors: FloatArray
    mean: FloatArray
    sd: FloatArray
    sd_low: FloatArray
    sd_high: FloatArray
    shared: FloatArray
    shared_error: FloatArray
    told: tuple[FloatArray, FloatArray]
    log_likelihood: float
    gains: FloatArray | None = None


def press_errors(
    readings: FloatArray,
    slopes: FloatArray,
    variance: float,
    guess: FloatArray,
    groups: Sequence[Sequence[int]],
    shared: FloatArray,
    bounds: tuple[float, float],
    known: tuple[FloatArray, FloatArray] | None = None,
) -> PressErrors:
    """Estimate errors and their distribution.

    readings: (n, taxels) y. slopes: (n, taxels, q) J. variance: of the noise. guess: (q,) standard deviations to
    begin with. groups: indices of errors that have one variance. shared: (n, taxels, m) D; the first of s is kept
    within `bounds`. known: (m,) and (m,), means and precisions of the normal prior of s; none if there is none.
    """
    count, m = len(readings), shared.shape[2]
    expected, precision = (np.zeros(m), np.zeros(m)) if known is None else known
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
        of_shared = own - np.einsum("nik,nil->kl", across, explained) + np.diag(precision)
        target = seen - np.einsum("nik,i->k", across, mean) + precision * expected
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
    explained = np.einsum("nij,njk->nik", covariance, across)
    own_each = np.einsum("ntk,ntl->nkl", shared, shared) / variance
    own_each -= np.einsum("nik,nil->nkl", across, explained)
    own_each += np.diag(precision) / count  # each press has its share of the prior
    off = readings - scale @ mean
    seen_each = np.einsum("ntk,nt->nk", shared, off) / variance
    seen_each -= np.einsum("nik,ni->nk", explained, np.einsum("nti,nt->ni", scale, off) / variance)
    seen_each += precision * expected / count
    unlikely = float((precision * (s - expected) ** 2).sum())
    low, high = _sd_range(information - information @ covariance @ information, prior, groups)
    return PressErrors(
        errors=errors * guess,
        mean=mean * guess,
        sd=np.sqrt(prior) * guess,
        sd_low=low * guess,
        sd_high=high * guess,
        shared=s,
        shared_error=_sandwich(own_each, seen_each, s),
        told=(own_each, seen_each),
        log_likelihood=float(-(squares + determinant + unlikely) / 2),
    )


def _sandwich(own: FloatArray, seen: FloatArray, shared: FloatArray) -> FloatArray:
    """Work out the standard errors of numbers that all presses share, (m,)."""
    whole = own.sum(axis=0)
    if not whole.size:
        return np.zeros(0)
    size = np.sqrt(np.maximum(np.diagonal(whole), 0))
    silent = size <= _SILENT * size.max(initial=0)
    inverse = np.linalg.pinv(whole, hermitian=True)
    scores = seen - own @ shared
    count = len(own)
    between = scores.T @ scores * count / max(count - len(shared), 1)
    error = np.sqrt(np.maximum(np.diagonal(inverse @ between @ inverse), 0))
    plain = np.sqrt(np.maximum(np.diagonal(inverse), 0))  # of a few presses the sandwich says too little
    return np.where(silent, np.inf, np.maximum(error, plain))


def _sd_range(
    marginal: FloatArray, prior: FloatArray, groups: Sequence[Sequence[int]]
) -> tuple[FloatArray, FloatArray]:
    """Bound standard deviations: (q,) and (q,). marginal: (n, q, q) information on the errors, the prior included."""
    low, high = np.zeros(len(prior)), np.full(len(prior), np.inf)
    for group in groups:
        chosen = list(group)
        told = float((marginal[:, chosen][:, :, chosen] ** 2).sum()) / 2
        if told > 0:
            reach = 1.96 / np.sqrt(told)
            low[chosen] = np.sqrt(np.maximum(prior[chosen] - reach, 0))
            high[chosen] = np.sqrt(prior[chosen] + reach)
    return low, high
