"""Find where a press rests by a few long time steps of MuJoCo, each of which is one step of Newton's method.

An implicit step of length h solves (k + m / h^2) dx = imbalance of forces, k being the stiffness of the
springs that touch when the step begins. This is Newton's step towards the equilibrium, except for the
inertia m / h^2; h is chosen so long that inertia is negligible. The step ends at rest if the springs that
touch at its end are those that touched at its beginning.

Under a flat, level face they are, so one step is enough. The pressure under such a face does not depend
on the bed's stiffness either; the bed is then made stiff enough to give way by 0.01 mm at any force.
"""

from __future__ import annotations

import mujoco
import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.bed import Springs
from tactsim.press.scan_options import PressOptions
from tactsim.press.scene import Scene, UnsettledError

MASS = 0.01  # kg; an equilibrium does not depend on it
_INERTIA = 1e-8  # m / h^2 as a share of the bed's stiffness
_DEPTH = 1e-5  # m by which the bed under a flat, level face gives way
_BALANCE = 1e-6  # share of the force that the contacts may miss, and by which one may change in the last step
_MOST_STEPS = 50


def rest(stage: Scene, springs: Springs, options: PressOptions) -> FloatArray:
    """Press against `springs` until they balance the force: their forces along the normal, (n,) N.

    Raises UnsettledError if they do not.
    """
    area, force, count = springs.area, options.force, len(springs.share)
    one_step = options.level and springs.flat
    stiffness = force / _DEPTH / area if one_step else options.stiffness_over(area)
    stage.set_springs(springs, stiffness, step=_step(stiffness * area))
    # A step uses the springs that touch when it begins, so the first one begins where all of them touch.
    front = 0.0 if one_step else stage.depth_of_touch(springs).max()
    stage.reset(front + 1.05 * force / (stiffness * area))
    stage.data.qfrc_applied[0] = force
    # With one step the problem is linear and the solver's first iteration is exact to 1e-6. Otherwise tolerance 0
    # lets the solver go on as long as it improves.
    stage.model.opt.tolerance = 1e-8 if one_step else 0.0
    before: FloatArray | float = np.inf
    for _ in range(_MOST_STEPS):
        stage.check_position()
        mujoco.mj_step(stage.model, stage.data)
        forces = stage.forces(count)
        balanced = abs(forces.sum() - force) <= _BALANCE * force
        if balanced and (one_step or np.abs(forces - before).max() <= _BALANCE * force):
            return forces
        stage.data.qvel[:] = 0  # a press at rest has no velocity
        before = forces
    raise UnsettledError(f"after {_MOST_STEPS} steps the contacts carry {forces.sum():g} N of {force:g} N")


def fall(stage: Scene, springs: Springs, options: PressOptions) -> FloatArray:
    """Push a letter that touches nothing for one step: the forces, (n,) N, that MuJoCo finds (all 0).

    Used only where the skip of presses without contact is switched off, to show that it changes nothing.
    """
    stiffness = options.force / _DEPTH  # as for a contact of 1 mm^2
    stage.set_springs(springs, stiffness, step=_step(stiffness))
    stage.reset(_DEPTH)
    stage.data.qfrc_applied[0] = options.force
    mujoco.mj_step(stage.model, stage.data)
    return stage.forces(len(springs.share))


def _step(stiffness: float) -> float:
    return float(np.sqrt(MASS / (_INERTIA * stiffness)))
