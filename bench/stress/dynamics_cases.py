"""Presses through time: springs, force control and rest over decades of mass, stiffness, force and time step."""

from __future__ import annotations

import itertools
import math
from typing import Any

import mujoco
import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case, refused
from tactsim.bench.stress.press_cases import FORCE, exact_pad, ideal
from tactsim.core import Pad
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, press_letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.dynamics import History, contact_history
from tactsim.press.scene import Setup, scene
from tactsim.press.touches import Touches


def follow(step_share: float, **press: Any) -> History:
    """Press E through time without the sensor."""
    options = ScanOptions(press=PressOptions(**({"dynamics": "full", "wrist_stiffness": None} | press)))
    tilt = (options.press.tilt_x, options.press.tilt_y)
    touches = Touches.of(models.letter("E"), np.array([[1.0, 2.0, 0.3]]), tilt)
    bed = lay_bed(levels(touches.letter, options.press), touches.poses, *options.cell_lines)
    return contact_history(bed, touches, 0, options, step_share=step_share)


@case(
    "dynamics.mass-stiffness-step",
    varied="mass, stiffness and time step, each over ten decades, under 2 N",
    deviation="contact forces at rest from the share of area, relative; 1 for a force that is not finite",
    limit=1e-5,
    because="springs taken at the end of a step are stable at any step, and rest does not depend on mass",
)
def mass_stiffness_step(worst: Worst) -> None:
    """Step the scene itself: a default MuJoCo contact would let a light letter fall through."""
    pose = np.array([[1.0, 2.0, 0.3]])
    letter, press = models.letter("E"), PressOptions()
    bed = lay_bed(levels(letter, press), pose, *Pad().grid_lines(2))
    (springs,) = bed.springs
    wanted = FORCE * bed.area / bed.area.sum()
    usual = (0.01, 1e5, 1e-2)  # kg, N/m per mm^2, s
    settings = [
        tuple(value * (10.0**decade if k == which else 1) for k, value in enumerate(usual))
        for which in range(3)
        for decade in range(-5, 6)
    ]
    for mass, stiffness, step in settings:
        stage = scene(Setup(mass=mass), len(springs.share), np.zeros(2))
        # Damped as strongly as the spring and the mass ask for, so that it comes to rest.
        natural = math.sqrt(mass / (stiffness * springs.area))
        stage.set_springs(springs, stiffness, step=step, relaxation=2 * natural)
        stage.reset(1.5 * FORCE / (stiffness * springs.area))
        stage.data.qfrc_applied[0] = FORCE
        where = f"{mass:.0e} kg, {stiffness:.0e} N/m/mm^2, {step:.0e} s"
        longest = max(20, math.ceil(20 * natural / step))
        for _ in range(min(longest, 3000)):
            mujoco.mj_step(stage.model, stage.data)
            if not np.isfinite(stage.data.qpos).all() or stage.data.qvel[0] ** 2 > 1e6 * (1 + FORCE / mass):
                worst.see(1.0, where)
        if longest <= 3000:  # with fewer it is only asked to stay finite
            worst.see(np.abs(stage.forces(len(wanted)) - wanted).max() / FORCE, where)


@case(
    "dynamics.force-control",
    varied="masses of 10 g to 10 kg, stiffness of 10 to 1e5 kPa/mm, 0.05 to 100 N, all together, and tilt on hinges",
    deviation="most by which the force exceeds the set force, as its share, with three steps; or 1 where the "
    "three peaks differ by over 5 %, or the force takes over 1 s to settle",
    limit=0.1,
    because="overshoot of 10 % is what force control may have; peaks that hang on the step hide an impact",
    quick=False,
)
def force_control(worst: Worst) -> None:
    """Press with a light and a heavy hand, on foam and on stone."""
    grid = itertools.product((0.01, 0.1, 1.0, 10.0), (10.0, 1e3, 1e5), (0.05, 2.0, 100.0))
    settings: list[dict[str, float]] = [
        {"moving_mass": mass, "stiffness": stiffness, "force": force} for mass, stiffness, force in grid
    ]
    settings += [
        {"moving_mass": m, "tilt_x": 0.004, "wrist_stiffness": 300.0} for m in (0.01, 0.1, 1.0, 10.0)
    ]
    for setting in settings:
        traces = [follow(share, **setting).trace for share in (1.0, 0.5, 0.25)]
        worst.see([trace.overshoot for trace in traces], str(setting))
        peaks = [float(trace.force.max()) for trace in traces]
        worst.holds(max(peaks) <= 1.05 * min(peaks), f"{setting}: peaks {peaks}")
        worst.holds(all(trace.settle_time < 1 for trace in traces), f"{setting}: settles late")


@case(
    "dynamics.rest",
    varied="full dynamics: mass 1e-3 to 100 kg, stiffness 1 to 1e6 kPa/mm, 1 uN to 10 kN, speeds, no ramp",
    deviation="reading from the equilibrium's, relative to its largest taxel, where it settles",
    limit=5e-3,
    because="0.5 % is what full dynamics may be off; what does not settle is refused",
    quick=False,
)
def through_time(worst: Worst) -> None:
    """Step presses through time, from a fly's to a hammer's."""
    pose = np.array([1.0, 2.0, 0.3])
    rest = ideal("E", pose, exact_pad(force=1.0))[0]
    settings: list[dict[str, float]] = [{"moving_mass": mass} for mass in (1e-3, 0.01, 1.0, 10.0, 100.0)]
    settings += [{"stiffness": 10.0**decade} for decade in range(7)]
    settings += [{"force": 10.0**decade} for decade in range(-6, 5)]
    settings += [{"approach_speed": 1000.0}, {"approach_speed": 0.5}, {"ramp": 0.0}]
    settled = 0
    for setting in settings:
        options = exact_pad(dynamics="full", time_limit=2.0, **setting)
        found: list[FloatArray] = []
        if refused(lambda: found.append(press_letter(models.letter("E"), pose, options).ideal)):  # noqa: B023
            continue
        settled += 1
        force = options.press.force
        worst.see(np.abs(found[0] / force - rest).max() / rest.max(), str(setting))
    worst.holds(settled >= len(settings) / 2, f"only {settled} of {len(settings)} settle")
