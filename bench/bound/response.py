"""How the ideal reading of a press answers to its pose, and to what nobody knows of the press."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models import Letter
from tactsim.press.engine import check_flat
from tactsim.press.press_model import PressModel
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import EFFECTS, Frames, SensorOptions, gains, take
from tactsim.press.touches import Touches, log_spread

# Steps of the differences where nothing is misplaced: mm and rad, far below the point spread and far above rounding.
SMALL = (0.02, 0.02, 0.002)


@dataclass(frozen=True, eq=False)
class Response:
    """Ideal readings of n presses and their first derivatives.

    mean: (n, taxels) kPa, pressed as stated. by_pose: (n, taxels, 3) kPa per mm, mm and rad of sensor_in_object.
    unknown: (n, taxels, k) kPa, what one standard deviation of each unknown of a press changes: its placement in
    x, y and angle, its tilt about either axis, and its load.
    """

    mean: FloatArray
    by_pose: FloatArray
    unknown: FloatArray


def respond(letter: Letter, poses: FloatArray, options: ScanOptions) -> Response:
    """Press a letter at poses (n, 3) and around them: central differences over one standard deviation.

    A step as long as the placement error takes the mean slope over what the press may really be (statistical
    linearisation), where a slope at a point would see an edge of the contact or miss it.
    Raises UnsettledError if a press does not come to rest.
    """
    placement = np.array([options.placement_mm, options.placement_mm, options.placement_rad])
    steps = np.where(placement > 0, placement, SMALL)
    tilt, load = options.placement_tilt, log_spread(options.load_spread)
    shifts = [(row, np.zeros(2), 0.0) for row in np.diag(steps)]
    if tilt:
        shifts += [(np.zeros(3), row, 0.0) for row in tilt * np.eye(2)]
    if load:
        shifts.append((np.zeros(3), np.zeros(2), load))
    stated = np.tile((options.press.tilt_x, options.press.tilt_y), (len(poses), 1))
    pressed = [(poses, stated, np.ones(len(poses)))]
    for of_pose, of_tilt, of_load in shifts:
        for sign in (1, -1):
            force = np.full(len(poses), math.exp(sign * of_load))
            pressed.append((poses + sign * of_pose, stated + sign * of_tilt, force))
    where, tilts, force = (np.concatenate(parts) for parts in zip(*pressed, strict=True))
    ideal = _ideal(Touches(letter, where, tilts, load=options.test_load * force), options)
    at = Frames(gains(options), options.pad.rows, np.ones((1, len(ideal)), dtype=int))
    readings = take(
        ideal[None], options.sensor, at, [], [effect for effect in EFFECTS if effect.facts.learned]
    )
    mean, *around = readings.reshape(len(pressed), len(poses), -1)
    half = np.stack([(up - down) / 2 for up, down in zip(around[::2], around[1::2], strict=True)], axis=-1)
    by_pose = half[..., :3] / steps
    return Response(mean, by_pose, np.concatenate([by_pose * placement, half[..., 3:]], axis=-1))


def is_quick(letter: Letter, options: ScanOptions) -> bool:
    """Tell whether the forward model presses this letter, in some 10 us a press; if not, an engine does, in 0.5 ms."""
    try:
        check_flat(letter, options)
    except InputError:
        return False
    return True


def _ideal(touches: Touches, options: ScanOptions) -> FloatArray:
    """Press without imperfections (n, taxels): by the forward model where it can, else by the scan's engine."""
    if not is_quick(touches.letter, options):
        from tactsim.press.engine import ideal_readings  # brings MuJoCo

        return ideal_readings(touches, options)[0]
    loads = touches.forces(options.press.force)
    readings = np.empty((len(touches), options.pad.taxels))
    for load in np.unique(loads).tolist():
        rows = loads == load
        press = options.press.model_copy(update={"force": load})
        model = PressModel([touches.letter], options.model_copy(update={"press": press}))
        tilts = touches.tilts[rows] - (options.press.tilt_x, options.press.tilt_y)
        readings[rows] = model.readings(touches.letter.name, touches.poses[rows], tilts)
    return readings


def noise_variance(sensor: SensorOptions) -> float:
    """Give the variance of a taxel that knows the press, kPa^2: noise, and rounding to steps (step^2 / 12).

    A share q of taxels that tell nothing counts as variance / (1 - q). That is the information of one who knows which
    they are, or more (information is concave in the taxels' precisions), so that a bound stays one. What else an effect
    does takes nothing away.

    Raises InputError for a sensor that is not a reading plus noise: with lag, ghosting, all taxels random, or no noise.
    """
    kept = 1.0
    for effect in EFFECTS:
        if effect.facts.mixes and effect.acts(sensor):
            raise InputError(
                f"the bound does not know sensor.{effect.facts.name}, which mixes {effect.facts.mixes}; leave it out"
            )
        kept *= effect.kept(sensor)
        if not kept:
            raise InputError(f"with sensor.{effect.facts.name} = 1 a reading says nothing; give less")
    variance = sum(effect.variance(sensor) for effect in EFFECTS)
    if not variance:
        raise InputError("without noise and resolution nothing bounds the error; give sensor.noise")
    return variance / kept
