"""Time an attached pad beside MuJoCo's own touch_grid plugin and tactile sensor.

    python tests/press/bench_attach.py

What they read is compared by `make referees`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from time import process_time

import mujoco
import numpy as np
from attached_scenes import rest

from tactsim import Pad

SIX = Pad(taxel_width=1.9, taxel_height=1.9, seam=None, unread_columns=0)
WIDE = Pad(
    rows=18, columns=41, pitch_x=1, pitch_y=1, taxel_width=1, taxel_height=1, seam=None, unread_columns=0
)
HAND = Path(__file__).parents[2] / "examples" / "hand" / "grasp.py"
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
          <asset><mesh name="plate" builtin="plate" params="6 6" scale="{half} {half} 0"/></asset>
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


def time_hand(rounds: int = 20, repeats: int = 5) -> None:
    """Time a reading of the five pads of the hand in examples/hand, and a step, while it holds each of its objects."""
    spec = importlib.util.spec_from_file_location("grasp", HAND)
    hand = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hand)
    for name in hand.OBJECTS:
        _, readers = hand.scene(name)
        for _, held, _ in hand.grasp(name, 2.0):
            data = held
        model, times = readers[0].model, np.full(2, np.inf)
        for _ in range(rounds):
            start = process_time()
            for _ in range(repeats):
                for reader in readers:
                    reader.read(data)
            read = process_time()
            for _ in range(repeats):
                mujoco.mj_step(model, data)
            times = np.minimum(times, [(read - start) / repeats, (process_time() - read) / repeats])
        print(f"five pads, {name}: read {times[0] * 1e3:.2f} ms, step {times[1] * 1e3:.2f} ms")


def main() -> None:
    """Print the table."""
    times = time_readings()
    for name, value in times.items():
        print(f"{name:<28}{value * 1e6:>10.0f} us{value / times['mj_step']:>8.1f}")
    time_hand()


if __name__ == "__main__":
    main()
