"""The press, at rest and through time, and the sensor: forces, stiffness and tilts over decades, odd pads.

How exact a press is, and by which engine, is a matter of `tests/press`.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, Literal, get_args, get_origin

import mujoco
import numpy as np
from pydantic.fields import FieldInfo

from tactsim import models
from tactsim.bench.stress.case import Worst, case, refused
from tactsim.core import Pad
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, SensorOptions, press_letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.collide import Points
from tactsim.press.dynamics import History, contact_history
from tactsim.press.engine import ideal_readings, press_at
from tactsim.press.scan_poses import grid_poses, random_poses
from tactsim.press.scene import Setup, scene
from tactsim.press.sensor import Unmix
from tactsim.press.touches import Pressed, Touches

FORCE = 2.0  # N


def exact_pad(**press: Any) -> ScanOptions:
    """Describe a pad without imperfections and a rigid wrist, with these options of the press."""
    rigid = PressOptions(**({"wrist_stiffness": None} | press))
    return ScanOptions(press=rigid, sensor=SensorOptions(noise=0, resolution=0))


def ideal(name: str, poses: FloatArray, options: ScanOptions) -> FloatArray:
    """Press a letter at poses (n, 3): (n, taxels) kPa."""
    tilt = options.press.tilt_x, options.press.tilt_y
    return ideal_readings(Touches.of(models.letter(name), np.atleast_2d(poses), tilt), options)[0]


@case(
    "press.force",
    varied="force from 1 uN to 10 kN, ten decades",
    deviation="reading over force, from that at 1 N, relative to the largest taxel",
    limit=1e-5,
    because="a press ends within 1e-6 of the balance of forces; the pressure is in proportion to the force",
)
def _force(worst: Worst) -> None:
    poses = grid_poses()[::12]
    unit = ideal("A", poses, exact_pad(force=1.0))
    for decade in range(-6, 5):
        got = ideal("A", poses, exact_pad(force=10.0**decade)) / 10.0**decade
        worst.see(np.abs(got - unit).max() / unit.max(), f"1e{decade} N")


@case(
    "press.empty",
    varied="a letter that just touches, just does not, and lies up to 1e9 mm away",
    deviation="kPa read where nothing touches, or not finite where something does",
    limit=0,
    because="no overlap is free fall, and F / 0 is no pressure",
)
def _empty(worst: Worst) -> None:
    options = exact_pad()
    left = models.letter("I").footprint.bounds()[0]
    edge = left - options.pad.load_bounds[1]
    for gap in (0.0, 1e-15, 1e-12, 1e-9, 1e-3, 1.0, 1e3, 1e6, 9.9e8):
        for angle in (0.0, math.pi):
            turned = edge - gap if angle == 0 else -edge + gap
            reading = ideal("I", np.array([turned, 0.0, angle]), options)
            worst.see(0 if gap < 1e-9 and np.isfinite(reading).all() else np.abs(reading), f"{gap} mm away")


@case(
    "press.order-of-presses",
    varied="presses forwards, backwards and each alone",
    deviation="kPa between the same press done after others",
    limit=1e-12,
    because="a press is reset whole, the solver's warm start included; only BLAS sums in another order",
)
def _order_of_presses(worst: Worst) -> None:
    options = exact_pad()
    poses = np.concatenate([grid_poses()[::16], random_poses(np.random.default_rng(1), 12)])
    together = ideal("A", poses, options)
    worst.see(np.abs(ideal("A", poses[::-1], options)[::-1] - together), "backwards")
    for index, pose in enumerate(poses):
        worst.see(np.abs(ideal("A", pose, options)[0] - together[index]), f"press {index} alone")


@case(
    "press.pads",
    varied="pads of 1 to 400 taxels, 0.05 to 100 mm apart, with and without a seam",
    deviation="force on the taxels over the force of the press, beyond 1; 1 for a reading that is not finite",
    limit=1e-6,
    because="taxels share the force with the gaps and the rim, so they carry at most all of it",
)
def _pads(worst: Worst) -> None:
    sizes = (
        (1, 1, 0.05), (1, 1, 100.0), (1, 2, 10.0), (2, 1, 1.9), (5, 5, 100.0), (20, 20, 0.05),
        (20, 20, 2.0),
    )  # fmt: skip
    for rows, columns, pitch in sizes:
        taxel = 0.9 * pitch
        pad = Pad(
            rows=rows, columns=columns, pitch_x=pitch, pitch_y=pitch, taxel_width=taxel, taxel_height=taxel,
            seam=None, unread_columns=0,
        )  # fmt: skip
        for sigma in (0.0, 1.0):
            sensor = SensorOptions(noise=0, resolution=0, psf_sigma=sigma)
            options = exact_pad().model_copy(update={"pad": pad, "sensor": sensor})
            reading = ideal("E", np.array([-4.0, 1.0, 0.4]), options)
            felt = reading.sum() * taxel**2 / 1e3
            worst.see(max(0.0, felt / FORCE - 1), f"{rows} x {columns}, {pitch} mm, sigma {sigma}")


def refused_sensor(**options: Any) -> bool:
    """Tell whether the command line would refuse these options of the sensor in one line."""
    from tactsim.bench.config import scan_options

    return refused(scan_options, scan_set={"sensor": options})


def ends(option: FieldInfo) -> list[Any]:
    """List the bounds of an option that may be reached, or the words that it takes."""
    sides = [(limit, side) for limit in option.metadata for side in ("ge", "le")]
    bounds = [getattr(limit, side) for limit, side in sides if hasattr(limit, side)]
    return bounds or list(get_args(option.annotation) if get_origin(option.annotation) is Literal else ())


@case(
    "press.sensor",
    varied="every option of the sensor at its bounds, some together",
    deviation="readings that are not finite, above saturation, off the steps or alive though dead",
    limit=0,
    because="what a sensor reports is a number it can report",
)
def _sensor(worst: Worst) -> None:
    letter, pose = models.letter("E"), [1.0, 2.0, 0.3]
    settings: list[dict[str, Any]] = [
        {name: end} for name, field in SensorOptions.model_fields.items() for end in ends(field)
    ]
    settings += [
        {"saturation": 5.0}, {"saturation": 1e-9}, {"resolution": 1e-6}, {"lag": 0.999},
        {"ghosting": "floating", "unmix": False, "leakage": 1e-3}, {"ghosting": "floating", "resolution": 0.0},
        {"response": 5.0, "response_pressure": 1e6}, {"dead_taxels": tuple(range(36))}, {"dead_taxels": (0, 35)},
        {"psf_sigma": 10.0, "saturation": 1.0, "resolution": 0.3},
    ]  # fmt: skip
    for setting in settings:
        options = exact_pad().model_copy(update={"sensor": SensorOptions(**setting)})
        for force in (1e-6, 2.0, 1e4):
            pressed = options.model_copy(update={"press": exact_pad(force=force).press})
            reading = press_letter(letter, pose, pressed, np.random.default_rng(0)).reading
            sound = np.isfinite(reading).all() and (reading[list(options.sensor.dead_taxels)] == 0).all()
            step = options.sensor.resolution
            if options.sensor.saturation is not None:
                sound = sound and reading.max() <= options.sensor.saturation + step / 2
            if step >= 0.1 and not Unmix.acts(options.sensor):
                steps = reading / step
                off = np.abs(steps - np.round(steps)) - 1e-15 * np.abs(steps)  # within a number's digits
                sound = sound and off.max() < 1e-9
            worst.holds(sound, f"{setting}, {force:g} N")
    for bad in ({"resolution": 1e-320}, {"noise": math.inf}, {"saturation": 0}, {"dead_taxels": [36]}):
        worst.holds(refused_sensor(**bad), f"{bad} is taken")


@case(
    "press.tilt",
    varied="rigid and giving tilt to 0.2 rad, hinges of 1 to 1e7 N mm/rad, 0.01 to 100 N, slivers",
    deviation="force on a bed from the force of the press, relative; or no sentence that it does not settle",
    limit=1e-4,
    because="a press balances its force or is refused: a load outside the contact has no equilibrium",
    quick=False,
)
def _tilt(worst: Worst) -> None:
    wide = Pad(
        rows=20, columns=20, unread_rows=0, unread_columns=0, seam=None, taxel_width=1.9, taxel_height=1.9
    )
    poses = [np.array([0.0, 0.0, 0.4]), np.array([-9.0, 4.0, 1.0]), np.array([-13.9, 0.0, 0.0])]
    for tilt_x, tilt_y in ((1e-9, 0.0), (1e-3, -1e-3), (0.2, 0.0), (-0.2, 0.2)):
        for stiffness in (None, 1.0, 1e3, 1e7):
            for force in (0.01, 2.0, 100.0):
                press = PressOptions(force=force, tilt_x=tilt_x, tilt_y=tilt_y, wrist_stiffness=stiffness)
                options = ScanOptions(pad=wide, press=press, sensor=SensorOptions(noise=0, psf_sigma=0))
                for pose in poses:
                    where = f"tilt {tilt_x}, {tilt_y}, hinges {stiffness}, {force} N at {pose.tolist()}"
                    if refused(ideal, "E", pose, options):
                        worst.holds(True, where)
                        continue
                    found = ideal("E", pose, options)
                    worst.see(abs(found.sum() * 1.9**2 / 1e3 / force - 1) if found.any() else 0.0, where)


def pressed_by(engine: str, touches: Touches, **press: Any) -> tuple[Pressed, FloatArray]:
    """Press by an engine: what it gives, and its readings (n, taxels) kPa."""
    options = ScanOptions(press=PressOptions(**({"engine": engine, "wrist_stiffness": None} | press)))
    pressed = press_at(touches, options)
    return pressed, pressed.readings(options)


@case(
    "engines.balance",
    varied="collide: 1 uN to 10 kN, 1 to 1e6 kPa/mm, tilts of 0 to 0.2 rad, wrists of 1 to 1e7 N mm/rad and rigid",
    deviation="force on the points from the force of the press, relative; 1 for a blank without a reason",
    limit=1e-6,
    because="a press balances its force within 1e-6, whatever its stiffness, or is a blank",
)
def _points_balance(worst: Worst) -> None:
    letter, poses = models.letter("E"), np.array([[1.0, 2.0, 0.3]])
    ranges = [{"force": 10.0**decade} for decade in range(-6, 5)]
    ranges += [{"stiffness": 10.0**decade} for decade in range(7)]
    for tilt in (0.0, 1e-9, 0.0044, 0.2):
        touches = Touches.of(letter, poses, (tilt, -tilt / 2))
        for press in ranges:
            for wrist in (None, 1.0, 300.0, 1e7):
                where = f"{press}, tilt {tilt}, wrist {wrist}"
                pressed, reading = pressed_by("collide", touches, wrist_stiffness=wrist, **press)
                force = press.get("force", 2.0)
                assert isinstance(pressed.load, Points)
                if pressed.blanks:
                    worst.holds(all(pressed.blanks.values()) and not reading.any(), where)
                else:
                    worst.see(abs(pressed.load.force.sum() / force - 1), where)


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
def _mass_stiffness_step(worst: Worst) -> None:
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
def _force_control(worst: Worst) -> None:
    grid = itertools.product((0.01, 0.1, 1.0, 10.0), (10.0, 1e3, 1e5), (0.05, 2.0, 100.0))
    settings: list[dict[str, float]] = [
        {"moving_mass": mass, "stiffness": stiffness, "force": force} for mass, stiffness, force in grid
    ]
    settings += [{"moving_mass": m, "tilt_x": 0.004, "wrist_stiffness": 300.0} for m in (0.01, 0.1, 1, 10)]
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
def _through_time(worst: Worst) -> None:
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


@case(
    "press.parts",
    varied="the convex parts of every letter and digit",
    deviation="their areas' sum from the footprint's area, relative",
    limit=1e-9,
    because="a cell under two overlapping parts would count twice; corners lie on a grid of 1e-8 mm",
)
def _parts(worst: Worst) -> None:
    for name in models.names():
        letter = models.letter(name)
        total = sum(
            abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2
            for x, y in (part.outline.T for part in letter.parts)
        )
        worst.see(abs(total / letter.area - 1), name)
