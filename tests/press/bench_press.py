"""Print what a press costs and how exact it is: every engine, and plain MuJoCo scenes of the same bed, in one run.

    python tests/press/bench_press.py

CPU time of one core, scenes and tables built before, the median of rounds in which all rows take turns. Times
hold for one machine; their ratios to `exact` hold more widely. Errors are those of the worst taxel of each
press that touches 4 mm^2 or more, 95 % of which are below the figure: in kPa, in % of the reading's peak, and
in % of the contact pressure F / A. A row is a function that `row` marks; it returns a `Row`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import numpy as np
from bench_attach import time_readings
from plain_press import DEFAULT, TUNED, compile_plain, press_plain
from test_elastic import compare, solid
from test_relief import POSES as BALL_POSES
from test_relief import brute_force, dome, sphere_gap

from tactsim import models
from tactsim.bench.stress.exact_readings import expected_reading
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, scan_letters
from tactsim.press.bed import lay_bed, levels
from tactsim.press.engine import press_at
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import grid_poses
from tactsim.press.spread import Patches
from tactsim.press.touches import Touches

LETTERS = "AEIOU"
LEAST_AREA = 4.0  # mm^2
FEW = slice(5, None, 37)  # of the grid's poses, for what takes long
WHOLE = Skips(parts=False, cells=False, no_contact=False)
COVERED = Skips(parts=False)
TILT, WRIST = 0.0044, 300.0  # rad (0.25 degrees) and N mm/rad


@dataclass(frozen=True, eq=False)
class Row:
    """One way to press. run() does `presses` presses. errors: (n, 3) kPa, of peak, of F / A. counted: in words."""

    name: str
    run: Callable[[], object]
    presses: int
    errors: FloatArray
    counted: str


ROWS: list[Callable[[], Row]] = []


def row(make: Callable[[], Row]) -> Callable[[], Row]:
    """Mark a function that makes a row of the table."""
    ROWS.append(make)
    return make


def level(engine: str = "auto", **press: object) -> ScanOptions:
    """Describe presses that stay level, without sensor's imperfections."""
    return ScanOptions(placement_tilt=0.0, press=PressOptions(engine=engine, wrist_stiffness=None, **press))


def touching(name: str, poses: FloatArray) -> FloatArray:
    """Keep the poses at which a letter touches the pad."""
    options = level()
    bed = lay_bed(levels(models.letter(name), options.press), poses, *options.cell_lines)
    return poses[np.diff(bed.start) > 0]


def errors_of(name: str, poses: FloatArray, readings: FloatArray, options: ScanOptions) -> FloatArray:
    """Compare level presses with the exact clip of the whole footprint: (presses, 3), see `Row`."""
    found = []
    for pose, reading in zip(poses, readings, strict=True):
        expected, area = expected_reading(
            models.letter(name).footprint, pose, options.pad, options.press.force, options.sensor.psf_sigma
        )
        if area >= LEAST_AREA:
            worst = np.abs(reading - expected).max()
            found.append((worst, worst / expected.max(), worst / (1e3 * options.press.force / area)))
    return np.array(found)


def of_engine(name: str, options: ScanOptions, counted: str) -> Row:
    """Make the row of an engine, from outlines to readings."""
    every = [Touches.of(models.letter(letter), touching(letter, grid_poses())) for letter in LETTERS]

    def run() -> list[FloatArray]:
        return [press_at(touches, options).readings(options) for touches in every]

    errors = [
        errors_of(one.letter.name, one.poses, got, options) for one, got in zip(every, run(), strict=True)
    ]
    return Row(name, run, sum(map(len, every)), np.concatenate(errors), counted)


@row
def exact() -> Row:
    """Level presses without a solver."""
    return of_engine("exact", level("exact"), "an exact clip; no solver")


@row
def bed() -> Row:
    """Level presses on a bed of springs."""
    return of_engine("bed", level("bed"), "an exact clip; 1 step over the covered cells")


@row
def collide() -> Row:
    """Level presses by MuJoCo's own collision detection."""
    return of_engine("collide", level("collide"), "1 step over the points that MuJoCo finds to touch")


def of_tilted(engine: str, counted: str) -> Row:
    """Make the row of an engine that presses letters which are tilted and give way."""
    fine = ScanOptions(press=PressOptions(engine="bed", wrist_stiffness=WRIST, cells_per_taxel=8))
    options = ScanOptions(press=PressOptions(engine=engine, wrist_stiffness=WRIST))
    rng = np.random.default_rng(0)
    every = []
    for letter in LETTERS:
        poses = touching(letter, grid_poses())
        every.append(Touches(models.letter(letter), poses, TILT * rng.standard_normal((len(poses), 2))))

    def run() -> list[FloatArray]:
        return [press_at(touches, options).readings(options) for touches in every]

    errors = []
    for touches, got in zip(every, run(), strict=True):
        expected = press_at(touches, fine).readings(fine)
        for pose, reading, right in zip(touches.poses, got, expected, strict=True):
            _, area = expected_reading(touches.letter.footprint, pose, options.pad)
            if area >= LEAST_AREA and right.any():
                worst = np.abs(reading - right).max()
                errors.append((worst, worst / right.max(), worst / (1e3 * options.press.force / area)))
    return Row(f"{engine}, tilted", run, sum(map(len, every)), np.array(errors), counted)


@row
def exact_tilted() -> Row:
    """Presses tilted by 0.25 degrees (sd) that a wrist lets give way, against a bed of 8 cells a taxel side."""
    return of_tilted("exact", "clips and Newton steps in closed form")


@row
def bed_tilted() -> Row:
    """The same presses, balanced by MuJoCo."""
    return of_tilted("bed", "clips and Newton steps until forces and moments balance")


@row
def collide_tilted() -> Row:
    """The same presses by MuJoCo's own collision detection."""
    return of_tilted("collide", "1 step; the solver finds what lets go")


def of_plain(name: str, skips: Skips, constant: float) -> Row:
    """Make the row of a plain scene that steps until nothing moves."""
    options = level("bed", skip=skips)
    scenes, beds = [], []
    for letter in map(models.letter, LETTERS):
        poses = touching(letter.name, grid_poses()[FEW])
        plain = lay_bed(levels(letter, options.press), poses, *options.cell_lines, skip_empty=skips.cells)
        beds.append((letter.name, poses, plain))
        scenes += [
            (compile_plain(letter, pose, springs, constant), len(springs.share), options.press.force)
            for pose, springs in zip(poses, plain.springs, strict=True)
        ]

    def run() -> list[tuple[FloatArray, int]]:
        return [press_plain(*scene) for scene in scenes]

    done = run()
    steps = np.mean([count for _, count in done])
    forces = iter(force for force, _ in done)
    errors = []
    for letter, poses, plain in beds:
        force = np.concatenate([next(forces) for _ in poses])
        pressure = np.divide(force, plain.area, out=np.zeros_like(force), where=plain.area > 0)
        errors.append(errors_of(letter, poses, Patches(plain, pressure).readings(options), options))
    return Row(name, run, len(scenes), np.concatenate(errors), f"{steps:.0f} steps; the bed is given to it")


@row
def plain_tuned() -> Row:
    """A plain scene whose contacts settle as fast as MuJoCo's default step allows."""
    return of_plain("plain scene, tuned", WHOLE, TUNED)


@row
def plain_default() -> Row:
    """A plain scene with MuJoCo's defaults."""
    return of_plain("plain scene, default", WHOLE, DEFAULT)


@row
def plain_tuned_covered() -> Row:
    """A tuned plain scene that is given the covered cells alone."""
    return of_plain("plain scene, tuned, covered cells", COVERED, TUNED)


def of_shares(name: str, run: Callable[[], object], presses: int, shares: FloatArray, counted: str) -> Row:
    """Make a row whose errors are known relative to the peak alone: `shares` (n,)."""
    errors = np.full((len(shares), 3), np.nan)
    errors[:, 1] = shares
    return Row(name, run, presses, errors, counted)


def of_solid(foundation: str) -> Row:
    """Make the row of an elastic foundation, against an FFT on a grid of 0.1 mm."""
    options = solid(foundation, wrist_stiffness=None)
    every = [Touches.of(models.letter(letter), touching(letter, grid_poses())) for letter in LETTERS]

    def run() -> list[FloatArray]:
        return [press_at(touches, options).readings(options) for touches in every]

    shares = np.concatenate([compare(letter, grid_poses()[5::48], options)[:, 1] for letter in LETTERS])
    return of_shares(foundation, run, sum(map(len, every)), shares, "an influence matrix; a Cholesky solve")


@row
def layer() -> Row:
    """A bonded elastic layer of 1 mm instead of springs."""
    return of_solid("layer")


@row
def half_space() -> Row:
    """An elastic half-space instead of springs."""
    return of_solid("half-space")


@row
def sphere() -> Row:
    """A ball of 10 mm pressed as a shape with relief, against springs 0.02 mm apart under the closed form."""
    options = level()
    solid_of, reach = dome(10.0, 0.3, rings=20, sectors=64)
    touches = Touches.of(models.relief("ball", solid_of), np.tile(BALL_POSES, (12, 1)))

    def run() -> FloatArray:
        return press_at(touches, options).readings(options)

    shares = []
    for pose, reading in zip(BALL_POSES, run(), strict=False):
        expected, _ = brute_force(sphere_gap(10.0, reach), pose, options.press.force)
        shares.append(np.abs(reading - expected).max() / expected.max())
    return of_shares("relief, a sphere", run, len(touches), np.array(shares), "integrals over the facets")


@row
def through_time() -> Row:
    """Presses under force control, stepped through time, against the same presses at rest."""
    options, still = level(dynamics="full"), level("bed")
    every = [Touches.of(models.letter(letter), touching(letter, grid_poses()[FEW])) for letter in LETTERS]

    def run() -> list[FloatArray]:
        return [press_at(touches, options).readings(options) for touches in every]

    shares = [
        np.abs(moved - rest).max(axis=1) / rest.max(axis=1)
        for moved, rest in zip(
            run(), (press_at(touches, still).readings(still) for touches in every), strict=True
        )
    ]
    presses = sum(map(len, every))
    return of_shares(
        "full dynamics", run, presses, np.concatenate(shares), "steps of force control until it rests"
    )


def time_rows(rows: list[Row], rounds: int = 5) -> dict[str, float]:
    """Time every row: seconds of CPU per press, the median of rounds taken in turns."""
    times = {one.name: np.zeros(rounds) for one in rows}
    for index in range(rounds):
        for one in rows:
            start = process_time()
            one.run()
            times[one.name][index] = (process_time() - start) / one.presses
    return {name: float(np.median(values)) for name, values in times.items()}


def time_scan() -> float:
    """Time the training and test readings of the vowels, 1,920 level presses, without cache: seconds of CPU."""
    options = level()
    scan_letters(options.model_copy(update={"letters": ("A",)}), cache=False)
    start = process_time()
    scan_letters(options, cache=False)
    return process_time() - start


def main() -> None:
    """Print the table."""
    rows = [make() for make in ROWS]
    seconds = time_rows(rows)
    print(
        "| | us a press | / exact | worst taxel, kPa | of peak | of F / A | counted |\n|---|---|---|---|---|---|---|"
    )
    for one in rows:
        kpa, peak, contact = np.percentile(one.errors, 95, axis=0)
        took = seconds[one.name]
        cells = [f"{kpa:.2g}", f"{100 * peak:.2g} %", f"{100 * contact:.2g} %"]
        shown = " | ".join("" if "nan" in cell else cell for cell in cells)
        print(
            f"| {one.name} | {took * 1e6:,.0f} | {took / seconds['exact']:,.1f} | {shown} | {one.counted} |"
        )
    print(f"\n1,920 level presses of five letters, with sensing and noise: {time_scan():.3f} s of CPU")
    print("\n| attached pad, CPU | us | / exact |\n|---|---|---|")
    for name, took in time_readings().items():
        print(f"| {name} | {took * 1e6:,.0f} | {took / seconds['exact']:,.1f} |")


if __name__ == "__main__":
    main()
