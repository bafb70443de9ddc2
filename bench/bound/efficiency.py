"""How near a run came to the bound: the Cramer-Rao bound of its own trials, and error over bound."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.bound.cramer_rao import MOST_MM
from tactsim.bench.bound.response import is_quick
from tactsim.bench.bound.scan_information import pressed_letters, scan_bounds, stated_options
from tactsim.bench.config import Slip
from tactsim.bench.score import Scored
from tactsim.bench.trials import Trials
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, invert
from tactsim.core.scan import Scan

ENOUGH = 0.9  # share of the trials that readings must determine for a mean bound to be stated
_STEPS = 3.0  # rms steps of an object, which a few readings that touch nothing leave unknown


def bounds_of_trials(scan: Scan, trials: Trials, explore: str, slip: Slip) -> tuple[FloatArray | None, str]:
    """Bound the mean placement error of trials after each reading, (n, r) mm, by what their readings tell.

    Returns None and why, if nobody knows: the readings do not say how they were pressed, only a slow engine presses
    them (`bench bound` does), they were chosen or pressed on demand, or the object moved otherwise than by a random
    walk.
    """
    if explore != "random":
        return None, "touches pressed on demand" if explore == "blind" else "the estimator chose the readings"
    if slip.still and (trials.true_pose != trials.true_pose[:, :1]).any():
        return None, "the object moved"
    try:
        options = stated_options(scan)
        if not all(is_quick(letter, options) for letter in pressed_letters(scan, options).values()):
            return None, "these letters take long to press; `bench bound` works it out"
        return scan_bounds(scan, trials, slip), ""
    except InputError as error:
        return None, str(error)


def bound_curves(bounds: FloatArray, scored: Scored) -> dict[str, list[float | None]]:
    """Average bounds (n, r) over the trials that are determined by their readings, by reading.

    bound_mm: the mean. determined: the share of such trials. efficiency: the mean error of those whose letter is known
    and right, over the mean bound of the same trials. Before ENOUGH of the trials are determined the bound is the
    prior's, and bound_mm and efficiency are None.
    """
    trials = scored.trials
    counted = stated(bounds, trials)
    named = counted & trials.named
    of_named = (
        np.where(named, scored.error, 0).sum(axis=0),
        np.where(named, bounds, 0).sum(axis=0),
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(counted, bounds, 0).sum(axis=0) / counted.sum(axis=0)
        ratio = of_named[0] / of_named[1]
    return {
        "bound_mm": _where(counted.sum(axis=0) > 0, mean),
        "determined": determined(bounds, trials).mean(axis=0).tolist(),
        "efficiency": _where(named.sum(axis=0) > 0, ratio),
    }


def stated(bounds: FloatArray, trials: Trials) -> NDArray[np.bool_]:
    """Tell which trials a mean bound is of: those that are determined, at readings that determine ENOUGH of them.

    bounds: (n, r) mm, or (n,) at one reading.
    """
    counted = determined(bounds, trials)
    return counted & (counted.mean(axis=0) >= ENOUGH)


def determined(bounds: FloatArray, trials: Trials) -> NDArray[np.bool_]:
    """Tell which trials are determined by their readings, so that the bound is not the prior's."""
    return bounds <= determined_below_mm(trials)


def determined_below_mm(trials: Trials) -> float:
    """Give the bound, mm, from which on a trial counts as determined: larger where objects move in steps."""
    steps = np.diff(invert(trials.true_pose)[..., :2], axis=1)
    return max(MOST_MM, _STEPS * float(np.sqrt((steps**2).sum(axis=-1).mean()))) if steps.size else MOST_MM


def _where(known: NDArray[np.bool_], values: FloatArray) -> list[Any]:
    return [float(value) if of else None for of, value in zip(known, values, strict=True)]
