"""Press a letter the plain way: the whole scene in MuJoCo, with or without its defaults, and a loop until it settles.

The bed is the press's own, a spring for each cell of the pad and part of the letter at the covered
centroid, as stiff as the covered area. Nothing is left out: springs that carry nothing and parts that are
far away are in the scene. Step, solver, cone, friction and contact reference are MuJoCo's defaults; `TUNED`
changes the contacts' time constant alone, to the shortest that two of MuJoCo's steps allow.
"""

import mujoco
import numpy as np

from tactsim.core import invert
from tactsim.press.bed import MM
from tactsim.press.scene import describe_part

_SETTLED = 1e-4  # of the force: what the contacts may miss of it
_STILL = 1e-7  # m/s; a bed that gives way by 10 um is then within 1 % of its rest
_MASS = 0.1  # kg, of what moves
_RADIUS = 4e-4  # m, of a cell's sphere
_MOST_STEPS = 5000
DEFAULT, TUNED = 0.02, 0.004  # s, time constants of a contact


def compile_plain(letter, pose, springs, constant=DEFAULT):
    """Compile the scene of one press; `springs` of a bed with every cell and part; `constant` of contacts, s."""
    meshes, geoms = (
        "".join(texts) for texts in zip(*map(describe_part, range(99), letter.parts), strict=False)
    )
    spheres, pairs = [], []
    for index, (position, share, level) in enumerate(
        zip(springs.position, springs.share, springs.level, strict=True)
    ):
        # MuJoCo's reference of that time constant and of damping ratio 1, scaled to the spring's share.
        reference = f"{-share / constant**2} {-2 / constant}"
        x, y, z = position
        spheres.append(
            f'<geom name="cell{index}" contype="0" conaffinity="0" size="{_RADIUS}" pos="{x} {y} {z + _RADIUS}"/>'
        )
        pairs.append(
            f'<pair geom1="cell{index}" geom2="part{level}" solref="{reference}" solimp="0.95 0.95 0.001"/>'
        )
    x, y, angle = invert(pose)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><asset>{meshes}</asset><worldbody>
        {"".join(spheres)}
        <body pos="{x * MM} {y * MM} {-letter.height * MM}" euler="0 0 {angle}">
          <joint type="slide" axis="0 0 1"/>
          <inertial pos="0 0 0" mass="{_MASS}" diaginertia="1e-5 1e-5 1e-5"/>
          {geoms}
        </body></worldbody><contact>{"".join(pairs)}</contact></mujoco>"""
    )


def press_plain(model, count, force):
    """Step until the contacts balance the force and nothing moves: each spring's force (n,) N, and the steps."""
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = force
    for step in range(1, _MOST_STEPS + 1):
        mujoco.mj_step(model, data)
        carried = -data.qfrc_constraint[0]
        if abs(carried - force) <= _SETTLED * force and abs(data.qvel[0]) < _STILL:
            forces = np.zeros(count)
            one = np.zeros(6)
            for index in range(data.ncon):
                mujoco.mj_contactForce(model, data, index, one)
                forces[data.contact.geom[index].min()] = one[0]
            return forces, step
    raise RuntimeError("the plain press did not settle")
