"""How far the simulated pad is from a recorded one, and the sensor's parameters that bring it nearer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

# predict(sigma, errors) gives what the simulated pad would read without imperfections, (n, taxels) kPa. sigma: mm, of
# the point spread. errors: (n, 3) [mm, mm, rad], by which each press is off its stated pose.
Predict = Callable[[float, FloatArray], FloatArray]

NARROWEST, WIDEST = 0.3, 4.0  # mm, of a point spread
_PLACEMENT = np.array([2.0, 2.0, 0.2])  # mm, mm, rad: how far presses may be off, as a prior
_STEP = np.array([0.05, 0.05, 0.01])  # of the differences by which the effect of a placement is found
_ROUNDS = 4
_EXPECTATIONS = 50
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


@dataclass(frozen=True, eq=False)
class SensorFit:
    """The parameters of the sensor model that explain recorded readings best.

    psf_sigma, psf_sigma_error: mm, the point spread and its standard error. gain: recorded over simulated
    pressure, which an error of the force changes too. gain_per_taxel: (taxels,) relative to `gain`;
    gain_spread: their standard deviation. noise: kPa, standard deviation of a reading where nothing
    touches. placement: (n, 3) [mm, mm, rad] in the sensor frame, by how much each press seems to be off;
    offset: (3,) its median; placement_mm, placement_rad: its standard deviation. misfit: kPa, root mean
    square of what is left unexplained.
    """

    psf_sigma: float
    psf_sigma_error: float
    gain: float
    gain_per_taxel: FloatArray
    gain_spread: float
    noise: float
    placement: FloatArray
    offset: FloatArray
    placement_mm: float
    placement_rad: float
    misfit: float


def taxel_error(recorded: FloatArray, predicted: FloatArray) -> TaxelError:
    """Compare readings (n, taxels) kPa with what was predicted for the same presses."""
    difference = recorded - predicted
    touched = ~_untouched(predicted)
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


def fit_sensor(recorded: FloatArray, predict: Predict) -> SensorFit:
    """Fit point spread, gain, noise and placement to readings (n, taxels) kPa.

    Rounds of two least-squares fits: sigma with the best gain, then each press's placement by a
    linearised step. Placements have a normal prior whose spread is itself fitted (expectation
    maximisation), so that what a letter's symmetry leaves open stays where it was. Without them, wrong
    placement would pass for a wider point spread.

    Raises InputError if nothing in the readings follows the prediction.
    """
    errors, relative = np.zeros((len(recorded), 3)), np.ones(recorded.shape[1])
    sigma, spread, prior = 1.0, np.inf, _PLACEMENT

    def scaled(sigma: float, errors: FloatArray) -> FloatArray:
        return relative * predict(sigma, errors)

    for _ in range(_ROUNDS):
        sigma, spread = _fit_sigma(recorded, scaled, errors)
        errors, prior = _step(recorded, scaled, sigma, errors)
        relative = _relative_gains(recorded, predict(sigma, errors))
    predicted = predict(sigma, errors)
    gain = _gain(recorded, relative * predicted)
    left = recorded - gain * relative * predicted
    return SensorFit(
        psf_sigma=sigma,
        psf_sigma_error=spread,
        gain=gain,
        gain_per_taxel=relative,
        gain_spread=float(relative.std(ddof=1)) if len(relative) > 1 else 0.0,
        noise=_noise(left, predicted),
        placement=errors,
        offset=np.median(errors, axis=0),
        placement_mm=float(prior[0]),
        placement_rad=float(prior[2]),
        misfit=float(np.sqrt((left**2).mean())),
    )


def class_agreement(one: ArrayLike, other: ArrayLike, kinds: int) -> tuple[float, NDArray[np.int64]]:
    """Compare two classifications (n, taxels) of the same taxels into classes 0 to kinds - 1.

    Returns the share that agrees and the counts (kinds, kinds), rows for the first.
    """
    pairs = kinds * np.asarray(one, dtype=np.int64).ravel() + np.asarray(other, dtype=np.int64).ravel()
    counts = np.bincount(pairs, minlength=kinds * kinds).reshape(kinds, kinds)
    return float(np.trace(counts) / counts.sum()), counts


def _fit_sigma(recorded: FloatArray, predict: Predict, errors: FloatArray) -> tuple[float, float]:
    """Find the point spread with the least squares at its best gain; returns it and its standard error, mm."""
    from scipy.optimize import minimize_scalar

    def squares(sigma: float) -> float:
        predicted = predict(sigma, errors)
        return float(((recorded - _gain(recorded, predicted) * predicted) ** 2).sum())

    best = minimize_scalar(squares, bounds=(NARROWEST, WIDEST), method="bounded", options={"xatol": 1e-3})
    step = 0.02
    low, high = max(best.x - step, NARROWEST), min(best.x + step, WIDEST)
    curvature = (squares(low) + squares(high) - 2 * best.fun) / step**2
    variance = best.fun / max(recorded.size - 2, 1)
    return float(best.x), float(np.sqrt(2 * variance / curvature)) if curvature > 0 else np.inf


def _step(
    recorded: FloatArray, predict: Predict, sigma: float, errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Improve each press's placement by a Gauss-Newton step; returns it, (n, 3), and the sd of placements, (3,)."""
    predicted = predict(sigma, errors)
    gain = _gain(recorded, predicted)
    residual = recorded - gain * predicted
    slopes = np.empty((*recorded.shape, 3))  # kPa per mm, mm and rad
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = _STEP[axis]
        slopes[..., axis] = (
            gain * (predict(sigma, errors + shift) - predict(sigma, errors - shift)) / (2 * _STEP[axis])
        )
    variance = max(float((residual**2).mean()), 1e-12)
    information = np.einsum("nti,ntj->nij", slopes, slopes) / variance
    # Linearised about `errors`: the readings alone would put a press at the x for which information @ x = told.
    told = np.einsum("nti,nt->ni", slopes, residual) / variance
    told += np.einsum("nij,nj->ni", information, errors)
    prior, middle = _PLACEMENT**2, np.zeros(3)
    for _ in range(_EXPECTATIONS):
        covariance = np.linalg.inv(information + np.diag(1 / prior))
        placed = np.einsum("nij,nj->ni", covariance, told + middle / prior)
        middle = placed.mean(axis=0)
        second = ((placed - middle) ** 2 + np.diagonal(covariance, axis1=1, axis2=2)).mean(axis=0)
        along = second[:2].mean()
        prior = np.maximum([along, along, second[2]], 1e-8)
    return np.clip(placed, -3 * _PLACEMENT, 3 * _PLACEMENT), np.sqrt(prior)


def _relative_gains(recorded: FloatArray, predicted: FloatArray) -> FloatArray:
    """Fit each taxel's gain about their mean, (taxels,). Raises InputError if nothing follows the prediction."""
    power = (predicted**2).sum(axis=0)
    relative = np.ones(recorded.shape[1])  # of a taxel that is never pressed nothing can be said
    pressed = power > 1e-3 * np.median(power)
    gains = (recorded * predicted).sum(axis=0)[pressed] / power[pressed]
    if not gains.mean() > 0:
        raise InputError(
            "the recorded readings do not follow the simulated ones at all: are the poses right?"
        )
    relative[pressed] = gains / gains.mean()
    return relative


def _gain(recorded: FloatArray, predicted: FloatArray) -> float:
    return float((recorded * predicted).sum() / max(float((predicted**2).sum()), 1e-12))


def _noise(left: FloatArray, predicted: FloatArray) -> float:
    """Take the spread of what is `left` at taxels that nothing touches; at all, if all are touched."""
    free = _untouched(predicted)
    values = left[free] if free.sum() >= 10 else left.ravel()
    return float(1.4826 * np.median(np.abs(values - np.median(values))))  # sd of a normal distribution


def _untouched(predicted: FloatArray) -> NDArray[np.bool_]:
    return predicted <= _UNTOUCHED * np.max(predicted, axis=1, keepdims=True, initial=1e-9)
