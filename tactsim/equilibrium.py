"""Press flat faces against the pad in MuJoCo until they rest: contact forces of an equilibrium.

The face slides along the pad's normal under a constant force, carried by one soft contact per
covered cell. A contact with constant impedance d and direct reference (-d/h^2, -d/h) is a spring of
stiffness d / ((1 - d) A h^2), A being the face's inverse weight, taken at the end of the step: one
step of length h is one step of Newton's method towards the equilibrium. As pressure under a flat
face does not depend on how stiff the bed is, the bed is as stiff as MuJoCo allows, and one step ends
within 1e-6 of the balance of forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np

from tactsim.bed import Bed
from tactsim.poses import FloatArray

_IMPEDANCE = 0.9999  # of the stiffest contact; above this MuJoCo clips, and forces are silently wrong
_SOFTEST = 1e-4  # MuJoCo clips below this too
_DEPTH = 1e-5  # m that the bed gives way at rest
_BALANCE = 1e-6  # of the force: what the contacts may miss of it
_MOST_STEPS = 10
_RADIUS = 1e-3  # m, of the sphere that stands for a cell's spring


class UnsettledError(RuntimeError):
    """A press did not come to rest; it has no reading."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """A compiled scene for up to `capacity` contacts, and the arrays of it that a press sets."""

    capacity: int
    model: Any
    data: Any
    inverse_weight: float


def contact_forces(bed: Bed, force: float) -> FloatArray:
    """Press every face of `bed` with `force` N to equilibrium: the contacts' forces, (contacts,) N.

    Raises UnsettledError if the contacts of a press do not balance the force.
    """
    forces = np.zeros(len(bed.area))
    for first, last in zip(bed.start[:-1], bed.start[1:], strict=True):
        if last > first:
            forces[first:last] = _settle(bed.centroid[first:last], bed.area[first:last], force)
    return forces


def _settle(centroid: FloatArray, area: FloatArray, force: float) -> FloatArray:
    count = len(area)
    scene = _scene(1 << max(4, (count - 1).bit_length()))
    model, data = scene.model, scene.data
    stiffness = force / _DEPTH * (area / area.sum())  # N/m, of each contact
    step_squared = _IMPEDANCE / ((1 - _IMPEDANCE) * stiffness.max() * scene.inverse_weight)
    gain = step_squared * stiffness * scene.inverse_weight
    impedance = np.maximum(gain / (1 + gain), _SOFTEST)
    step = np.sqrt(step_squared)

    mujoco.mj_resetData(model, data)  # also what the solver remembers of the last press
    model.opt.timestep = step
    model.geom_pos[:count, :2] = centroid * 1e-3
    model.pair_solref[:count, 0] = impedance / -step_squared
    model.pair_solref[:count, 1] = impedance / -step
    model.pair_solimp[:count, :2] = impedance[:, None]
    model.geom_pos[:count, 2] = -_RADIUS
    model.geom_pos[count:-1, 2] = -1.0
    data.qfrc_applied[0] = -force
    data.qpos[0] = -1.05 * _DEPTH
    for _ in range(_MOST_STEPS):
        mujoco.mj_step(model, data)
        forces = data.efc_force
        if len(forces) == count and abs(forces.sum() - force) <= _BALANCE * force:
            return forces
    raise UnsettledError(f"contact forces of {forces.sum():g} N do not balance {force:g} N")


@cache
def _scene(capacity: int) -> _Scene:
    """Compile the scene: a face on a slide, `capacity` spheres below it, one contact pair for each."""
    spheres = "".join(
        f'<geom name="cell{i}" type="sphere" size="{_RADIUS}" pos="{i} 0 -1"/>' for i in range(capacity)
    )
    pairs = "".join(f'<pair geom1="cell{i}" geom2="face" condim="1"/>' for i in range(capacity))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <option gravity="0 0 0" solver="Newton" cone="elliptic"/>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody>
          <body name="letter">
            <joint name="press" type="slide" axis="0 0 1"/>
            <inertial pos="0 0 0" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/>
            <geom name="face" type="box" size="1 1 0.01" pos="0 0 0.01"/>
          </body>
          {spheres}
        </worldbody>
        <contact>{pairs}</contact>
        </mujoco>"""
    )
    return _Scene(capacity, model, mujoco.MjData(model), float(model.body_invweight0[1, 0]))
