"""Find where a press rests, without the way there: Newton's method by long steps of MuJoCo.

Springs that are taken at the end of a step make one step of length h one step of Newton's method
towards the equilibrium, but for the inertia, m / h^2 against the bed's stiffness. So h is chosen to
make inertia vanish, and one step ends at rest if the same springs carry at its end as at its start.
They do when the face is flat and level. Then pressure does not depend on how stiff the bed is
either, and the bed is stiff, whatever the force.
"""

from __future__ import annotations

import mujoco
import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.bed import Springs
from tactsim.press.scan_options import PressOptions
from tactsim.press.scene import Scene, UnsettledError

MASS = 0.01  # kg; an equilibrium does not depend on it
_INERTIA = 1e-8  # m / h^2 over the bed's stiffness
_DEPTH = 1e-5  # m that a level bed gives way
_BALANCE = 1e-6  # of the force: what contacts may miss of it, and what they may still change in a step
_MOST_STEPS = 50


def rest(stage: Scene, springs: Springs, options: PressOptions) -> FloatArray:
    """Press against `springs` until they balance the force: their forces along the normal, (n,) N.

    Raises UnsettledError if they do not.
    """
    area, force, count = springs.area, options.force, len(springs.share)
    one_step = options.level and springs.flat
    stiffness = force / _DEPTH / area if one_step else options.stiffness_over(area)
    stage.set_springs(springs, stiffness, step=_step(stiffness * area))
    # A step only knows the springs that touch at its start, so it starts where all do.
    front = 0.0 if one_step else stage.depth_of_touch(springs).max()
    stage.reset(front + 1.05 * force / (stiffness * area))
    stage.data.qfrc_applied[0] = force
    # A level bed is linear: the solver's first iteration is within 1e-6. Else it goes on while it improves.
    stage.model.opt.tolerance = 1e-8 if one_step else 0.0
    before: FloatArray | float = np.inf
    for _ in range(_MOST_STEPS):
        stage.check_position()
        mujoco.mj_step(stage.model, stage.data)
        forces = stage.forces(count)
        balanced = abs(forces.sum() - force) <= _BALANCE * force
        if balanced and (one_step or np.abs(forces - before).max() <= _BALANCE * force):
            return forces
        stage.data.qvel[:] = 0  # what is sought has no velocity
        before = forces
    raise UnsettledError(f"after {_MOST_STEPS} steps the contacts carry {forces.sum():g} N of {force:g} N")


def fall(stage: Scene, springs: Springs, options: PressOptions) -> FloatArray:
    """Push a letter that touches nothing for one step: the forces, (n,) N, that MuJoCo finds."""
    stiffness = options.force / _DEPTH  # per mm^2, of nothing
    stage.set_springs(springs, stiffness, step=_step(stiffness))
    stage.reset(_DEPTH)
    stage.data.qfrc_applied[0] = options.force
    mujoco.mj_step(stage.model, stage.data)
    return stage.forces(len(springs.share))


def _step(stiffness: float) -> float:
    return float(np.sqrt(MASS / (_INERTIA * stiffness)))
