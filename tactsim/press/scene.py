"""The MuJoCo scene of a press: a letter that slides along the pad's normal, and the springs that carry it.

The letter faces +z, and its face is at z = 0 where it just touches; a constant force pushes it along +z.
Each spring is a sphere that is fixed to the world above the face and can touch the letter alone (an
explicit pair). `clip` has found what each sphere can touch, so MuJoCo need not search.

A contact with constant impedance d and direct reference (-K, -B) answers with
f = d / ((1 - d) A) * (-a - B v - K r), where r is its distance, v the rate of r, a the rate of v, and A the
letter's inverse weight (1 / 3m for one slide, `body_invweight0`); see "Computation: Constraint model" in
MuJoCo's documentation. With 1 / R = d / ((1 - d) A) = k h^2 + c h, K = k R and B = (k h + c) R this is a
spring k with a damper c, both taken at the end of the step h: an implicit step, stable at any stiffness.
The same holds for the soft equality constraints that let the hinges give way.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.bed import MM, Springs, slopes
from tactsim.press.touches import UnsettledError

# m, of the spheres; less than half a cell, so that no sphere reaches beyond its cell. The letter starts one radius
# behind their centres, so a sphere whose centre is at its spring's position just touches where the depth is 0.
RADIUS = 5e-5
# Largest d / (1 - d). MuJoCo clips impedances d at 1e-4 and 0.9999 without a word, so the stiffest spring may be 1e8
# times as stiff as the softest.
_RANGE = 0.9999 / (1 - 0.9999)
_STAGE = 0.5  # m that the letter may move either way; a flat face is the front of a box that reaches 1 m back
_FAR = 10.0  # m, where the spheres that a press does not need are kept
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # all that the next step depends on

_Disable = mujoco.mjtDisableBit
# Stages of MuJoCo that have nothing to do in a press: it has no sensors, actuators, limits, friction, gravity or
# joint springs, and all its constraints are one island.
UNREAD_STAGES = (
    _Disable.mjDSBL_SENSOR,
    _Disable.mjDSBL_ACTUATION,
    _Disable.mjDSBL_LIMIT,
    _Disable.mjDSBL_FRICTIONLOSS,
    _Disable.mjDSBL_GRAVITY,
    _Disable.mjDSBL_SPRING,
    _Disable.mjDSBL_DAMPER,
    _Disable.mjDSBL_ISLAND,
    _Disable.mjDSBL_EULERDAMP,
)


@dataclass(frozen=True)
class Setup:
    """What a scene is compiled for.

    mass: kg, of what moves. wrist_stiffness: N mm / rad, of the hinges that let a tilt give way; None: it is rigid.
    """

    mass: float
    wrist_stiffness: float | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A compiled scene for at most `capacity` springs."""

    setup: Setup
    capacity: int
    model: Any
    data: Any
    rest: FloatArray  # the state that every press starts from
    # Views of the model's arrays that a press writes: of the spheres, of their pairs, of the letter.
    position: FloatArray
    solref: FloatArray
    solimp: FloatArray
    inverse_weight: FloatArray
    gimbal_body: int
    tilt: FloatArray  # rad about x and y, between letter and pad where nothing pushes

    def reset(self, depth: float, tilt: FloatArray | None = None) -> None:
        """Forget the last press, the solver's warm start included, and put the letter `depth` m into the bed.

        tilt: (2,) rad, how far the wrist has given way to; the nominal tilt if it is None.
        """
        mujoco.mj_setState(self.model, self.data, self.rest, _STATE)
        self.data.qpos[0] = depth
        if self.setup.wrist_stiffness is not None:
            self.data.qpos[1:] = self.tilt if tilt is None else tilt

    def depth_of_touch(self, springs: Springs) -> FloatArray:
        """Work out how far the letter has to move to touch each spring at the nominal tilt, (n,) m."""
        slope = slopes(self.tilt[None])[0]
        return springs.position[:, 2] - springs.position[:, :2] @ slope

    def depths(self, springs: Springs) -> FloatArray:
        """Work out how far the letter is into each spring now, (n,) m; below 0 where it does not touch."""
        position = self.data.qpos
        slope = slopes((self.tilt if self.setup.wrist_stiffness is None else position[1:])[None])[0]
        return position[0] + springs.position[:, :2] @ slope - springs.position[:, 2]

    def set_springs(
        self,
        springs: Springs,
        stiffness: float,
        *,
        step: float,
        relaxation: float = 0.0,
        margin: FloatArray | float = 0.0,
        bending: FloatArray | float = 0.0,
    ) -> None:
        """Put springs of `stiffness` (N/m per mm^2 of area) into the scene, for steps of `step` s.

        relaxation: s, damping over stiffness, of the bed and of the hinges. margin: (n,) m, distance at which
        each sphere feels the letter. bending: (2,) N mm/rad about x and y, by which the hinges resist tilts from
        where the step begins, besides the wrist. See the module's docstring for the equations.
        """
        count = len(springs.share)
        self.position[:count] = springs.position
        self.position[count:, 2] = _FAR
        self.model.pair_margin[:count] = margin
        self.set_step(
            springs,
            stiffness,
            step=step,
            bed_relaxation=relaxation,
            hinge_relaxation=relaxation,
            bending=bending,
        )

    def set_step(
        self,
        springs: Springs,
        stiffness: float,
        *,
        step: float,
        bed_relaxation: float | FloatArray,
        hinge_relaxation: float,
        bending: FloatArray | float = 0.0,
    ) -> None:
        """Set the length of the next steps, s, and the dampers beside the springs that are in the scene.

        bed_relaxation: s, damping over stiffness of all springs, or (n,) of each. hinge_relaxation: s.
        bending: as for `set_springs`.
        """
        self.model.opt.timestep = step
        b, delay = 1 / step, step + bed_relaxation
        longest = delay.max() if isinstance(delay, np.ndarray) else delay
        # MuJoCo uses A for nothing but to turn an impedance into 1 / R. A is set so that the stiffest spring gets
        # the largest impedance: then all springs lie within MuJoCo's limits.
        self.inverse_weight[0] = _RANGE / (stiffness * (springs.largest or 1.0) * step * longest)
        impedance = springs.share * (delay / longest) * _RANGE
        impedance /= 1 + impedance
        count = len(impedance)
        solref, solimp = self.solref[:count], self.solimp[:count]
        np.multiply(impedance, -b, out=solref[:, 1])
        np.divide(solref[:, 1], delay, out=solref[:, 0])
        solimp[:, 0] = solimp[:, 1] = impedance
        if self.setup.wrist_stiffness is not None:
            # A of the hinges such that their impedance is 1/2.
            unit = step * (step + hinge_relaxation)
            self.model.dof_invweight0[1:] = 1 / ((self.setup.wrist_stiffness + bending) * MM * unit)
            self.model.eq_solref[:] = -1 / unit / 2, -b / 2
            self.model.eq_solimp[:, :2] = 1 / 2

    def forces(self, count: int) -> FloatArray:
        """Read the force along the pad's normal, N, of the first `count` springs."""
        data = self.data
        oblique = self.setup.wrist_stiffness is not None or self.tilt.any()
        if len(data.efc_force) == data.ncon == count and not oblique:
            return data.efc_force.copy()  # all springs touch, in their order
        contact = data.contact
        row = contact.efc_address
        carrying = row >= 0
        result = np.zeros(self.capacity)  # a letter that turns over may touch spheres that are kept far away
        result[contact.geom[carrying, 0]] = data.efc_force[row[carrying]] * np.abs(contact.frame[carrying, 2])
        return result[:count]

    def check_position(self) -> None:
        """Raise UnsettledError if the letter has left the stage: then nothing holds it any more."""
        depth = self.data.qpos[0]
        if not abs(depth) < _STAGE:
            raise UnsettledError(
                f"the bed does not hold it, it has moved by {depth:.3g} m; the bed or its hinges are too soft"
            )


def scene(setup: Setup, springs: int, tilt: FloatArray) -> Scene:
    """Give this thread's scene with room for `springs`, compiled when it is first asked for.

    Its letter's face is at z = 0 in the pad's middle, at a nominal tilt (2,) rad. What the spheres can touch is one
    plane: they stand only where the face is.
    """
    capacity = 1 << max(4, (springs - 1).bit_length())
    known = _THREAD.__dict__.setdefault("scenes", OrderedDict())
    key = (setup, capacity)
    if key not in known:
        known[key] = _compile(setup, capacity)
        if len(known) > _MOST_SCENES:
            known.popitem(last=False)
    found = known[key]
    found.tilt[:] = tilt
    if setup.wrist_stiffness is not None:
        found.model.eq_data[:, 0] = tilt
    else:
        (cos_x, cos_y), (sin_x, sin_y) = np.cos(tilt / 2), np.sin(tilt / 2)
        quaternion = (cos_x * cos_y, sin_x * cos_y, cos_x * sin_y, sin_x * sin_y)
        found.model.body_quat[found.gimbal_body] = quaternion
    return found


_THREAD = threading.local()  # a scene holds the state of one press, so threads do not share it
_MOST_SCENES = 16


def _compile(setup: Setup, capacity: int) -> Scene:
    cells = range(capacity)
    spheres = "".join(f'<geom name="cell{i}" size="{RADIUS}" pos="0 0 {_FAR + i}"/>' for i in cells)
    pairs = "".join(f'<pair geom1="cell{i}" geom2="face" condim="1"/>' for i in cells)
    hinged = setup.wrist_stiffness is not None
    face = '<geom name="face" type="box" size="1 1 1" pos="0 0 -1"/>'
    carriage, springs = describe_carriage(face, setup.mass, hinged=hinged, height=-RADIUS)
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <compiler angle="radian"/>
        <size memory="{memory(capacity)}"/>
        <option gravity="0 0 0" iterations="20" ccd_tolerance="1e-12" ccd_iterations="200"/>
        <default><geom contype="0" conaffinity="0" density="0"/></default>
        <worldbody>
          {spheres}
          {carriage}
        </worldbody>
        <contact>{pairs}</contact>
        <equality>{springs}</equality>
        </mujoco>"""
    )
    model.opt.disableflags = sum(int(stage) for stage in UNREAD_STAGES)
    data = mujoco.MjData(model)
    rest = np.zeros(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, rest, _STATE)
    body, gimbal = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("letter", "gimbal"))
    return Scene(
        setup,
        capacity,
        model,
        data,
        rest,
        position=model.geom_pos[:capacity],
        solref=model.pair_solref,
        solimp=model.pair_solimp,
        inverse_weight=model.body_invweight0[body],
        gimbal_body=gimbal,
        tilt=np.zeros(2),
    )


def memory(contacts: int) -> int:
    """Give the bytes that MuJoCo needs for so many contacts; where they do not suffice it drops some."""
    return 4_000 * contacts + 10**6


def describe_carriage(geoms: str, mass: float, *, hinged: bool, height: float = 0.0) -> tuple[str, str]:
    """Write what moves a letter's geoms as MJCF, and the constraints that make its hinges springs.

    It slides along the pad's normal from `height` m, and tilts about x and y if it is `hinged`. mass: kg.
    """
    hinges = springs = ""
    if hinged:
        for axis, name in (("1 0 0", "tilt_x"), ("0 1 0", "tilt_y")):
            hinges += f'<joint name="{name}" type="hinge" axis="{axis}"/>'
            springs += f'<joint joint1="{name}" polycoef="0 0 0 0 0"/>'
    half = mass / 2  # one half slides, the other tilts with the letter
    moment = half * 25e-6  # kg m^2, of a body about as large as a letter
    inertia = f'<inertial pos="0 0 0" mass="{half}" diaginertia="{moment} {moment} {moment}"/>'
    return (
        f"""<body name="carriage" pos="0 0 {height}">
            <joint name="press" type="slide" axis="0 0 1"/>
            {inertia}
            <body name="gimbal">
              {hinges}
              {inertia}
              <body name="letter">{geoms}</body>
            </body>
          </body>""",
        springs,
    )
