"""Press a letter once, from above or from a side: what a pad would read, ideal and real."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.models.letter import Letter
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import EFFECTS, gains, sense
from tactsim.press.touches import Touches

if TYPE_CHECKING:
    from tactsim.press.dynamics import ForceTrace


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
    letter: Letter,
    sensor_in_object: ArrayLike,
    options: ScanOptions | None = None,
    rng: np.random.Generator | None = None,
    rotation: ArrayLike | None = None,
) -> Press:
    """Press `letter` at one pose [x, y, theta] (mm, rad), exactly there, tilted as the options' press is.

    Of `options` only pad, press, sensor and, for the pad's gains, seed count. `rng` draws noise and random
    taxels; without it there are none. rotation: (3, 3), or anything with `as_matrix` such as a SciPy Rotation: presses
    from another side than above. Its columns are axes in the object frame: the third is the pad's normal, pointing away
    from the letter, and the pose lies in the plane of the other two. The pad's own axes are rotation @ Rz(theta) then,
    and its middle is on the line rotation @ (x, y, any z).
    Raises InputError if the pose is not three finite numbers, the rotation is none or another argument is of the
    wrong type, UnsettledError if the press does not come to rest.
    """
    for name, value, kind, right in (
        ("letter", letter, Letter, "a name or what tactsim.models.letter or shape made"),
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
        sensor = sensor.without(effect for effect in EFFECTS if effect.facts.draws != "never")
        rng = np.random.default_rng(0)
    if rotation is not None:
        letter, options = _from_a_side(letter, _rotation(rotation), options)
    touches = Touches.of(letter, pose[None], (options.press.tilt_x, options.press.tilt_y))
    moved = None
    if options.press.dynamics == "full":
        from tactsim.press.dynamics import hysteretic, ideal_sequence

        moved = ideal_sequence(touches, options)
    if moved is None:  # at rest, or beside the letter: there is nothing to follow through time
        ideal = felt = ideal_readings(touches, options)[0][0]
    else:
        ideal, felt = moved.images[-1], hysteretic(moved.images, sensor.hysteresis)[-1]
    reading = sense(felt[None], sensor, gains(options), rng, rows=options.pad.rows)[0]
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


def _from_a_side(letter: Letter, rotation: FloatArray, options: ScanOptions) -> tuple[Letter, ScanOptions]:
    """Turn a letter so that it is seen from above in the axes `rotation` (3, 3), and have `relief` press it.

    Raises InputError for options that ask for another engine.
    """
    from tactsim.models.height_field import Relief

    press = options.press
    if press.dynamics == "full":
        raise InputError("a press from another side is worked out at rest alone; give dynamics = equilibrium")
    if press.engine not in ("auto", "relief"):
        raise InputError(
            f"press.engine: {press.engine} cannot press this: {letter.name!r} is pressed from a side; give auto"
        )
    turned = replace(letter, relief=(letter.relief or Relief.of(letter.solid)).turned(rotation))
    return turned, options.model_copy(update={"press": press.model_copy(update={"engine": "relief"})})
