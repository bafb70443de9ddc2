"""Predict recorded presses by a fit that has not seen them: what the fit is worth for the next press."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.hardware.gain_fit import best_gain, shrunk_gains
from tactsim.hardware.guessed_press import State
from tactsim.hardware.press_fit import PressFit, shape


def held_out(fit: PressFit, state: State) -> tuple[FloatArray, FloatArray]:
    """Predict readings (n, taxels), each of the fit's groups of presses by the numbers that fit the others best.

    Gains of taxels, and all numbers that presses share, are fitted to the other groups, linearised about the whole fit.
    First each press is where it is stated, but for the mean by which the others are off; then it is where its own
    reading puts it.
    """
    leans, yields = shape(state)
    predicted, _, gain, variance = fit.residual(state)
    predicted = np.nan_to_num(predicted)
    round_ = fit.linearised(state, variance, leans=leans or yields)
    found = round_.found(leans, yields)
    count = len(found.sd)
    slopes = round_.slopes[..., :count]
    common = round_.common if yields else round_.common[..., 1:]
    start = np.zeros(common.shape[2])
    start[0] = state.give if yields else 0.0
    information = np.einsum("nti,ntj->nij", slopes, slopes) / variance + np.diag(1 / found.sd**2)
    apart, placed = np.empty_like(fit.recorded), np.empty_like(fit.recorded)
    own, seen = found.told
    for group in np.unique(fit.fold):
        out = fit.fold == group
        others = ~out if not out.all() else out
        shared = np.linalg.lstsq(own[others].sum(axis=0), seen[others].sum(axis=0), rcond=None)[0]
        mean = found.errors[others].mean(axis=0)
        relative = np.ones(fit.recorded.shape[1])
        if state.gains is not None:
            relative = shrunk_gains(fit.recorded[others], predicted[others], fit.fold[others]).relative
        gain = best_gain(fit.recorded[others], relative * predicted[others]) * relative
        moved = common[out] @ (shared - start)
        off = round_.about[out] - common[out] @ shared
        told = np.einsum("nti,nt->ni", slopes[out], off) / variance + mean / found.sd**2
        errors = np.linalg.solve(information[out], told[..., None])[..., 0]
        step = np.einsum("nti,ni->nt", slopes[out], errors - state.errors[out, :count])
        placed[out] = gain * predicted[out] + moved + step
        stated = np.zeros_like(state.errors)
        stated[:, :count] = mean
        apart[out] = gain * np.nan_to_num(fit.read(state, errors=stated)[out]) + moved
    return apart, placed
