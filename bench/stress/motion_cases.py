"""Objects that move between touches: the frames in which steps are taken."""

from __future__ import annotations

import numpy as np

from tactsim.bench.stress.case import Worst, case
from tactsim.core import compose, wrap_angle
from tactsim.estimators.filters.motion import parse_motion


@case(
    "motion.frames",
    varied="placements all over the plane, steps of 1e-9 to 10 mm and rad",
    deviation="mm between states and the same states turned into placements and back; or a step seen in another frame",
    limit=1e-9,
    because="a state and its placement are one pose and its inverse",
)
def frames(worst: Worst) -> None:
    """Turn states into placements and back, and take a step of the object in the robot's frame."""
    rng = np.random.default_rng(0)
    motion = parse_motion("0.5,0.03")
    assert motion is not None
    state = rng.uniform(-20, 20, (3, 500))
    state[2] = wrap_angle(state[2])
    again = motion.state(motion.placed(state))
    worst.see(np.abs(again[:2] - state[:2]), "there and back")
    worst.see(np.abs(wrap_angle(again[2] - state[2])), "there and back")
    for size in (1e-9, 1e-3, 10.0):
        step = rng.standard_normal(3) * size
        moved = motion.state(motion.placed(state) + step / [1, 1, motion.ratio])
        # Placements T_O^R compose with states T_R^O to nothing, before the step and after.
        nothing = compose((motion.placed(state) * [1, 1, motion.ratio]) + step, moved.T)
        worst.see(np.abs(nothing[:, :2]), f"steps of {size}")
