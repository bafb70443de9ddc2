"""Orders of convergence: how fast an error falls as bins and cells get finer, measured as a slope."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tactsim.bench.placement import placement_error, properties
from tactsim.bench.stress.case import Worst, case
from tactsim.bench.stress.case_data import few, fitted, hidden, pressed, probabilities
from tactsim.bench.stress.likelihood_cases import exact_log_p, one_state
from tactsim.bench.stress.maps_cases import exact_log_odds
from tactsim.bench.stress.press_cases import error
from tactsim.core import transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import classify
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.press import PressOptions, ScanOptions, SensorOptions
from tactsim.press.scan_poses import random_poses


def slope(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """Fit the power p of error = c * size^p (least squares in logs)."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def rms(values: FloatArray) -> float:
    """Give the root of the mean square."""
    return math.sqrt(float(np.mean(np.square(values))))


@case(
    "convergence.map-cells",
    varied="map cells of 0.4, 0.2, 0.1 and 0.05 mm",
    deviation="slope of the rms error of interpolated log-odds over the cell's size",
    limit=1.9,
    because="bilinear interpolation of a smooth function is of second order",
    quick=True,
    at_least=True,
)
def map_cells(worst: Worst) -> None:
    """Compare interpolated log-odds with the exact sum at points between the cells."""
    scan = few(pressed("E"))
    at = np.random.default_rng(0).uniform(-10, 10, (300, 2))
    exact = exact_log_odds(scan, "E", at, 1.0, 0.9, 0.2)
    cells = (0.4, 0.2, 0.1, 0.05)
    errors = [rms(learn_maps(scan, cell=cell)["E"].log_odds_at(at) - exact) for cell in cells]
    worst.see(slope(cells, errors), f"rms errors {', '.join(f'{error:.2g}' for error in errors)}")


@case(
    "convergence.table-cells",
    varied="cells of 0.8, 0.4, 0.2 and 0.1 mm in maps and likelihood tables",
    deviation="slope of the rms error of log p(A) / p(E) after one reading over the cell's size",
    limit=1.7,
    because="second order again, but for log p's bends between No Contact and In Contact",
    at_least=True,
)
def table_cells(worst: Worst) -> None:
    """Compare a one-bin filter with eq. 4 to 7 evaluated at the taxels themselves."""
    scan = few(pressed("AE"), 32)
    test = scan.where("test")
    cells = (0.8, 0.4, 0.2, 0.1)
    exact = []
    for reading, pose in zip(test.readings, test.poses, strict=True):
        at = transform(pose, scan.taxel_xy)
        log_p = [
            math.fsum(
                exact_log_p(kind, odds, 0.6, 0.2)
                for kind, odds in zip(
                    classify(reading), exact_log_odds(scan, label, at, 1.0, 0.9, 0.2), strict=True
                )
            )
            for label in "AE"
        ]
        exact.append(log_p[0] - log_p[1])
    errors = []
    for cell in cells:
        one = one_state(scan, cell=cell, gamma=0.6)
        got = []
        for reading, pose in zip(test.readings, test.poses, strict=True):
            one.reset(np.random.default_rng(0))
            one.update(reading, pose)
            p = one.estimate().probabilities
            got.append(math.log(p["A"] / p["E"]))
        errors.append(rms(np.array(got) - np.array(exact)))
    worst.see(slope(cells, errors), f"rms errors {', '.join(f'{error:.2g}' for error in errors)}")


@case(
    "convergence.bins-in-probability",
    varied="10 x 10 x 8, 20 x 20 x 16 and 40 x 40 x 32 bins against 160 x 160 x 128",
    deviation="slope of the rms error of p(letter) after one reading over the bin's size",
    limit=1.5,
    because="eq. 14 sums over bins, the midpoint rule: second order once a bin is finer than the belief's peaks",
    at_least=True,
)
def bins_in_probability(worst: Worst) -> None:
    """Compare the letters' probabilities with those of a grid so fine that it counts as exact."""
    scan = pressed("AEI")
    trials = [hidden(scan, label, 1, seed=seed) for label in scan.letters for seed in range(8)]
    splits = [(10, 8), (20, 16), (40, 32), (160, 128)]
    answers = []
    for side, turns in splits:
        estimator = fitted("histogram", scan, split=f"{side}x{side}x{turns}", gamma=0.9, cell=0.25)
        found = []
        for readings, poses, _ in trials:
            estimator.reset(np.random.default_rng(0))
            estimator.update(readings[0], poses[0])
            found.append(probabilities(estimator.estimate()))
        answers.append(np.array(found))
    errors = [rms(answer - answers[-1]) for answer in answers[:-1]]
    worst.see(
        slope([1 / side for side, _ in splits[:-1]], errors),
        f"rms errors {', '.join(f'{error:.2g}' for error in errors)}",
    )


@case(
    "convergence.bins-in-placement",
    varied="8 x 8 x 8, 16 x 16 x 16 and 32 x 32 x 32 bins, 15 readings without noise",
    deviation="slope of the mean placement error over the bin's size",
    limit=0.8,
    because="the mode is at best the middle of the bin that holds the truth: first order",
    at_least=True,
)
def bins_in_placement(worst: Worst) -> None:
    """Find hidden letters with finer and finer bins."""
    scan = pressed("AE", "ideal")
    objects = properties(scan)
    sides = (8, 16, 32)
    errors = []
    for side in sides:
        estimator = fitted("histogram", scan, split=f"{side}x{side}x{side}")
        found = []
        for label in scan.letters:
            for seed in range(24):
                readings, poses, truth = hidden(scan, label, 15, seed=seed)
                estimator.reset(np.random.default_rng(0))
                for reading, pose in zip(readings, poses, strict=True):
                    estimator.update(reading, pose)
                estimate = estimator.estimate()
                found.append(float(placement_error(estimate.robot_in_object, truth, objects[label])))
        errors.append(float(np.mean(found)))
    worst.see(
        slope([1 / side for side in sides], errors),
        f"mean errors {', '.join(f'{error:.2g} mm' for error in errors)}",
    )


@case(
    "convergence.bed-cells",
    varied="1, 2, 4 and 8 cells of the bed along a taxel, 12 presses of a curved letter, point spread 2 mm",
    deviation="slope of the rms error of the worst taxel over the cell's size",
    limit=3.0,
    because="the clip is exact, and what a taxel feels is quadratic in each cell: third order at least",
    quick=True,
    at_least=True,
)
def bed_cells(worst: Worst) -> None:
    """Compare presses with the exact reading."""
    poses = random_poses(np.random.default_rng(3), 12)
    counts = (1, 2, 4, 8)
    errors = []
    for count in counts:
        options = ScanOptions(
            press=PressOptions(wrist_stiffness=None, cells_per_taxel=count),
            sensor=SensorOptions(noise=0, resolution=0, psf_sigma=2.0),
        )
        errors.append(rms(np.array([error("S", pose, options) for pose in poses])))
    worst.see(
        slope([1 / count for count in counts], errors),
        f"rms errors {', '.join(f'{error:.2g}' for error in errors)}",
    )


@case(
    "convergence.collide-points",
    varied="12, 24, 48, 96 and 192 points of the pad's lattice a taxel, 24 presses of three letters",
    deviation="slope of the rms error of the worst taxel over the distance of the points",
    limit=1.25,
    because="n points sample an outline with n^-1/2 in a row and the rows' errors cancel like noise: n^-3/4, order 1.5",
    at_least=True,
)
def collide_points(worst: Worst) -> None:
    """Compare MuJoCo's own collision detection with the exact reading."""
    poses = random_poses(np.random.default_rng(3), 24)
    counts = (12, 24, 48, 96, 192)
    errors = []
    for count in counts:
        options = ScanOptions(
            press=PressOptions(engine="collide", wrist_stiffness=None, points_per_taxel=count),
            sensor=SensorOptions(noise=0, resolution=0),
        )
        errors.append(rms(np.array([error(name, pose, options) for name in "AES" for pose in poses])))
    worst.see(
        slope([count**-0.5 for count in counts], errors),
        f"rms errors {', '.join(f'{error:.2g}' for error in errors)}",
    )
