"""Press a ball into a soft pad that MuJoCo's flex models, on a rigid back and on one that bends, and time it.

    python tests/press/measure_flex.py

The pad is a solid 11.4 mm square and 3 mm thick, of tetrahedra; its lower face is pinned wholly (a rigid back), or at
its rim alone (a pad that bends). Beside it stands the pad of springs that the harness presses, of the same stiffness
k = E (1 - nu) / ((1 + nu) (1 - 2 nu) h). Loads are shared among 6 x 6 taxels, without point spread.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from time import process_time

import mujoco
import numpy as np
from manifold3d import Manifold

from tactsim import Pad, models
from tactsim.press import PressOptions, ScanOptions, SensorOptions, press_letter

SIDE, THICK, BALL, FORCE = 11.4, 3.0, 10.0, 0.5  # mm, N
YOUNG, POISSON = 110.0, 0.3  # kPa
STIFFNESS = YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON) * THICK)  # kPa/mm
MASS, DAMPING = 5.0, 0.02
STEP, REST = 1e-3, 2e-5  # s; mm that the ball moves in a step once it is at rest


def scene(along: int, deep: int, *, bends: bool) -> mujoco.MjModel:
    """Compile a ball above a soft pad with so many vertices along its sides and through its thickness."""
    gap, layer = SIDE / (along - 1) / 1e3, THICK / (deep - 1) / 1e3
    end = along - 1
    rim = f"0 0 0 {end} 0 0  0 {end} 0 {end} {end} 0  0 0 0 0 {end} 0  {end} 0 0 {end} {end} 0"
    pinned = rim if bends else f"0 0 0 {end} {end} 0"
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{STEP}" solver="Newton" integrator="discrete" gravity="0 0 0"/>
          <size memory="500M"/>
          <worldbody>
            <flexcomp name="pad" type="grid" dim="3" count="{along} {along} {deep}" spacing="{gap} {gap} {layer}"
                      radius="1e-5" mass="{MASS}">
              <contact condim="1" selfcollide="none" solref="0.002 1" solimp="0.99 0.999 1e-5"/>
              <elasticity young="{YOUNG * 1e3}" poisson="{POISSON}" damping="{DAMPING}"/>
              <pin gridrange="{pinned}"/>
            </flexcomp>
            <body pos="0 0 {(THICK / 2 + BALL) / 1e3 + 2e-5}">
              <joint name="down" type="slide" axis="0 0 -1" damping="80"/>
              <geom type="sphere" size="{BALL / 1e3}" mass="{MASS}" condim="1"/></body>
          </worldbody></mujoco>""")


def press(model: mujoco.MjModel, gap: float) -> tuple[np.ndarray, float, int]:
    """Press the ball until it rests: loads of the taxels (6, 6) N, mm that it has sunk, and steps.

    gap: mm between vertices.
    """
    data = mujoco.MjData(model)
    joint = model.joint("down")
    data.qfrc_applied[joint.dofadr] = FORCE
    before = 0.0
    for step in range(1, 2001):
        mujoco.mj_step(model, data)
        depth = 1e3 * float(data.qpos[joint.qposadr[0]])
        if step > 20 and abs(depth - before) < REST:
            break
        before = depth
    loads, force = np.zeros((6, 6)), np.zeros(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        x, y = 1e3 * data.contact[number].pos[:2]
        # Along the ball's normal; what a taxel feels is the part along the pad's.
        loads += abs(data.contact[number].frame[2]) * force[0] * np.outer(shares(y, gap), shares(x, gap))
    return loads, depth, step


def shares(at: float, gap: float) -> np.ndarray:
    """Share what a vertex carries, spread evenly over `gap` mm, among the six taxels along a side: (6,)."""
    edges = np.linspace(-SIDE / 2, SIDE / 2, 7)
    edges[[0, -1]] = -np.inf, np.inf
    return np.diff(np.clip(edges, at - gap / 2, at + gap / 2)) / gap


def springs() -> tuple[np.ndarray, float]:
    """Press the same ball into the harness's pad of springs: loads (6, 6) N, and s of one core."""
    ball = models.relief("ball", Manifold.sphere(BALL, 96))
    pad = Pad(taxel_width=1.9, taxel_height=1.9, pitch_x=1.9, pitch_y=1.9, seam=None, unread_columns=0)
    options = ScanOptions(
        pad=pad, sensor=SensorOptions(noise=0, resolution=0, psf_sigma=0),
        press=PressOptions(stiffness=STIFFNESS, thickness=THICK, force=FORCE, wrist_stiffness=None),
    )  # fmt: skip
    press_letter(ball, [0, 0, 0], options)
    start, rounds = process_time(), 10
    for _ in range(rounds):
        felt = press_letter(ball, [0, 0, 0], options).ideal
    return felt.reshape(6, 6) * 1.9**2 / 1e3, (process_time() - start) / rounds


def main() -> None:
    """Print a row for each mesh and back."""
    rigid, seconds = springs()
    print(f"springs of {STIFFNESS:.0f} kPa/mm: highest taxel {rigid.max():.3f} N, sum {rigid.sum():.2f} N,")
    print(f"{1e3 * seconds:.1f} ms; loads in N")
    print(
        "back | vertices | tetrahedra | mm sunk | sum | highest taxel | worst taxel beside springs | steps | s"
    )
    for bends in (False, True):
        for along, deep in ((7, 3), (13, 4), (17, 5)):
            model = scene(along, deep, bends=bends)
            start = process_time()
            loads, depth, steps = press(model, SIDE / (along - 1))
            back, worst = "bends" if bends else "rigid", np.abs(loads - rigid).max()
            cells = [f"{back} | {model.nflexvert} | {model.nflexelem} | {depth:.2f} | {loads.sum():.3f}"]
            cells += [f"{loads.max():.3f} | {worst:.3f} | {steps} | {process_time() - start:.2f}"]
            print(" | ".join(cells), flush=True)


if __name__ == "__main__":
    main()
