"""Work out the contact forces of presses with MuJoCo: at rest, or through time until they rest."""

from __future__ import annotations

import numpy as np

from tactsim import models
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed, Springs
from tactsim.press.dynamics import History, press_through_time
from tactsim.press.equilibrium import MASS, fall, rest
from tactsim.press.scan_options import PressOptions
from tactsim.press.scene import Setup, UnsettledError, scene


def contact_forces(bed: Bed, poses: FloatArray, letter: models.Letter, options: PressOptions) -> FloatArray:
    """Press `letter` on its bed at each pose until it rests.

    bed: the springs of all presses. poses: (presses, 3) sensor_in_object, where the bed was laid.
    Returns every contact's force along the pad's normal, (contacts,) N.
    Raises UnsettledError, naming letter and pose, if a press does not come to rest.
    """
    forces = np.zeros(len(bed.area))
    setup = _setup(letter, options, MASS)
    for springs, pose in zip(bed.springs, poses, strict=True):
        if options.skip.no_contact and not springs.area:
            continue
        if options.dynamics == "full" and springs.area:
            forces[springs.rows] = contact_history(springs, pose, letter, options).forces[-1]
            continue
        stage = scene(setup, len(springs.share))
        stage.place_letter(pose)
        try:
            forces[springs.rows] = (rest if springs.area else fall)(stage, springs, options)
        except UnsettledError as error:
            raise named(error, letter, pose) from error
    return forces


def contact_history(
    springs: Springs, pose: FloatArray, letter: models.Letter, options: PressOptions
) -> History:
    """Step one press at `pose` (3,) sensor_in_object through time until it rests.

    Raises UnsettledError, naming letter and pose, if it does not.
    """
    stage = scene(_setup(letter, options, options.moving_mass), len(springs.share))
    stage.place_letter(pose)
    try:
        return press_through_time(stage, springs, options)
    except UnsettledError as error:
        raise named(error, letter, pose) from error


def _setup(letter: models.Letter, options: PressOptions, mass: float) -> Setup:
    return Setup(
        mass=mass,
        tilt=(options.tilt_x, options.tilt_y),
        tilt_stiffness=options.tilt_stiffness,
        letter=None if options.skip.parts else letter,
        skip_stages=options.skip.stages,
    )


def named(error: UnsettledError, letter: models.Letter, pose: FloatArray) -> UnsettledError:
    """Name the press that did not settle."""
    x, y, angle = pose
    return UnsettledError(
        f"letter {letter.name!r} pressed at x = {x:g} mm, y = {y:g} mm, {angle:g} rad does not settle: {error}"
    )
