"""The sensor's imperfections: gain, hysteresis, drift, noise, random and dead taxels, saturation, resolution."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.press.scan_options import ScanOptions, SensorOptions


def sense(
    ideal: FloatArray, options: SensorOptions, gain: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Turn a sequence of ideal readings into what the pad reports: (readings, taxels) kPa.

    ideal: (readings, taxels) kPa, in the order in which they are taken. gain: (taxels,), of `gains`.
    The order of the effects is that of docs/sensor.md. As many random numbers are drawn whichever effects
    are off, so switching one off changes nothing else. Readings may be below zero, as a tared sensor's are.
    """
    noise = rng.standard_normal(ideal.shape)
    replaced, level = rng.random(ideal.shape), rng.random(ideal.shape)
    readings = ideal * gain
    if options.hysteresis:
        for before, now in pairwise(readings):
            now += options.hysteresis * (before - now)
    readings = readings + options.drift * np.arange(1, len(readings) + 1)[:, None] + options.noise * noise
    if options.random_taxels:
        # Uniform between 0 and 0.6 of the largest reading, so that eq. 3 calls half of them In Contact.
        largest = np.maximum(readings.max(axis=1, keepdims=True), 0)
        readings = np.where(replaced < options.random_taxels, 0.6 * largest * level, readings)
    if options.saturation is not None:
        readings = np.minimum(readings, options.saturation)
    if options.resolution:
        readings = np.round(readings / options.resolution) * options.resolution
    readings[:, list(options.dead_taxels)] = 0.0
    return readings


def gains(options: ScanOptions) -> FloatArray:
    """Draw the taxels' gains, (taxels,), normal about 1 and not below 0: the same pad for the same seed."""
    rng = stream(options.seed, "pad", "gain")
    return np.maximum(1 + options.sensor.gain_spread * rng.standard_normal(options.pad.taxels), 0)
