"""What stands in for a hand on an emulated pad: presses by the physics, with the noise of every frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactsim import models
from tactsim.core import InputError
from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray, compose
from tactsim.hardware.device import Device
from tactsim.press import ScanOptions
from tactsim.press.pressing import ideal_readings
from tactsim.press.sensor import gains, sense


def press_table(label: str, poses: FloatArray, options: ScanOptions, rng: np.random.Generator) -> FloatArray:
    """Press a letter at `poses` (n, 3) sensor_in_object, each a little off as options say: (n, taxels) kPa."""
    error = rng.standard_normal((len(poses), 3))
    error *= (options.placement_mm, options.placement_mm, options.placement_rad)
    return ideal_readings(models.letter(label), compose(poses, error), options)[0]


def sensing(
    pressures: Callable[[float], FloatArray], options: ScanOptions, rng: np.random.Generator
) -> Callable[[float], FloatArray]:
    """Let the taxels' gains, noise and faults change what presses on the pad, anew at each call.

    The device's own steps come with its codec, so the sensor's resolution is left out.
    """
    sensor = options.sensor.model_copy(update={"resolution": 0.0, "drift": 0.0, "hysteresis": 0.0})
    gain = gains(options)
    return lambda now: sense(pressures(now)[None], sensor, gain, rng)[0]


def parse_pose(text: str) -> FloatArray:
    """Read a pose written as `x,y,theta` in mm and rad. Raises InputError."""
    try:
        pose = np.array([float(word) for word in text.split(",")])
    except ValueError:
        pose = np.zeros(0)
    if pose.shape != (3,) or not (np.abs(pose) <= LARGEST).all():
        raise InputError(f"a pose is written x,y,theta in mm and rad, like 3.4,-3.4,0.52, not {text!r}")
    return pose


def scan_options_for(device: Device, options: ScanOptions) -> ScanOptions:
    """Press on the device's pad instead of the options' own."""
    return options.model_copy(update={"pad": device.pad})
