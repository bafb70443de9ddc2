"""Contact forces of presses: set each up in MuJoCo, and let it rest or step it through time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import models
from tactsim.bed import Bed, Springs
from tactsim.dynamics import History, press_through_time
from tactsim.equilibrium import MASS, fall, rest
from tactsim.options import PressOptions
from tactsim.poses import FloatArray
from tactsim.scene import Setup, UnsettledError, scene


def contact_forces(bed: Bed, poses: FloatArray, letter: models.Letter, options: PressOptions) -> FloatArray:
    """Press the faces of `bed` until they rest: every contact's force along the pad's normal, (contacts,) N.

    poses: (presses, 3) sensor_in_object, where the bed was laid.
    Raises UnsettledError, naming letter and pose, if a press does not come to rest.
    """
    forces = np.zeros(len(bed.area))
    for press, pose in enumerate(poses):
        springs = bed.springs(press)
        touches = springs.area.any()
        if options.skip.no_contact and not touches:
            continue
        if options.dynamics == "full" and touches:
            result = contact_history(springs, pose, letter, options).forces[-1]
        else:
            stage = scene(_setup(letter, options, MASS), len(springs.area))
            stage.place_letter(pose)
            with _naming(letter, pose):
                result = (rest if touches else fall)(stage, springs, options)
        forces[bed.contacts(press)] = result
    return forces


def contact_history(
    springs: Springs, pose: FloatArray, letter: models.Letter, options: PressOptions
) -> History:
    """Step one press through time until it rests. Raises UnsettledError, naming letter and pose."""
    stage = scene(_setup(letter, options, options.moving_mass), len(springs.area))
    stage.place_letter(pose)
    with _naming(letter, pose):
        return press_through_time(stage, springs, options)


def _setup(letter: models.Letter, options: PressOptions, mass: float) -> Setup:
    return Setup(
        mass=mass,
        tilt=(options.tilt_x, options.tilt_y),
        tilt_stiffness=options.tilt_stiffness,
        letter=None if options.skip.parts else letter,
        skip_stages=options.skip.stages,
    )


@contextmanager
def _naming(letter: models.Letter, pose: FloatArray) -> Iterator[None]:
    """Say which press it was that did not settle."""
    try:
        yield
    except UnsettledError as error:
        x, y, angle = pose
        raise UnsettledError(
            f"letter {letter.name!r} pressed at x = {x:g} mm, y = {y:g} mm, {angle:g} rad does not settle: {error}"
        ) from error
