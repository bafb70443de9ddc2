"""Presses through time: force control over decades of mass, stiffness and force, and shorter and shorter steps."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case, refused
from tactsim.bench.stress.convergence_cases import slope
from tactsim.bench.stress.press_cases import exact_pad, ideal
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, press_letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.dynamics import History, contact_history
from tactsim.press.touches import Touches


def follow(**press: Any) -> History:
    """Press E through time without the sensor."""
    options = ScanOptions(press=PressOptions(**({"dynamics": "full", "wrist_stiffness": None} | press)))
    tilt = (options.press.tilt_x, options.press.tilt_y)
    touches = Touches.of(models.letter("E"), np.array([[1.0, 2.0, 0.3]]), tilt)
    bed = lay_bed(levels(touches.letter, options.press), touches.poses, *options.cell_lines)
    return contact_history(bed, touches, 0, options)


@case(
    "dynamics.force-control",
    varied="masses of 10 g to 10 kg, stiffness of 10 to 1e5 kPa/mm, 0.05 to 100 N, all together, and tilt on hinges",
    deviation="most by which the force exceeds the set force, as its share, with three steps; or 1 where the "
    "three peaks differ by over 5 %, or the force takes over 1 s to settle",
    limit=0.1,
    because="overshoot of 10 % is what force control may have; peaks that hang on the step hide an impact",
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
        traces = [follow(time_step=share, **setting).trace for share in (1.0, 0.5, 0.25)]
        worst.see([trace.overshoot for trace in traces], str(setting))
        peaks = [float(trace.force.max()) for trace in traces]
        worst.holds(max(peaks) <= 1.05 * min(peaks), f"{setting}: peaks {peaks}")
        worst.holds(all(trace.settle_time < 1 for trace in traces), f"{setting}: settles late")


@case(
    "dynamics.rest",
    varied="full dynamics: mass 1e-3 to 100 kg, stiffness 1 to 1e6 kPa/mm, 1 uN to 10 kN, no damping to much",
    deviation="reading from the equilibrium's, relative to its largest taxel, where it settles",
    limit=5e-3,
    because="0.5 % is what full dynamics may be off; what does not settle is refused",
)
def through_time(worst: Worst) -> None:
    """Step presses through time, from a fly's to a hammer's."""
    pose = np.array([1.0, 2.0, 0.3])
    rest = ideal("E", pose, exact_pad(force=1.0))[0]
    settings: list[dict[str, float]] = [{"moving_mass": mass} for mass in (1e-3, 0.01, 1.0, 10.0, 100.0)]
    settings += [{"stiffness": 10.0**decade} for decade in range(7)]
    settings += [{"force": 10.0**decade} for decade in range(-6, 5)]
    settings += [{"dissipation": value} for value in (0.0, 1e-3, 1.0, 10.0)]
    settings += [{"approach_speed": 1000.0}, {"approach_speed": 0.5}, {"clearance": 10.0}, {"ramp": 0.0}]
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


@case(
    "dynamics.time-steps",
    varied="time steps of 1, 1/2, 1/4 and 1/8 of those chosen, for light, usual and heavy carriages, against 1/100",
    deviation="slope of the largest error of the contact force, at any image, over the step",
    limit=0.8,
    because="steps are implicit and of first order",
    at_least=True,
)
def time_steps(worst: Worst) -> None:
    """Press through time with shorter and shorter steps."""
    shares = (1.0, 0.5, 0.25, 0.125)
    for mass, stiffness in ((0.01, 1e5), (0.1, 1e3), (10.0, 1e3)):
        runs = [follow(moving_mass=mass, stiffness=stiffness, time_step=share) for share in (*shares, 0.01)]
        until = min(len(run.times) for run in runs) - 1
        totals = [run.forces[:until].sum(axis=1) for run in runs]
        errors = [float(np.abs(total - totals[-1]).max()) for total in totals[:-1]]
        worst.see(
            slope(shares, errors),
            f"{mass:g} kg on {stiffness:g} kPa/mm: {', '.join(f'{error:.2g} N' for error in errors)}",
        )
