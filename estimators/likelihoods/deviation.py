"""The error model of relative pressures: how far they are from what a mosaic predicts.

The error is Gaussian for most taxels. A few stray taxels may feel anything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray

_ROUNDS = 20
# Of the taxels; even if none was seen, one may come.
_LEAST_STRAY = 0.01


@dataclass(frozen=True, eq=False)
class Deviation:
    """p(relative pressure | prediction) at `levels` (k,) in equal steps, between them linear in logs.

    p is a mixture: with the share `stray` it is `background` (k,), the density of all pressures, else a Gaussian
    about the prediction. variance: (4,) the Gaussian's variance is their sum, each times its own factor: 1 / scale^2
    (the sensor's noise, kPa^2), 1 (what is always there), the squared slope (the press's place, mm^2) and the
    squared prediction (the scale).
    """

    variance: FloatArray
    stray: float
    levels: FloatArray
    background: FloatArray

    def log_density(self, predicted: FloatArray, slope: FloatArray, scale: float) -> FloatArray:
        """Compute log p at every level, for predictions and squared slopes (...): (k, ...).

        It is normalised: p, linear in logs between the levels, integrates to 1.
        """
        column = (-1, *[1] * np.ndim(predicted))
        spread = _spread(_sources(predicted, slope, scale) @ self.variance, self.levels)
        p = _normal(self.levels.reshape(column) - predicted, spread)
        p *= 1 - self.stray
        p += self.stray * self.background.reshape(column)
        log_p = np.log(p)
        log_p -= np.log(integral(p, log_p, self.levels))
        return log_p


def learn_deviation(
    relative: FloatArray, predicted: FloatArray, slope: FloatArray, scale: FloatArray, levels: FloatArray
) -> Deviation:
    """Learn the mixture from taxels, all arrays of one shape, by expectation maximisation.

    The four parts of the variance come from a regression of the squared deviations, in which none is negative. Each
    taxel is weighted with its own variance (iteratively reweighted least squares).
    """
    step = levels[1] - levels[0]
    place = np.rint((relative.ravel() - levels[0]) / step).clip(0, len(levels) - 1).astype(np.intp)
    count = np.bincount(place, minlength=len(levels)) + 1.0
    background = count / (count.sum() * step)
    away = (relative - predicted).ravel()
    sources = _sources(predicted, slope, scale).reshape(-1, 4)
    spread, regular, stray = np.full(len(away), 1.0), np.ones(len(away)), 0.0
    for _ in range(_ROUNDS):
        weight = np.sqrt(regular) / spread
        variance = non_negative(sources * weight[:, None], away**2 * weight)
        spread = _spread(sources @ variance, levels)
        stray = max(float(1 - regular.mean()), _LEAST_STRAY)
        gaussian = (1 - stray) * _normal(away, spread)
        regular = gaussian / (gaussian + stray * background[place])
    return Deviation(variance, stray, levels, background)


def non_negative(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Find the factors (n,) from 0 of columns (m, n) whose sum is nearest to `wanted` (m,), in least squares.

    Columns may be of very different size (Lawson and Hanson 1974, `scipy.optimize.nnls`).
    """
    from scipy.optimize import nnls  # here, because its import takes 0.17 s

    # The same least squares with n + 1 rows, however many there are.
    triangle = np.asarray(np.linalg.qr(np.column_stack([columns, wanted]), mode="r"))
    columns, wanted = triangle[:, :-1], triangle[:, -1]
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    return np.asarray(nnls(columns / size, wanted)[0] / size, dtype=float)


def integral(p: FloatArray, log_p: FloatArray, levels: FloatArray) -> FloatArray:
    """Integrate a function p (k, ...) whose logs are linear between levels (k,) in equal steps: (...).

    Between two levels its mean is their logarithmic mean, or that mean's series where the two are nearly equal.
    """
    rise, mean = np.diff(log_p, axis=0), np.diff(p, axis=0)
    flat = np.flatnonzero(np.abs(rise) < 1e-3)
    series = (p[1:].take(flat) + p[:-1].take(flat)) * (0.5 - rise.take(flat) ** 2 / 24)
    rise.put(flat, 1.0)
    mean /= rise
    mean.put(flat, series)
    return np.asarray((levels[1] - levels[0]) * mean.sum(axis=0), dtype=float)


def _sources(predicted: FloatArray, slope: FloatArray, scale: FloatArray | float) -> FloatArray:
    """List what a variance comes from: (..., 4)."""
    return np.stack(np.broadcast_arrays(1 / np.square(scale), 1.0, slope, predicted**2), axis=-1)


def _spread(variance: FloatArray, levels: FloatArray) -> FloatArray:
    """Keep a variance above what falls between two levels unseen."""
    return np.maximum(variance, ((levels[1] - levels[0]) / 4) ** 2)


def _normal(away: FloatArray, variance: FloatArray) -> FloatArray:
    """Give the density of a Gaussian at a distance from its mean."""
    density: FloatArray = away**2
    density /= -2 * variance
    np.exp(density, out=density)
    density /= np.sqrt(2 * np.pi * variance)
    return density
