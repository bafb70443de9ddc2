"""The sensor's imperfections: hysteresis, gain, response, lag, ghosting, drift, noise, broken taxels, saturation."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.matrix import mixed, of_uniform, unmixed
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.press.scan_options import ScanOptions, SensorOptions


class Chance(NamedTuple):
    """What is drawn for readings, each (..., taxels): whatever is switched off, as many numbers are drawn.

    noise: normal. replaced, level: uniform, whether a taxel reads something random, and how much of the largest.
    """

    noise: FloatArray
    replaced: FloatArray
    level: FloatArray

    @classmethod
    def draw(cls, shape: tuple[int, ...], rng: np.random.Generator) -> Chance:
        """Draw for readings (..., taxels)."""
        return cls(rng.standard_normal(shape), rng.random(shape), rng.random(shape))


def sense(
    ideal: FloatArray,
    options: SensorOptions,
    gain: FloatArray,
    rng: np.random.Generator,
    *,
    rows: int | None = None,
    one_touch: bool = False,
) -> FloatArray:
    """Turn a sequence of ideal readings into what the pad reports: (readings, taxels) kPa.

    ideal: (readings, taxels) kPa, in the order in which they are taken. gain: (taxels,), of `gains`.
    rows: of the pad, which only ghosting needs to know.
    one_touch: whether they are the images of one touch, which have hysteresis, instead of one reading of
    each touch after another, between which there is lag.
    The order of the effects is that of docs/sensor.md. As many random numbers are drawn whichever effects
    are off, so switching one off changes nothing else. Readings may be below zero, as a tared sensor's are.
    """
    chance = Chance.draw(ideal.shape, rng)
    gain = textured(gain, options, 1 if one_touch else len(ideal), rng)
    felt = answered(hysteretic(ideal, options.hysteresis) if one_touch else ideal, options, gain)
    if options.lag and not one_touch:
        for before, now in pairwise(felt):
            now += options.lag * (before - now)
    return reported(felt, np.arange(1, len(felt) + 1), options, chance, rows)


def textured(gain: FloatArray, options: SensorOptions, presses: int, rng: np.random.Generator) -> FloatArray:
    """Add to the taxels' gains (taxels,) what the contact of each press does: (presses, taxels), or the same if even.

    A pad and an object are not flat: where their unevenness adds up to a gap nothing is felt, so none is below 0. It is
    drawn after all else, and only where there is a texture.
    """
    if not options.texture:
        return gain
    return np.maximum(gain + options.texture * rng.standard_normal((presses, len(gain))), 0)


def answered(ideal: FloatArray, options: SensorOptions, gain: FloatArray) -> FloatArray:
    """Apply the taxels' gains, (taxels,) or (n, taxels), and their response curve to ideal readings (n, taxels) kPa."""
    readings = gain * ideal
    if options.response != 1:
        at = options.response_pressure
        readings = at * (np.maximum(readings, 0) / at) ** options.response
    return readings


def reported(
    felt: FloatArray,
    number: NDArray[np.intp],
    options: SensorOptions,
    chance: Chance,
    rows: int | None = None,
) -> FloatArray:
    """Turn what the taxels feel, lag included, into what the pad reports: (n, taxels) kPa.

    number: (n,) which reading of its sequence each one is, from 1: the zero drifts from one to the next. rows: of the
    pad. Raises ValueError if there is ghosting and they are not given.
    """
    if options.ghosting == "floating":
        felt = _ghosted(felt, options.leakage, rows)
    readings = felt + options.drift * number[:, None] + options.noise * chance.noise
    if options.random_taxels:
        # Uniform between 0 and 0.6 of the largest reading, so that eq. 3 calls half of them In Contact.
        largest = np.maximum(readings.max(axis=1, keepdims=True), 0)
        readings = np.where(chance.replaced < options.random_taxels, 0.6 * largest * chance.level, readings)
    if options.saturation is not None:
        readings = np.minimum(readings, options.saturation)
    if options.resolution:
        readings = np.round(readings / options.resolution) * options.resolution
    if options.ghosting == "floating" and options.unmix:
        readings = _without_ghosts(readings, options.leakage, rows)
    readings[:, list(options.dead_taxels)] = 0.0
    return readings


def _ghosted(felt: FloatArray, leakage: float, rows: int | None) -> FloatArray:
    """Read what taxels feel (n, taxels) kPa as a matrix without guards does, above what it reads at rest."""
    cells = _as_matrix(np.maximum(felt, 0) + leakage, rows)
    return mixed(cells).reshape(felt.shape) - of_uniform(leakage, *cells.shape[1:])


def _without_ghosts(readings: FloatArray, leakage: float, rows: int | None) -> FloatArray:
    """Undo `_ghosted`, as the driver of such a pad does: (n, taxels) kPa, none below 0."""
    cells = _as_matrix(readings, rows)
    cells = cells + of_uniform(leakage, *cells.shape[1:])
    return unmixed(cells, leakage).reshape(readings.shape) - leakage


def _as_matrix(values: FloatArray, rows: int | None) -> FloatArray:
    if rows is None:
        raise ValueError("a pad with ghosting needs its number of rows")
    return values.reshape(len(values), rows, -1)


def hysteretic(images: FloatArray, share: float) -> FloatArray:
    """Let the images of one touch depend on how they came about: (images, taxels) kPa.

    images: (images, taxels) kPa, from before the touch on. share: `SensorOptions.hysteresis`.

    Preisach's model (I. D. Mayergoyz, Mathematical Models of Hysteresis, 1991) with Everett's function
    E(a, b) = (b - a) (1 - 4 share a / b): a load that has only risen is read as it is; one that falls from
    b to a is read as b - E(a, b), at most share * b too high (at half the load) and right again at 0. A small
    loop within closes, and is forgotten when the load leaves it.
    """
    if not share:
        return images
    result = images.copy()
    for taxel in np.flatnonzero((np.diff(images, axis=0) < 0).any(axis=0)):
        turns = [
            0.0
        ]  # loads where the course turned and what has not been wiped out: low, high, low, ..., now
        for index, load in enumerate(images[:, taxel].tolist()):
            _follow(turns, max(load, 0.0))
            result[index, taxel] = sum(
                (high - low) * (1 - 4 * share * low / high) * (1 if after > before else -1)
                for before, after in pairwise(turns)
                for low, high in [sorted((before, after))]
            )
    return result


def _follow(turns: list[float], load: float) -> None:
    """Go on to `load`, and forget the turns of the loops that close on the way."""
    rising = len(turns) % 2 == 0
    if (load >= turns[-1]) == rising or load == turns[-1]:
        turns[-1] = load
    else:
        turns.append(load)
    while len(turns) > 2:
        rising = len(turns) % 2 == 0
        if not (load >= turns[-3] if rising else load <= turns[-3]):
            break
        del turns[-3:-1]


def gains(options: ScanOptions) -> FloatArray:
    """Draw the taxels' gains, (taxels,), normal about 1 and not below 0: the same pad for the same seed."""
    rng = stream(options.seed, "pad", "gain")
    return np.maximum(1 + options.sensor.gain_spread * rng.standard_normal(options.pad.taxels), 0)
