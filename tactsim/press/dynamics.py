"""Press one letter through time under a force controller: approach, touch, settle.

The scene is that of the equilibrium, but time steps are short, the letter has its real mass, and each
spring of the bed has a damper beside it (a Kelvin-Voigt layer with the given relaxation time). The
controller moves the letter at a set speed until the contact force shows a touch. Then it raises the
force along a ramp and waits until the force and the contacts have settled.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.bed import MM, Springs
from tactsim.press.scan_options import PressOptions
from tactsim.press.scene import Scene, UnsettledError

_STEP = 5e-4  # s
_TOUCH = 0.01  # share of the force above which contacts are a touch; or half of what the approach can push, if less
_SETTLED = 1e-3  # share of the force that contacts may miss, and by which they may change in a settling time
_SETTLING = round(0.02 / _STEP)  # steps
_DAMPING = 2.0  # N s / m, of the controller once the letter touches


@dataclass(frozen=True, eq=False)
class History:
    """Contact forces over a press; the last frame is at rest.

    times: (frames,) s since the letter began to move. forces: (frames, contacts) N.
    """

    times: FloatArray
    forces: FloatArray


def press_through_time(stage: Scene, springs: Springs, options: PressOptions) -> History:
    """Press against `springs` until force and contacts have settled.

    Raises UnsettledError if they have not at the time limit.
    """
    force, count = options.force, len(springs.share)
    stage.set_springs(
        springs, options.stiffness_over(springs.area), step=_STEP, relaxation=options.relaxation
    )
    stage.reset(stage.depth_of_touch(springs).min() - options.clearance * MM)
    stage.model.opt.tolerance = 1e-10
    data = stage.data
    frame_every = max(1, round(1 / (options.frame_rate * _STEP)))
    follow = options.moving_mass / (10 * _STEP)  # N s / m, of the velocity loop
    approach = options.approach_speed * MM
    touch = min(_TOUCH * force, follow * approach / 2)
    latest = np.zeros((_SETTLING, count))  # forces of the last steps, the oldest overwritten first
    touched: int | None = None
    times, frames = [], []
    for index in range(round(options.time_limit / _STEP)):
        if touched is None:
            data.qfrc_applied[0] = follow * (approach - data.qvel[0])
        else:
            ramp = min(1.0, (index - touched) * _STEP / options.ramp) if options.ramp else 1.0
            data.qfrc_applied[0] = max(ramp, _TOUCH) * force - _DAMPING * data.qvel[0]
        stage.check_position()
        mujoco.mj_step(stage.model, data)
        forces = stage.forces(count)
        if touched is None and forces.sum() > touch:
            touched = index
        oldest = latest[index % _SETTLING].copy()
        latest[index % _SETTLING] = forces
        at_rest = (
            touched is not None
            and index - touched >= _SETTLING
            and np.abs(latest.sum(axis=1) - force).max() <= _SETTLED * force
            and np.abs(forces - oldest).sum() <= _SETTLED * force
        )
        if at_rest or index % frame_every == 0:
            times.append((index + 1) * _STEP)
            frames.append(forces.copy())
        if at_rest:
            return History(np.array(times), np.array(frames))
    state = "has not touched" if touched is None else f"carries {forces.sum():g} N of {force:g} N"
    raise UnsettledError(f"after {options.time_limit:g} s it {state}; a longer time_limit may help")
