"""What a fit leaves of single taxels: gains, how uneven they and contacts are, strays, how far readings are off.

Gains are shrunk to what readings can tell, and judged on presses that they were not fitted to. Unevenness and strays
are found from presses that the fit has not seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

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
