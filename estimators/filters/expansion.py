"""Readings expanded about states: log p, its gradient and its information, as a press or a bank of presses predicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tactsim.core.forward import ForwardModel, Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.modes import sensor_motion
from tactsim.estimators.likelihoods.gaussian_kernels import log_gaussian

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
    log_p, misfit = np.empty(n), np.empty(n)
    gradient, information = np.empty((n, 3)), np.empty((n, 3, 3))
    for one in np.unique(letter).tolist():
        which = np.flatnonzero(letter == one)
        m, found = len(which), predict(one, which)
        own = np.empty(m), np.empty(m), np.empty((m, 3)), np.empty((m, 3, 3))
        log_gaussian(readings, number[which], found.mean, found.by_pose, found.nuisance, noise, *own)
        for array, values in zip((log_p, misfit, gradient, information), own, strict=True):
            array[which] = values
    motion = sensor_motion(state, sensor_in_robot)
    return (
        log_p,
        np.einsum("ni,nij->nj", gradient, motion),
        motion.transpose(0, 2, 1) @ information @ motion,
    )
