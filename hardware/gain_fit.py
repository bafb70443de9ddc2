"""Gains of single taxels: shrunk to what readings can tell, and judged on presses that they were not fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.press_errors import PressErrors

_PRESSED = 1e-3  # of the median power of a taxel: one that has less is never pressed


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains about their mean, (taxels,), and their spread: the standard deviation of the true ones.

    ratio: how much larger a gain's variance is than if what is left were noise of single readings, at least 1.
    """

    relative: FloatArray
    spread: float
    ratio: float = 1.0


def best_gain(recorded: FloatArray, predicted: FloatArray) -> float:
    """Find the gain with the least squares; predictions that are NaN do not count."""
    return float(np.nansum(recorded * predicted) / max(float(np.nansum(predicted**2)), 1e-12))


def shrunk_gains(recorded: FloatArray, predicted: FloatArray, fold: NDArray[np.intp]) -> Gains:
    """Fit each taxel's gain about the gain of all, by empirical Bayes (Efron and Morris, JASA 70, 1975).

    recorded, predicted: (n, taxels) kPa; a prediction that is NaN does not count. fold: (n,) groups of presses, in
    which what is left unexplained may go together: a gain's variance is that between groups. The spread of the true
    gains is what their variances do not explain (DerSimonian and Laird, Control. Clin. Trials 7, 1986); each gain is
    drawn to their mean by as much. Raises InputError if nothing follows the prediction.
    """
    rested = np.isfinite(predicted)
    recorded, predicted = recorded * rested, np.nan_to_num(predicted)
    common = best_gain(recorded, predicted)
    if not common > 0:
        raise InputError(
            "the recorded readings do not follow the simulated ones at all: are the poses right?"
        )
    power = (predicted**2).sum(axis=0)
    relative = np.ones(recorded.shape[1])  # of a taxel that is never pressed nothing can be said
    pressed = power > _PRESSED * np.median(power)
    if pressed.sum() < 2:
        return Gains(relative, 0.0)
    power = power[pressed]
    own = (recorded * predicted).sum(axis=0)[pressed] / power / common
    score = (predicted * (recorded / common))[:, pressed] - own * predicted[:, pressed] ** 2
    groups = np.unique(fold)
    between = np.zeros(len(own))
    for group in groups:
        between += score[fold == group].sum(axis=0) ** 2
    # Squares of a few groups say little of one taxel, so what makes them larger than noise is taken as one for all.
    naive = np.maximum((score**2).sum(axis=0), 1e-12)
    ratio = max(float((between / naive).mean()) * len(groups) / max(len(groups) - 1, 1), 1.0)
    variance = ratio * naive / power**2
    mean = float(np.average(own, weights=1 / (variance + own.var())))
    weight = 1 / variance
    weighted = float(np.average(own, weights=weight))
    excess = float((weight * (own - weighted) ** 2).sum()) - (len(own) - 1)
    spread2 = max(excess / float(weight.sum() - (weight**2).sum() / weight.sum()), 0.0)
    relative[pressed] = 1 + spread2 / (spread2 + variance) * (own - mean)
    return Gains(relative, float(np.sqrt(spread2)), ratio)


def saved_by_gains(
    recorded: FloatArray, predicted: FloatArray, fold: NDArray[np.intp]
) -> tuple[float, float]:
    """Judge gains of single taxels on readings of presses that they were not fitted to.

    Each group of presses in turn is held out, (n,) `fold`. Returns by which share the gains lower the squares that one
    gain for all taxels leaves of the held-out readings, and its standard error over the groups; infinite for one group.
    """
    saved, whole = [], 0.0
    groups = np.unique(fold)
    if len(groups) < 2:
        return 0.0, np.inf
    for group in groups:
        out = fold == group
        alone = np.ones(recorded.shape[1])
        squares = []
        for relative in (alone, shrunk_gains(recorded[~out], predicted[~out], fold[~out]).relative):
            gain = best_gain(recorded[~out], relative * predicted[~out]) * relative
            squares.append(float(np.nansum((recorded[out] - gain * predicted[out]) ** 2)))
        saved.append(squares[0] - squares[1])
        whole += squares[0]
    error = float(np.std(saved, ddof=1)) * np.sqrt(len(saved))
    whole = max(whole, 1e-300)
    return sum(saved) / whole, error / whole


def with_gains(
    found: PressErrors,
    readings: FloatArray,
    slopes: FloatArray,
    shared: FloatArray,
    variance: float,
    of_gains: FloatArray,
    gains: Gains,
) -> PressErrors:
    """Fit the taxels' gains together with the numbers that presses share, the presses' errors integrated out.

    found, readings, slopes, shared, variance: as in `press_errors`. of_gains: (n, taxels) what a taxel reads for one
    more of its gain. gains: as they are, with their prior. Fitted in turn, gains and the others would take hundreds of
    rounds to agree.
    """
    count = shared.shape[2]
    sd, mean = found.sd, found.mean
    covariance = np.linalg.inv(np.einsum("nti,ntj->nij", slopes, slopes) / variance + np.diag(1 / sd**2))
    off = readings - slopes @ mean
    told = np.einsum("nti,nt->ni", slopes, off) / variance
    across = np.einsum("nti,ntk->nik", slopes, shared) / variance
    across_gains = slopes.transpose(0, 2, 1) * of_gains[:, None] / variance  # (n, q, taxels)
    explained = covariance @ across_gains
    taxels = of_gains.shape[1]
    normal = np.zeros((count + taxels, count + taxels))
    target = np.zeros(count + taxels)
    normal[:count, :count] = found.told[0].sum(axis=0)
    target[:count] = found.told[1].sum(axis=0)
    block = np.einsum("ntk,nt->kt", shared, of_gains) / variance
    normal[:count, count:] = block - np.einsum("nik,nit->kt", across, explained)
    normal[count:, :count] = normal[:count, count:].T
    normal[count:, count:] = np.diag((of_gains**2).sum(axis=0) / variance) - np.einsum(
        "nit,niu->tu", across_gains, explained
    )
    target[count:] = (of_gains * off).sum(axis=0) / variance - np.einsum("nit,ni->t", explained, told)
    prior = gains.ratio / max(gains.spread, 1e-4) ** 2
    normal[count:, count:] += prior * np.eye(taxels)
    target[count:] -= prior * (gains.relative - 1)
    inverse = np.linalg.pinv(normal, hermitian=True)
    both = inverse @ target
    s, by = both[:count], both[count:]
    alone = np.sqrt(np.diagonal(np.linalg.pinv(normal[:count, :count], hermitian=True)))
    wider = np.sqrt(np.maximum(np.diagonal(inverse)[:count], 0)) / np.maximum(alone, 1e-300)
    left = off - shared @ s - of_gains * by
    errors = mean + np.einsum("nij,nj->ni", covariance, np.einsum("nti,nt->ni", slopes, left) / variance)
    return replace(
        found, errors=errors, shared=s, shared_error=found.shared_error * np.maximum(wider, 1), gains=by
    )
