"""The engines against each other: over forces, stiffnesses, tilts and wrists, and at every glyph."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case
from tactsim.bench.stress.exact_readings import expected_reading
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions
from tactsim.press.engine import press_at
from tactsim.press.points import Points
from tactsim.press.scan_poses import random_poses
from tactsim.press.touches import Pressed, Touches

LEAST_AREA = 4.0  # mm^2, of a contact that is no sliver


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
    quick=True,
)
def balance(worst: Worst) -> None:
    """Press one letter with all that the options allow."""
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


@case(
    "engines.every-glyph",
    varied="all glyphs at 4 poses, level, and tilted by 0.25 degrees with a wrist of 300 N mm/rad",
    deviation="worst taxel of exact and collide from that of bed, relative to the peak",
    limit=0.1,
    because="collide samples an outline with 48 points a taxel; 95 % are within 3 %, and 10 % is no other shape",
)
def every_glyph(worst: Worst) -> None:
    """Press the whole catalogue by every engine for flat faces."""
    rng = np.random.default_rng(6)
    pad = ScanOptions().pad
    for name in models.names():
        letter = models.letter(name)
        poses = random_poses(rng, 4)
        areas = [expected_reading(letter.footprint, pose, pad)[1] for pose in poses]
        poses = poses[np.array(areas) >= LEAST_AREA]
        if not len(poses):
            continue
        tilted = Touches(letter, poses, 0.0044 * rng.standard_normal((len(poses), 2)))
        for touches, wrist in ((Touches.of(letter, poses), None), (tilted, 300.0)):
            _, want = pressed_by("bed", touches, wrist_stiffness=wrist)
            for engine in ("exact", "collide"):
                _, got = pressed_by(engine, touches, wrist_stiffness=wrist)
                worst.see(np.abs(got - want).max(axis=1) / want.max(axis=1), f"{name} by {engine}")
