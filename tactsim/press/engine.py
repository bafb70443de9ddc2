"""Press a letter with the engine asked for, or the cheapest that is exact: what a pad would read, ideal and real.

The engines answer the same question, each in a file of its own: `exact` (flat faces in closed form), `balance` (the
engine `bed`: exact areas, MuJoCo solves the balance of what may move), `collide` (MuJoCo alone, its collision
detection included), `relief` (any shape) and, for a press through time, `dynamics`. Each is imported when it first
presses: some bring MuJoCo or compiled loops.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.models.letter import Letter
from tactsim.press.bed import has_relief
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import EFFECTS, gains, hysteretic, sense
from tactsim.press.touches import Pressed, Touches

_MOST_OF_BED = 20_000  # cells of a pad, past which MuJoCo takes seconds to compile as many springs

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


def press_at(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter until it rests, and keep the pressure on the pad.

    A press that does not come to rest is a blank, with its reason.
    Raises InputError if the engine asked for cannot press this.
    """
    name = "full" if options.press.dynamics == "full" else engine_for(touches, options)
    if name == "exact":
        from tactsim.press.exact import press
    elif name == "bed":
        from tactsim.press.balance import press
    elif name == "collide":
        from tactsim.press.collide import press
    elif name == "relief":
        from tactsim.press.relief import press
    else:
        from tactsim.press.dynamics import press
    pressed = press(touches, options)
    pressed.work[f"engine_{name}"] = pressed.work["presses"]
    return pressed


def ideal_readings(touches: Touches, options: ScanOptions) -> tuple[FloatArray, Counter[str]]:
    """Press a letter until it rests.

    Returns (n, taxels) kPa without imperfections, and the work: `presses`, and what was skipped by reason.
    Raises UnsettledError, naming letter and pose, if a press does not come to rest; InputError if the engine
    asked for cannot press this.
    """
    pressed = press_at(touches, options).settled()
    return pressed.readings(options), pressed.work


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
        from tactsim.press.dynamics import ideal_sequence

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


def engine_for(touches: Touches, options: ScanOptions) -> str:
    """Name the engine that presses: the one asked for, or the cheapest that is exact here.

    Raises InputError if the engine asked for cannot press this.
    """
    press = options.press
    if press.engine != "auto":
        obstacle = _obstacle(press.engine, touches, options)
        if obstacle:
            raise InputError(f"press.engine: {press.engine} cannot press this: {obstacle}; give auto")
        return press.engine
    if has_relief(touches.letter, press):
        return "relief"
    if touches.letter.rounding:
        return "bed"
    level = press.wrist_stiffness is None and not touches.tilts.any()
    cells = math.prod(len(lines) - 1 for lines in options.cell_lines)
    return "exact" if level or cells > _MOST_OF_BED else "bed"


def _obstacle(engine: str, touches: Touches, options: ScanOptions) -> str:
    """Say why an engine cannot press this; nothing if it can."""
    press = options.press
    if engine in ("exact", "bed") and has_relief(touches.letter, press):
        return f"{touches.letter.name!r} has relief"
    if engine == "exact" and touches.letter.rounding:
        return f"{touches.letter.name!r} has rounded edges"
    return ""


def check_flat(letter: Letter, options: ScanOptions) -> None:
    """Raise InputError unless the forward model can press the letter: a flat face on springs, at rest."""
    engine = engine_for(Touches.of(letter, np.zeros((1, 3))), options)
    if options.press.dynamics == "full" or letter.rounding or engine not in ("exact", "bed"):
        raise InputError(
            f"the forward model presses flat faces with sharp edges on springs, at rest; {letter.name!r} is pressed "
            f"otherwise here"
        )
