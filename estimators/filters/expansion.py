"""Readings expanded about states: log p, its gradient and its information, as a press or a bank of presses predicts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, Reals3D, compiled
from tactsim.core.forward import ForwardModel, Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.modes import sensor_motion

# How often a press is predicted anew, if in place, tilt or load it is off by so many standard deviations more than was
# taken; and at most by so many.
_PRESSES, _OFF, _FARTHEST = 2, 0.7, 3.0

# Predicts the readings of the states `which` (m,), all of the letter of this number.
Predict = Callable[[int, NDArray[np.intp]], Linearised]


def pressed(
    forward: ForwardModel,
    labels: Sequence[str],
    sensor_in_object: FloatArray,
    readings: FloatArray,
    number: NDArray[np.int64],
) -> Predict:
    """Predict readings `number` (n,) of (r, taxels) kPa by presses at sensor_in_object (n, 3).

    A press is predicted as it most probably was: its place, tilt and load are searched for with the pose held
    (Laplace's approximation, by Gauss and Newton).
    """

    def predict(one: int, which: NDArray[np.intp]) -> Linearised:
        label, poses, felt = labels[one], sensor_in_object[which], readings[number[which]]
        found = forward.linearised(label, poses)
        off = np.zeros(found.nuisance.shape[:2])
        for _ in range(_PRESSES):
            likely = likeliest_press(felt, found, forward.noise)
            again = np.flatnonzero(np.abs(likely - off).max(axis=1, initial=0) > _OFF)
            if not len(again):
                break
            off[again] = likely[again].clip(-_FARTHEST, _FARTHEST)
            found = found.with_rows(again, forward.linearised(label, poses[again], off[again]), off[again])
        return found

    return predict


def likeliest_press(readings: FloatArray, found: Linearised, noise: float) -> FloatArray:
    """Find by how many standard deviations n presses most probably were off, (n, q), to first order."""
    q = found.nuisance.shape[1]
    inner = noise**2 * np.eye(q) + found.nuisance @ found.nuisance.swapaxes(1, 2)
    seen = found.nuisance @ (readings - found.mean)[..., None]
    return np.asarray(np.linalg.solve(inner, seen)[..., 0], dtype=float)


def expand(
    letter: NDArray[np.int64],
    state: FloatArray,
    sensor_in_robot: FloatArray,
    readings: FloatArray,
    number: NDArray[np.int64],
    predict: Predict,
    noise: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Expand readings at states T_R^O (n, 3): log p (n,), its gradient (n, 3) and its information (n, 3, 3).

    letter: (n,) numbers. sensor_in_robot: (n, 3), where they were taken. readings: (r, taxels) kPa, of which `number`
    (n,) says the one for each state. noise: kPa, standard deviation of a taxel.
    """
    n = len(letter)
    log_p = np.empty(n)
    gradient, information = np.empty((n, 3)), np.empty((n, 3, 3))
    for one in np.unique(letter).tolist():
        which = np.flatnonzero(letter == one)
        found = predict(one, which)
        log_p[which], gradient[which], information[which] = log_gaussian(
            readings, number[which], found.mean, found.by_pose, found.nuisance, noise
        )
    motion = sensor_motion(state, sensor_in_robot)
    return (
        log_p,
        np.einsum("ni,nij->nj", gradient, motion),
        motion.transpose(0, 2, 1) @ information @ motion,
    )


@compiled()
def log_gaussian(
    reading: Reals2D, which: Ints1D, mean: Reals2D, by_pose: Reals3D, nuisance: Reals3D, noise: float
) -> tuple[Reals1D, Reals2D, Reals3D]:
    """Expand log N(z; mean, noise^2 1 + nuisance.T nuisance) in the pose, to second order, for n predictions.

    reading: (m, taxels) kPa, of which prediction i is compared with number which[i]. mean: (n, taxels), by_pose:
    (n, 3, taxels), nuisance: (n, q, taxels), as in `Linearised`. The inverse of the covariance follows from a
    matrix q by q (Woodbury 1950), and what changes it with the pose is left out (Gauss and Newton).
    Returns log p (n,) at the pose, its gradient (n, 3) and its information (n, 3, 3).
    """
    log_p, gradient = np.empty(len(mean)), np.empty((len(mean), 3))
    information = np.empty((len(mean), 3, 3))
    taxels, q = mean.shape[1], nuisance.shape[1]
    away, mixed = np.empty(taxels), np.empty((4, q))  # nuisance times the three derivatives and the residual
    factor = np.empty((q, q))
    constant = -0.5 * taxels * math.log(2 * math.pi * noise * noise)
    for n in range(len(mean)):
        z = reading[which[n]]
        for t in range(taxels):
            away[t] = (z[t] - mean[n, t]) / noise
        for a in range(q):
            for b in range(a + 1):
                total = 0.0
                for t in range(taxels):
                    total += nuisance[n, a, t] * nuisance[n, b, t]
                factor[a, b] = total / noise**2
            factor[a, a] += 1.0
            for i in range(3):
                total = 0.0
                for t in range(taxels):
                    total += nuisance[n, a, t] * by_pose[n, i, t]
                mixed[i, a] = total / noise**2
            total = 0.0
            for t in range(taxels):
                total += nuisance[n, a, t] * away[t]
            mixed[3, a] = total / noise
        # Cholesky's factor of 1 + nuisance nuisance.T / noise^2, and the mixed products divided by it.
        log_det = 0.0
        for a in range(q):
            for b in range(a + 1):
                total = factor[a, b]
                for k in range(b):
                    total -= factor[a, k] * factor[b, k]
                factor[a, b] = math.sqrt(total) if a == b else total / factor[b, b]
            log_det += math.log(factor[a, a])
            for i in range(4):
                total = mixed[i, a]
                for k in range(a):
                    total -= factor[a, k] * mixed[i, k]
                mixed[i, a] = total / factor[a, a]
        distance = 0.0
        for t in range(taxels):
            distance += away[t] * away[t]
        for a in range(q):
            distance -= mixed[3, a] ** 2
        log_p[n] = constant - log_det - distance / 2
        for i in range(3):
            total = 0.0
            for t in range(taxels):
                total += by_pose[n, i, t] * away[t]
            total /= noise
            for a in range(q):
                total -= mixed[i, a] * mixed[3, a]
            gradient[n, i] = total
            for j in range(i + 1):
                total = 0.0
                for t in range(taxels):
                    total += by_pose[n, i, t] * by_pose[n, j, t]
                total /= noise**2
                for a in range(q):
                    total -= mixed[i, a] * mixed[j, a]
                information[n, i, j] = information[n, j, i] = total
    return log_p, gradient, information
