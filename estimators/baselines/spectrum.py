"""A baseline for whole presses: the amplitude spectrum of a reading, and a linear classifier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import Scan
from tactsim.core.idle import find_idle
from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray
from tactsim.estimators.baselines.reading_classifier import ReadingClassifier
from tactsim.estimators.estimator import Options, check_order
from tactsim.estimators.likelihoods.folds import FOLDS

_RADII, _ANGLES, _HARMONICS = 24, 36, 6
_FLOOR = 1e-3  # of the mean sum of a reading: amplitudes below count as that
# The probability that a reading says nothing of the letter, whatever the classifier makes of it.
_OUTLIER = 0.01
# Between these the temperature is sought.
_COLDEST, _HOTTEST = 0.2, 20.0


class SpectrumOptions(Options):
    """What the classifier takes."""

    penalty: float = Field(
        1e-3, gt=0, le=1e3, description="on the squared weights of the classifier, beside the mean log-loss"
    )


class Spectrum(ReadingClassifier):
    """Name the letter of each reading by its spectrum, and multiply the probabilities (naive Bayes).

    The amplitude of a reading's Fourier transform does not change where the object is shifted, and turns where it is
    turned. So it is taken at radii from one to a period of two taxels, all the way around, and of each radius the
    amplitudes of the harmonics over the angle, which do not change where the object is turned (cf. the Fourier-Mellin
    transform, Reddy and Chatterji 1996). It is evaluated at the taxels' places, so a pad may have any shape. The
    logarithms of these features, of zero mean and unit variance, go to a multinomial logistic regression. Its
    temperature (Guo et al. 2017) is learned from left-out presses.

    A press must hold all of an object: windows of it have spectra of their own.
    """

    options_type = SpectrumOptions
    options: SpectrumOptions

    def fit(self, scan: Scan) -> None:
        """Learn the classifier from the training readings, and its temperature from those of left-out presses."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels, self.taxels = train.letters, train.readings.shape[1]
        self._idle = find_idle(train.readings, train.presses)
        self._waves = _waves(train.taxel_xy)
        self._floor = _FLOOR * float(np.abs(self._idle.rise(train.readings)).sum(axis=1).mean()) or 1.0
        features = self._features(train.readings)
        self._mean, self._spread = features.mean(axis=0), features.std(axis=0)
        self._spread[self._spread == 0] = 1.0
        features = (features - self._mean) / self._spread
        letter = np.array([self.labels.index(label) for label in train.labels.tolist()])
        self._weights = self._classifier(features, letter)
        self.temperature = self._learn_temperature(features, letter, train)

    def _features(self, readings: FloatArray) -> FloatArray:
        """Give log features of readings (n, taxels): (n, 1 + radii * harmonics)."""
        rise = self._idle.rise(readings)
        amplitude = np.abs(rise @ self._waves).reshape(len(rise), _RADII, _ANGLES)
        harmonics = np.abs(np.fft.rfft(amplitude, axis=2))[:, :, :_HARMONICS].reshape(len(rise), -1) / _ANGLES
        total = np.abs(rise.sum(axis=1, keepdims=True))
        return np.log(np.concatenate([total, harmonics], axis=1) + self._floor)

    def _classifier(self, features: FloatArray, letter: NDArray[np.int64]) -> FloatArray:
        """Fit a multinomial logistic regression: weights (features + 1, letters), the last row constants."""
        from scipy.optimize import minimize  # imported here: only a fit needs it

        (count, width), letters = features.shape, len(self.labels)
        wanted = np.eye(letters)[letter]

        def loss(flat: FloatArray) -> tuple[float, FloatArray]:
            weights = flat.reshape(width + 1, letters)
            log_p = _log_softmax(features @ weights[:-1] + weights[-1])
            off = (np.exp(log_p) - wanted) / count
            slope = np.vstack([features.T @ off + self.options.penalty * weights[:-1], off.sum(axis=0)])
            size = float((weights[:-1] ** 2).sum())
            return -float((wanted * log_p).sum()) / count + self.options.penalty * size / 2, slope.ravel()

        found = minimize(loss, np.zeros((width + 1) * letters), jac=True, method="L-BFGS-B")
        return np.asarray(found.x).reshape(width + 1, letters)

    def _learn_temperature(self, features: FloatArray, letter: NDArray[np.int64], train: Scan) -> float:
        """Find the power of the probabilities that foretells left-out presses best; 1 if there are too few."""
        from scipy.optimize import minimize_scalar

        press = np.arange(len(train)) if train.presses is None else train.presses
        part = np.empty(len(train), dtype=np.intp)
        for number in range(len(self.labels)):
            own = letter == number
            part[own] = np.unique(press[own], return_inverse=True)[1].reshape(-1) % FOLDS
        if len(self.labels) == 1 or any(len(np.unique(part[letter == k])) < FOLDS for k in letter):
            return 1.0
        log_p = np.empty((len(train), len(self.labels)))
        for number in range(FOLDS):
            gone = part == number
            weights = self._classifier(features[~gone], letter[~gone])
            log_p[gone] = features[gone] @ weights[:-1] + weights[-1]

        def surprise(log_temperature: float) -> float:
            scaled = _log_softmax(log_p / np.exp(log_temperature))
            return -float(_with_outliers(scaled)[np.arange(len(letter)), letter].mean())

        bounds = np.log([_COLDEST, _HOTTEST])
        return float(np.exp(minimize_scalar(surprise, bounds=bounds, method="bounded").x))

    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        features = (self._features(reading[None]) - self._mean) / self._spread
        scores = (features @ self._weights[:-1] + self._weights[-1]) / self.temperature
        self._evaluated += 1
        return _with_outliers(_log_softmax(scores))[0]


def _waves(taxel_xy: FloatArray) -> NDArray[np.complex128]:
    """Give the waves exp(-i k x) at the taxels: (taxels, radii * angles), from one period a pad to two taxels'."""
    xy = taxel_xy - (taxel_xy.min(axis=0) + taxel_xy.max(axis=0)) / 2
    apart = pitch(taxel_xy) or 1.0  # mm; a single taxel feels all waves alike
    widest = float(np.hypot(*np.ptp(xy, axis=0))) + apart
    radius = 2 * np.pi * np.geomspace(1 / widest, 0.5 / apart, _RADII)
    angle = np.arange(_ANGLES) * np.pi / _ANGLES  # the other half has the same amplitudes
    wave = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.exp(-1j * (xy @ wave.reshape(-1, 2).T))


def _log_softmax(scores: FloatArray) -> FloatArray:
    return np.asarray(scores - np.logaddexp.reduce(scores, axis=-1, keepdims=True))


def _with_outliers(log_p: FloatArray) -> FloatArray:
    """Mix log-probabilities (n, letters) with those of a reading that says nothing."""
    return np.log((1 - _OUTLIER) * np.exp(log_p) + _OUTLIER / log_p.shape[-1])
