"""Elastic foundations: layers from a film to a half-space, balance over decades, and the error's order in cells."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from tactsim import models
from tactsim.bench.stress.case import Worst, case
from tactsim.core import Pad
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, SensorOptions
from tactsim.press.bed import Bed, Level, lay_bed, levels
from tactsim.press.clip import edges_of
from tactsim.press.elastic import Rested, modulus, press_elastic
from tactsim.press.scan_poses import random_poses

SOLIDS = ("layer", "half-space")


def press_on(
    face: list[Level], poses: FloatArray, tilt: tuple[float, float], **options: Any
) -> tuple[Bed, Rested, PressOptions]:
    """Press a face at poses (n, 3) with one tilt, on the foundation that the options state."""
    setup = ScanOptions(
        pad=Pad(),
        press=PressOptions(**({"wrist_stiffness": None} | options)),
        sensor=SensorOptions(psf_sigma=2.0, noise=0, resolution=0),
    )
    bed = lay_bed(face, poses, *setup.cell_lines)
    return bed, press_elastic(bed, np.tile(tilt, (len(poses), 1)), setup), setup.press


@case(
    "foundations.balance",
    varied="1 uN to 10 kN, layers of 1 um to 100 mm, nu 0 to 0.49, 1 to 1e6 kPa/mm, tilts, wrists, slivers",
    deviation="forces under a face from the force of the press, relative; 1 for a pressure that pulls",
    limit=1e-6,
    because="force and hinges are solved for together with the pressures",
    quick=True,
)
def balance(worst: Worst) -> None:
    """Press from a breath to a truck, on a film and on a mattress."""
    letter, usual = models.letter("K"), PressOptions(wrist_stiffness=None)
    half = float(np.concatenate(letter.contours)[:, 0].max())
    left = Pad().load_bounds[0]
    poses = np.concatenate([random_poses(np.random.default_rng(5), 3), [[half - left - 1e-5, 0.0, 0.0]]])
    settings: list[dict[str, Any]] = [{"force": 10.0**decade} for decade in range(-6, 5)]
    settings += [{"thickness": 10.0**decade} for decade in range(-3, 3)]
    settings += [{"stiffness": 10.0**decade} for decade in range(7)]
    settings += [{"poisson": poisson} for poisson in (0.0, 0.3, 0.49)]
    settings += [{"wrist_stiffness": wrist} for wrist in (1.0, 1e3, 1e7)]
    face = levels(letter, usual)
    for foundation, setting, tilt in itertools.product(SOLIDS, settings, ((0.0, 0.0), (0.2, -0.1))):
        bed, rested, press = press_on(face, poses, tilt, foundation=foundation, **setting)
        where = f"{foundation}, {setting}, tilt {tilt}"
        worst.holds(bool((rested.pressure >= 0).all()), where)
        total = np.bincount(bed.press, rested.pressure * bed.area, len(poses))
        pressed = [index for index in np.unique(bed.press).tolist() if index not in rested.blanks]
        worst.see(np.abs(total[pressed] / press.force - 1), where)


@case(
    "foundations.film",
    varied="a layer of nu 0.3 from 0.1 mm to 1 um thick",
    deviation="depth of a letter from that on springs of the same stiffness, relative",
    limit=0.03,
    because="a thin compressible layer is a bed of springs, but for some thicknesses along the outline",
    quick=True,
)
def film(worst: Worst) -> None:
    """Press on thinner and thinner layers."""
    face, pose = levels(models.letter("E"), PressOptions()), np.array([[1.0, -2.0, 0.4]])
    for thickness in (0.1, 0.01, 1e-3):
        bed, rested, press = press_on(
            face, pose, (0.0, 0.0), foundation="layer", thickness=thickness, poisson=0.3
        )
        area = float(bed.area.sum())
        springs = press.force / (1e-3 * press.stiffness_over(area) * area)
        worst.see(rested.depth / springs - 1, f"{thickness} mm")
        worst.see(1 - rested.depth / springs, f"{thickness} mm")


@case(
    "foundations.cells",
    varied="1, 2, 4 and 8 cells along a taxel, a round punch of 5 mm on a half-space",
    deviation="slope of the error of its depth against F / (2 E* a) over the cell's size",
    limit=0.8,
    because="the pressure is infinite at the edge, so even pressures in cells converge with their size",
    at_least=True,
)
def cells(worst: Worst) -> None:
    """Press Boussinesq's punch."""
    angle = 2 * np.pi * np.arange(720) / 720
    face = [Level(edges_of([5.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)]))]
    counts, errors = (1, 2, 4, 8), []
    for count in counts:
        bed, rested, press = press_on(
            face, np.array([[0.3, 0.2, 0.1]]), (0.0, 0.0), foundation="half-space", cells_per_taxel=count
        )
        expected = press.force / (2 * modulus(press, float(bed.area.sum())) * 5.0)
        errors.append(abs(float(rested.depth[0]) / expected - 1))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    worst.see(slope, f"errors {', '.join(f'{error:.2g}' for error in errors)}")
