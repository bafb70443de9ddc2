"""The press in MuJoCo and the sensor: forces, stiffness, mass and steps over decades, slivers, odd pads."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case, refused
from tactsim.bench.stress.exact_readings import expected_reading, overlap
from tactsim.core import Pad
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, SensorOptions, press_letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_poses import grid_poses, random_poses
from tactsim.press.scene import Setup, scene
from tactsim.press.touches import Touches

FORCE = 2.0  # N


def exact_pad(**press: Any) -> ScanOptions:
    """Describe a pad without imperfections and a rigid wrist, with these options of the press."""
    rigid = PressOptions(**({"wrist_stiffness": None} | press))
    return ScanOptions(press=rigid, sensor=SensorOptions(noise=0, resolution=0))


def ideal(name: str, poses: FloatArray, options: ScanOptions) -> FloatArray:
    """Press a letter at poses (n, 3): (n, taxels) kPa."""
    tilt = options.press.tilt_x, options.press.tilt_y
    return ideal_readings(Touches.of(models.letter(name), np.atleast_2d(poses), tilt), options)[0]


def error(name: str, pose: FloatArray, options: ScanOptions, force: float = FORCE) -> float:
    """Compare a press with the exact reading: the worst taxel, relative to the contact pressure."""
    footprint, pad = models.letter(name).footprint, options.pad
    exact, area = expected_reading(footprint, pose, pad, force, options.sensor.psf_sigma)
    got = ideal(name, pose, options)[0]
    return float(np.abs(got - exact).max() / (1e3 * force / area)) if area > 0 else float(np.abs(got).max())


@case(
    "press.force",
    varied="force from 1 uN to 10 kN, ten decades",
    deviation="reading over force, from that at 1 N, relative to the largest taxel",
    limit=1e-5,
    because="a press ends within 1e-6 of the balance of forces; the pressure is in proportion to the force",
    quick=True,
)
def force(worst: Worst) -> None:
    """Press the same letter harder and harder."""
    poses = grid_poses()[::12]
    unit = ideal("A", poses, exact_pad(force=1.0))
    for decade in range(-6, 5):
        got = ideal("A", poses, exact_pad(force=10.0**decade)) / 10.0**decade
        worst.see(np.abs(got - unit).max() / unit.max(), f"1e{decade} N")


@case(
    "press.mass-stiffness-step",
    varied="mass, stiffness and time step, each over ten decades, under 2 N",
    deviation="contact forces at rest from the share of area, relative; 1 for a force that is not finite",
    limit=1e-5,
    because="springs taken at the end of a step are stable at any step, and rest does not depend on mass",
    quick=True,
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
        stage = scene(Setup(mass=mass), len(springs.share))
        stage.place_letter(pose[0], np.zeros(2))  # a scene keeps the tilt of the press before
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
    "press.slivers",
    varied="overlap from 1e-5 mm to 3 mm wide, at a letter's side and at its corner",
    deviation="worst taxel from the exact reading, relative to the largest taxel",
    limit=0.15,
    because="a response is quadratic over each cell, which a point load in a cell's corner strains most",
    quick=True,
)
def slivers(worst: Worst) -> None:
    """Press with so little of the letter that the pressure runs into megapascals."""
    options = exact_pad()
    footprint = models.letter("I").footprint
    left, bottom, _, _ = footprint.bounds()
    right, top = options.pad.load_bounds[1], options.pad.load_bounds[3]
    for width in 10.0 ** np.linspace(-5, 0.5, 23):
        for pose in (
            np.array([left - right + width, 0.3, 0.0]),
            np.array([left - right + width, bottom - top + width, 0.0]),
        ):
            exact, _ = expected_reading(footprint, pose, options.pad, FORCE, 1.0)
            got = ideal("I", pose, options)[0]
            worst.see(np.abs(got - exact).max() / (exact.max() or 1.0), f"{width:.1e} mm wide, {pose}")


@case(
    "press.empty",
    varied="a letter that just touches, just does not, and lies up to 1e9 mm away",
    deviation="kPa read where nothing touches, or not finite where something does",
    limit=0,
    because="no overlap is free fall, and F / 0 is no pressure",
    quick=True,
)
def empty(worst: Worst) -> None:
    """Press beside the letter."""
    options = exact_pad()
    left = models.letter("I").footprint.bounds()[0]
    edge = left - options.pad.load_bounds[1]
    for gap in (0.0, 1e-15, 1e-12, 1e-9, 1e-3, 1.0, 1e3, 1e6, 9.9e8):
        for angle in (0.0, math.pi):
            turned = edge - gap if angle == 0 else -edge + gap
            reading = ideal("I", np.array([turned, 0.0, angle]), options)
            worst.see(0 if gap < 1e-9 and np.isfinite(reading).all() else np.abs(reading), f"{gap} mm away")


@case(
    "press.aligned-angles",
    varied="angles at and within 1e-15 to 1e-3 rad of 0, 90, 180 and 270 degrees",
    deviation="worst taxel from the exact reading, relative to the contact pressure",
    limit=0.02,
    because="regular grids are worst where an outline lies along them; the clip is exact there too",
    quick=True,
)
def aligned_angles(worst: Worst) -> None:
    """Press where outlines and grid lines are parallel, or nearly so."""
    options = exact_pad()
    for quarter in range(4):
        for off in (0.0, 1e-15, -1e-15, 1e-12, -1e-9, 1e-6, -1e-3):
            for name, x, y in (("E", 1.0, -2.0), ("I", 0.35, 0.0), ("H", 2.25, 3.4)):
                angle = quarter * math.pi / 2 + off
                worst.see(error(name, np.array([x, y, angle]), options), f"{name}, {angle!r} rad")


@case(
    "press.every-letter",
    varied="every letter and digit at 12 poses off the grid",
    deviation="worst taxel from the exact reading, relative to the contact pressure",
    limit=0.02,
    because="2 % of the contact pressure is what a press may be off",
)
def every_letter(worst: Worst) -> None:
    """Press the whole catalogue."""
    options = exact_pad()
    poses = random_poses(np.random.default_rng(0), 12)
    for name in models.names():
        for pose in poses:
            if overlap(models.letter(name).footprint, pose, options.pad).area() > 4.0:
                worst.see(error(name, pose, options), f"{name} at {pose.round(2).tolist()}")


@case(
    "press.order-of-presses",
    varied="presses forwards, backwards and each alone",
    deviation="kPa between the same press done after others",
    limit=1e-12,
    because="a press is reset whole, the solver's warm start included; only BLAS sums in another order",
    quick=True,
)
def order_of_presses(worst: Worst) -> None:
    """Press in another order: what a solver remembers would show."""
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
    quick=True,
)
def pads(worst: Worst) -> None:
    """Press pads from a pin's head to a table."""
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


@case(
    "press.point-spread",
    varied="point spread of 0, 0.3, 1, 3 and 10 mm; below 0.3 mm",
    deviation="worst taxel from the exact reading, relative to the contact pressure",
    limit=0.02,
    because="2 % of the contact pressure is what a press may be off; what is finer than the cells is refused",
    quick=True,
)
def point_spread(worst: Worst) -> None:
    """Spread the pressure by next to nothing, and over the whole pad."""
    for sigma in (0.3, 0.5, 1.0, 3.0, 10.0):
        sensor = SensorOptions(noise=0, resolution=0, psf_sigma=sigma)
        options = exact_pad().model_copy(update={"sensor": sensor})
        for pose in random_poses(np.random.default_rng(2), 12):
            worst.see(error("S", pose, options), f"sigma {sigma}, {pose.round(2).tolist()}")
    for sigma in (1e-300, 1e-3, 0.29, -1.0, math.nan, math.inf):
        worst.holds(refused_sensor(psf_sigma=sigma), f"sigma {sigma} is taken")


def refused_sensor(**options: Any) -> bool:
    """Tell whether the command line would refuse these options of the sensor in one line."""
    from tactsim.bench.config import scan_options

    return refused(scan_options, scan_set={"sensor": options})


@case(
    "press.sensor",
    varied="saturation, resolution, gain, drift, lag, hysteresis, noise and dead taxels at their bounds",
    deviation="readings that are not finite, above saturation, off the steps or alive though dead",
    limit=0,
    because="what a sensor reports is a number it can report",
    quick=True,
)
def sensor(worst: Worst) -> None:
    """Read with sensors at the end of every scale."""
    letter, pose = models.letter("E"), [1.0, 2.0, 0.3]
    settings: list[dict[str, Any]] = [
        {"saturation": 5.0}, {"saturation": 1e-9}, {"resolution": 1000.0}, {"resolution": 1e-6},
        {"gain_spread": 1.0}, {"drift": 100.0}, {"drift": -100.0}, {"noise": 1000.0},
        {"lag": 0.999}, {"hysteresis": 0.25},
        {"ghosting": "floating", "unmix": False, "leakage": 1e-3}, {"ghosting": "floating", "resolution": 0.0},
        {"random_taxels": 1.0}, {"dead_taxels": tuple(range(36))}, {"dead_taxels": (0, 35)},
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
            if step >= 0.1:
                steps = reading / step
                sound = sound and np.abs(steps - np.round(steps)).max() < 1e-9
            worst.holds(sound, f"{setting}, {force:g} N")
    for bad in ({"resolution": 1e-320}, {"noise": math.inf}, {"saturation": 0}, {"dead_taxels": [36]}):
        worst.holds(refused_sensor(**bad), f"{bad} is taken")


@case(
    "press.tilt",
    varied="rigid and giving tilt to 0.2 rad, hinges of 1 to 1e7 N mm/rad, 0.01 to 100 N, slivers",
    deviation="force on a bed from the force of the press, relative; or no sentence that it does not settle",
    limit=1e-4,
    because="a press balances its force or is refused: a load outside the contact has no equilibrium",
)
def tilt(worst: Worst) -> None:
    """Tilt the letter until it stands on a corner, and let it give way."""
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
                    found: list[FloatArray] = []
                    if refused(lambda: found.append(ideal("E", pose, options))):  # noqa: B023
                        worst.holds(True, where)
                        continue
                    felt = found[0].sum() * 1.9**2 / 1e3
                    worst.see(abs(felt / force - 1) if found[0].any() else 0.0, where)


@case(
    "press.parts",
    varied="the convex parts of every letter and digit",
    deviation="their areas' sum from the footprint's area, relative",
    limit=1e-9,
    because="a cell under two overlapping parts would count twice; corners lie on a grid of 1e-8 mm",
    quick=True,
)
def parts(worst: Worst) -> None:
    """Add up convex parts: they tile the letter without gap or overlap."""
    for name in models.names():
        letter = models.letter(name)
        total = sum(
            abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2
            for x, y in (part.outline.T for part in letter.parts)
        )
        worst.see(abs(total / letter.area - 1), name)
