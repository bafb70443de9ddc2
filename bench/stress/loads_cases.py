"""Loads that vary and responses that are bent: the press, the sensor, what predicts them, and who recognises."""

from __future__ import annotations

import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case
from tactsim.bench.stress.case_data import fitted, hidden, pressed
from tactsim.bench.stress.press_cases import exact_pad, ideal
from tactsim.press import ScanOptions, SensorOptions
from tactsim.press.press_model import PressModel
from tactsim.press.scan_poses import random_poses
from tactsim.press.sensor import sense

SPREADS = (0.1, 0.3, 1.0)  # of the load


@case(
    "loads.response",
    varied="response 0.2 to 5 about a pressure of 1e-3 to 1e6 kPa, readings of 1e-6 to 1e4 kPa",
    deviation="the reading, straightened by the inverse of its curve, from the pressure, relative",
    limit=1e-9,
    because="a power and its inverse, each rounded once",
    quick=True,
)
def response(worst: Worst) -> None:
    """Bend pressures as the sensor does, and straighten them again."""
    pressure = np.geomspace(1e-6, 1e4, 101)[None]
    for exponent in (0.2, 0.5, 1.0, 2.0, 5.0):
        for at in (1e-3, 25.0, 1e6):
            options = SensorOptions(noise=0, resolution=0, response=exponent, response_pressure=at)
            felt = sense(pressure, options, np.ones(101), np.random.default_rng(0))
            worst.see(
                np.abs(at * (felt / at) ** (1 / exponent) / pressure - 1), f"{exponent:g} at {at:g} kPa"
            )


@case(
    "loads.forward-model",
    varied="loads off by -3 to 3 standard deviations of 0.1 to 1, response 0.2 to 5, level and on a rigid wrist",
    deviation="predicted from pressed reading, relative to the largest taxel, where pressed by 1 % of that",
    limit=1e-3,
    because="pressures are in proportion to the load; the models agree to 1e-4, and a root is steep near nothing",
)
def forward_model(worst: Worst) -> None:
    """Predict presses that are off in load alone, and press them."""
    poses = random_poses(np.random.default_rng(0), 12)
    for spread in SPREADS:
        width = np.sqrt(np.log1p(spread**2))
        for exponent in (0.2, 1.0, 5.0):
            sensor = SensorOptions(noise=0, resolution=0, response=exponent)
            press = exact_pad().press
            options = ScanOptions(press=press, sensor=sensor, load_spread=spread, placement_tilt=0.0)
            model = PressModel([models.letter("E")], options)
            for off in (-3.0, 0.0, 3.0):
                away = np.zeros((len(poses), 4))
                away[:, 3] = off
                found = model.linearised("E", poses, away).mean
                pressure = ideal("E", poses, exact_pad(force=2 * float(np.exp(width * off - width**2 / 2))))
                at = sensor.response_pressure
                felt = at * (pressure / at) ** exponent
                clear = pressure > np.maximum(0.01 * pressure.max(axis=1, keepdims=True), 0.1)
                away_by = np.abs(found - felt) / felt.max(axis=1, keepdims=True).clip(1e-9)
                worst.see(away_by[clear], f"{spread:g}, {exponent:g}, {off:g}")


@case(
    "loads.recognised",
    varied="the world handheld: loads by 30 %, tilts of one degree, a bent response",
    deviation="share of 30 trials of 10 readings whose letter is wrong",
    limit=0.1,
    because="one trial in a hundred is wrong; four of thirty are once in four thousand times",
)
def recognised(worst: Worst) -> None:
    """Recognise with the two estimators that are made for it."""
    scan = pressed(world="handheld")
    for name in ("graded", "synthesis"):
        estimator = fitted(name, scan)
        wrong = 0
        for seed in range(6):
            for label in scan.letters:
                readings, poses, _ = hidden(scan, label, 10, seed)
                estimator.reset(np.random.default_rng(0))
                for reading, pose in zip(readings, poses, strict=True):
                    estimator.update(reading, pose)
                wrong += estimator.estimate().label != label
        worst.see(wrong / 30, name)
