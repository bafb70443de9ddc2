"""Press one letter at one pose: what an ideal pad would read, and what this pad reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim import models
from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.press.dynamics import ForceTrace
from tactsim.press.engine import ideal_readings, ideal_sequence
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import gains, hysteretic, sense
from tactsim.press.touches import Touches


@dataclass(frozen=True, eq=False)
class Press:
    """What one press gives.

    ideal: (taxels,) kPa without imperfections. reading: (taxels,) kPa, what the pad reports. With full
    dynamics `sequence` (frames, taxels) kPa holds the images of the press, without imperfections, taken
    at `times` (frames,) s; the last is `ideal`. `trace` is the contact force at every time step.
    """

    ideal: FloatArray
    reading: FloatArray
    times: FloatArray | None = None
    sequence: FloatArray | None = None
    trace: ForceTrace | None = None

    @property
    def settle_time(self) -> float | None:
        """Give the time from touch until the force stays within 2 % of the set force, s; None at rest."""
        return None if self.trace is None else self.trace.settle_time


def press_letter(
    letter: models.Letter,
    sensor_in_object: ArrayLike,
    options: ScanOptions | None = None,
    rng: np.random.Generator | None = None,
    rotation: ArrayLike | None = None,
) -> Press:
    """Press `letter` at one pose [x, y, theta] (mm, rad), exactly there, tilted as the options' press is.

    Of `options` only pad, press, sensor and, for the pad's gains, seed count. `rng` draws noise and random
    taxels; without it there are none. rotation: (3, 3), or anything with `as_matrix` such as a SciPy Rotation: presses
    from another side, as `Touches.rotations` says.
    Raises InputError if the pose is not three finite numbers, the rotation is none or another argument is of the
    wrong type, UnsettledError if the press does not come to rest.
    """
    for name, value, kind, right in (
        ("letter", letter, models.Letter, "a name or what tactsim.models.letter or shape made"),
        ("options", options, ScanOptions | None, "tactsim.ScanOptions(...)"),
        ("rng", rng, np.random.Generator | None, "a generator, such as numpy.random.default_rng(0)"),
    ):
        if not isinstance(value, kind):
            raise InputError(f"{name} is {short(value)}; give {right}")
    options = options or ScanOptions()
    pose = finite(sensor_in_object, "sensor_in_object")
    if pose.shape != (3,):
        raise InputError(f"a pose is three numbers [x mm, y mm, theta rad], got {short(sensor_in_object)}")
    sensor = options.sensor
    if rng is None:
        sensor = sensor.model_copy(update={"noise": 0.0, "random_taxels": 0.0})
        rng = np.random.default_rng(0)
    touches = Touches.of(letter, pose[None], (options.press.tilt_x, options.press.tilt_y))
    if rotation is not None:
        touches = replace(touches, rotations=_rotation(rotation)[None])
    moved = ideal_sequence(touches, options) if options.press.dynamics == "full" else None
    if moved is None:  # at rest, or beside the letter: there is nothing to follow through time
        ideal = felt = ideal_readings(touches, options)[0][0]
    else:
        ideal, felt = moved.images[-1], hysteretic(moved.images, sensor.hysteresis)[-1]
    reading = sense(felt[None], sensor, gains(options), rng)[0]
    if moved is None:
        return Press(ideal, reading)
    return Press(ideal, reading, moved.times, moved.images, moved.trace)


def _rotation(given: Any) -> FloatArray:
    matrix = finite(given.as_matrix() if hasattr(given, "as_matrix") else given, "rotation")
    if (
        matrix.shape != (3, 3)
        or np.abs(matrix.T @ matrix - np.eye(3)).max() > 1e-6
        or np.linalg.det(matrix) < 0
    ):
        raise InputError(
            "rotation is no rotation: give a 3 x 3 matrix of three right-handed unit vectors as columns"
        )
    return matrix
