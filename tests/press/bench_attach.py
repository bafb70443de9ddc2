"""Compare an attached pad with MuJoCo's own touch_grid plugin and tactile sensor, and time all three.

    python tests/press/bench_attach.py

The same presses of a ball, a roll and a block against the mean pressure on each taxel, in closed form; no point
spread, which MuJoCo's sensors do not have. Theirs are scaled to the true sum, so that only the pattern counts.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import mujoco
import numpy as np
from attached_scenes import ball, block, image, rest, roll
from scipy.spatial.transform import Rotation

import tactsim
from tactsim import Pad

SIX = Pad(taxel_width=1.9, taxel_height=1.9, seam=None, unread_columns=0)
WIDE = Pad(
    rows=18, columns=41, pitch_x=1, pitch_y=1, taxel_width=1, taxel_height=1, seam=None, unread_columns=0
)
FACE = 0.005  # m, height of the finger's face
FAR = 1.0  # m from touch_grid's site to the face, so that its equal angles are equal lengths


def scene(body: str, x: float, y: float, height: float, sensor: str = "") -> mujoco.MjModel:
    """Compile a body above a finger, mm, with one of MuJoCo's sensors on it or none."""
    half = 1.9e-3 * 3
    angle = np.degrees(np.arctan(half / FAR))  # touch_grid counts from the middle to the side
    sensors = {
        "": "",
        "touch_grid": f"""<plugin name="felt" plugin="mujoco.sensor.touch_grid" objtype="site" objname="eye">
            <config key="size" value="6 6"/><config key="fov" value="{angle} {angle}"/>
            <config key="gamma" value="0"/><config key="nchannel" value="1"/></plugin>""",
        "tactile": '<tactile name="felt" geom="skin" mesh="plate"/>',
    }
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.001"/>
          <extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
          <asset><mesh name="plate" builtin="plate" params="6 6" scale="{half} {half} 0.001"/></asset>
          <worldbody>
            <body><geom name="finger" type="box" size="0.02 0.02 {FACE}"/>
              <geom name="skin" type="mesh" mesh="plate" contype="0" conaffinity="0" mass="0" pos="0 0 {FACE}"
                    quat="0 1 0 0"/>
              <site name="eye" pos="0 0 {FACE - FAR}" quat="0 1 0 0"/></body>
            <body pos="{x / 1e3} {y / 1e3} {height / 1e3 + FACE}"><joint type="slide" axis="0 0 1"/>
              <geom {body} mass="0.2"/></body>
          </worldbody>
          <sensor>{sensors[sensor]}</sensor></mujoco>""")


def settle(model: mujoco.MjModel, steps: int = 1000) -> mujoco.MjData:
    """Step a model until its body rests."""
    data = mujoco.MjData(model)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return data


def presses(count: int, rng: np.random.Generator) -> list[tuple[str, float, float, float, Callable]]:
    """Draw presses of three bodies: MJCF, x, y, height, and what gives the pressure for a force."""
    drawn = []
    for _ in range(count):
        x, y, angle = *rng.uniform(-2, 2, 2), rng.uniform(0, np.pi)
        upright = f'quat="{np.cos(angle / 2)} 0 0 {np.sin(angle / 2)}"'
        lying = " ".join(map(str, Rotation.from_euler("xz", [np.pi / 2, angle]).as_quat(scalar_first=True)))
        drawn += [
            ('type="sphere" size=".01"', x, y, 10.1, lambda f, x=x, y=y: ball(f, 10, x, y)),
            (
                f'type="cylinder" size=".006 .004" quat="{lying}"',
                x,
                y,
                6.1,
                lambda f, x=x, y=y, angle=angle: roll(f, 6, 4, angle, x, y),
            ),
            (
                f'type="box" size=".003 .002 .004" {upright}',
                x,
                y,
                4.1,
                lambda f, x=x, y=y, angle=angle: block(f, 3, 2, angle, x, y),
            ),
        ]
    return drawn


def compare(count: int = 12) -> dict[str, np.ndarray]:
    """Measure each way to feel on random presses: (3 bodies, correlation | rms error over the peak | p95 over it)."""
    found: dict[str, list] = {"attached pad": [], "tactile": [], "touch_grid": []}
    for body, x, y, height, pressure in presses(count, np.random.default_rng(0)):
        model = scene(body, x, y, height)
        data = settle(model)
        reading = tactsim.press.attach(model, "finger", SIX, psf_sigma=0).bind(model).read(data)
        truth = image(SIX, pressure(reading.force), sigma=1e-4)
        felt = {"attached pad": reading.kpa}
        for sensor in ("tactile", "touch_grid"):
            raw = settle(scene(body, x, y, height, sensor)).sensor("felt").data[:36]
            felt[sensor] = by_place(sensor, raw) * truth.sum() / max(raw.sum(), 1e-300)
        for name, kpa in felt.items():
            off = (kpa - truth) / truth.max()
            alike = np.corrcoef(kpa, truth)[0, 1] if kpa.any() else 0.0
            found[name].append((alike, np.sqrt((off**2).mean()), np.percentile(np.abs(off), 95)))
    return {name: np.array(rows).reshape(count, 3, 3).mean(axis=0) for name, rows in found.items()}


def by_place(sensor: str, values: np.ndarray) -> np.ndarray:
    """Put a sensor's values in the order of the pad's taxels, by where each of them lies."""
    if sensor == "touch_grid":
        return values.reshape(6, 6)[TOUCH_GRID].ravel()
    model = scene('type="sphere" size=".01"', 0, 0, 10)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = model.geom("skin").id
    places = (model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])[:, :2] * 1e3
    distance = ((SIX.taxel_xy[:, None] - places) ** 2).sum(axis=2)
    assert distance.min(axis=1).max() < 1e-6
    return values[distance.argmin(axis=1)]


TOUCH_GRID = (slice(None, None, -1), slice(None))  # its rows run along -y: its site looks along +z


def time_readings(rounds: int = 7, steps: int = 60) -> dict[str, float]:
    """Time a step with each sensor, and one of an attached pad beyond it: seconds of CPU, the least of the rounds.

    A block of four contacts on 36 taxels, and one as large as the array on 738.
    """
    body = 'type="box" size=".003 .002 .004"'
    ways: dict[str, Callable[[], object]] = {}
    for name, sensor in (
        ("mj_step", ""),
        ("mj_step, tactile", "tactile"),
        ("mj_step, touch_grid", "touch_grid"),
    ):
        model = scene(body, 1, 0, 4.1, sensor)
        data = settle(model)
        ways[name] = lambda model=model, data=data: mujoco.mj_step(model, data)
    for name, pad, size in (("36 taxels", SIX, ".003 .002"), ("738 taxels", WIDE, ".015 .008")):
        for kind in (f'type="box" size="{size} .004"', 'type="sphere" size=".01"'):
            reader, data, _ = rest(kind, pad, height=10.1, face="0.03 0.03 0.005")
            ways[f"read, {name}, {kind[6:].partition(chr(34))[0]}"] = lambda r=reader, d=data: r.read(d)
    times = dict.fromkeys(ways, np.inf)
    for _ in range(rounds):
        for name, way in ways.items():
            start = process_time()
            for _ in range(steps):
                way()
            times[name] = min(times[name], (process_time() - start) / steps)
    return times


def main() -> None:
    """Print both tables."""
    print("correlation, rms and 95th percentile of the errors / peak")
    print(f"{'':<14}" + "".join(f"{name:>24}" for name in ("ball", "roll", "block")))
    for name, rows in compare().items():
        print(f"{name:<14}" + "".join(f"{a:>10.3f}{100 * b:>6.1f} %{100 * c:>5.1f} %" for a, b, c in rows))
    times = time_readings()
    for name, value in times.items():
        print(f"{name:<28}{value * 1e6:>10.0f} us{value / times['mj_step']:>8.1f}")


if __name__ == "__main__":
    main()
