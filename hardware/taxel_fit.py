"""What a fit leaves of single presses and taxels: how far each is off, gains, how uneven they are, strays.

Readings y (n, taxels) are taken as y = J e + D s + noise: e (n, q) the errors of each press, drawn from one normal
distribution with a mean and a variance for each of its groups; s (m,) numbers that all presses share. This is a linear
mixed model. Expectation maximisation finds mean and variances, and generalised least squares finds s (Laird and Ware,
Biometrics 38, 1982).

Gains are shrunk to what readings can tell, and judged on presses that they were not fitted to. Unevenness and strays
are found from presses that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from tactsim.core.errors import InputError
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

    found, readings, slopes, shared, variance: as in `PressErrors`. of_gains: (n, taxels) what a taxel reads for one
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


_STEPS = 60  # of a Gauss-Hermite quadrature
_MOST_OWN, _MOST_CONTACT = 1.0, 3.0  # the bounds of `sensor.gain_spread` and `sensor.texture`
_LEAST = 1e-9
_CLEAR, _FAINT = 5.0, 0.02  # times the noise; of a press's highest reading


def unevenness(
    recorded: FloatArray, predicted: FloatArray, pattern: NDArray[np.intp], noise: float
) -> tuple[float, float]:
    """Split what is left of readings into the spread of the taxels' own gains and the texture of each contact.

    recorded, predicted: (n, taxels) in one unit; predictions by a fit to the other patterns. pattern: (n,) of each
    press. noise: standard deviation of a reading, in that unit. Presses count alike, whatever their load is.

    With factors f = max(0, g + t) on what is predicted, where g = max(0, 1 + own z) is the taxel's in all presses and t
    = contact z' each press's, the squares left are the relative variance of f, and the products of what is left at a
    taxel of two different patterns its covariance (variance components: Searle, Casella, McCulloch, 1992). Returns
    `own` and `contact` with these two moments; 0 for one pattern's own, which nothing tells from the contact's.
    """
    predicted = np.maximum(np.nan_to_num(predicted), 0)
    seen = (predicted > 0).any(axis=1) & ((recorded * predicted).sum(axis=1) > 0)
    if not seen.any():
        return 0.0, 0.0
    recorded, predicted, pattern = recorded[seen], predicted[seen], pattern[seen]
    predicted = predicted * ((recorded * predicted).sum(axis=1) / (predicted**2).sum(axis=1))[:, None]
    size = np.sqrt((predicted**2).sum(axis=1, keepdims=True))
    left, image = (recorded - predicted) / size, predicted / size
    squares = left**2 - (noise / size) ** 2
    variance = max(float(squares.sum()) / len(left), 0.0)
    shared = 0.0
    if len(np.unique(pattern)) > 1:
        of_left, of_image = (
            np.stack([values[pattern == number].sum(axis=0) for number in np.unique(pattern)])
            for values in (left, image)
        )
        products, overlap = (
            float((each.sum(axis=0) ** 2 - (each**2).sum(axis=0)).sum()) for each in (of_left, of_image)
        )
        shared = min(max(products / max(overlap, _LEAST), 0.0), variance)
    start = np.sqrt([shared, variance - shared])
    most = _MOST_OWN, _MOST_CONTACT
    solved = least_squares(
        lambda spreads: np.array(moments(*spreads)) - (variance, shared),
        np.clip(start, 1e-3, most), bounds=((0, 0), most),
    )  # fmt: skip
    own, contact = solved.x.tolist()
    return float(own), float(contact)


def stray_contacts(recorded: FloatArray, predicted: FloatArray, noise: float) -> float:
    """Give the share of the taxels that read a contact where none is predicted, in (n, taxels) readings.

    A contact reads more than noise, a standard deviation, and more than 2 % of its press's highest reading.
    """
    predicted = np.nan_to_num(predicted)
    nowhere = untouched(predicted) & (predicted.max(axis=1, keepdims=True) > 0)
    reads = recorded > np.maximum(_CLEAR * noise, _FAINT * recorded.max(axis=1, keepdims=True))
    return float(reads[nowhere].mean()) if nowhere.any() else 0.0


def moments(own: float, contact: float) -> tuple[float, float]:
    """Give the relative variance of `unevenness`'s factors, and the covariance of those of a taxel in two presses."""
    at, weight = np.polynomial.hermite_e.hermegauss(_STEPS)
    weight = weight / weight.sum()
    gain = np.maximum(1 + own * at, 0)
    spread = max(contact, _LEAST)
    above, density = ndtr(gain / spread), np.exp(-((gain / spread) ** 2) / 2) / np.sqrt(2 * np.pi)
    first = gain * above + spread * density
    second = (gain**2 + spread**2) * above + gain * spread * density
    mean = float(weight @ first)
    return float(weight @ second) / mean**2 - 1, float(weight @ first**2) / mean**2 - 1


_UNTOUCHED = 0.02  # share of a reading's largest predicted pressure below which a taxel is untouched


@dataclass(frozen=True, eq=False)
class TaxelError:
    """How far recorded readings are from predicted ones, over all taxels.

    rms, bias: kPa. relative: rms over the mean pressure of touched taxels. correlation: Pearson's.
    per_taxel: (taxels,) rms, kPa. per_press: (n,) rms, kPa.
    """

    rms: float
    bias: float
    relative: float
    correlation: float
    per_taxel: FloatArray
    per_press: FloatArray


def taxel_error(recorded: FloatArray, predicted: FloatArray) -> TaxelError:
    """Compare readings (n, taxels) kPa with what was predicted for the same presses."""
    difference = recorded - predicted
    touched = ~untouched(predicted)
    rms = float(np.sqrt((difference**2).mean()))
    typical = float(predicted[touched].mean()) if touched.any() else np.nan
    varies = recorded.std() > 0 and predicted.std() > 0
    return TaxelError(
        rms=rms,
        bias=float(difference.mean()),
        relative=rms / typical,
        correlation=float(np.corrcoef(recorded.ravel(), predicted.ravel())[0, 1]) if varies else np.nan,
        per_taxel=np.sqrt((difference**2).mean(axis=0)),
        per_press=np.sqrt((difference**2).mean(axis=1)),
    )


def untouched(predicted: FloatArray) -> NDArray[np.bool_]:
    """Tell which taxels of predicted readings (n, taxels) nothing touches."""
    return predicted <= _UNTOUCHED * np.max(predicted, axis=1, keepdims=True, initial=1e-9)
