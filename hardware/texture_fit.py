"""Find how uneven taxels and contacts are, and how often one is where none should be, from what a fit leaves.

The fit has not seen the patterns whose presses it predicts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from tactsim.core.poses import FloatArray
from tactsim.hardware.taxel_error import untouched

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
