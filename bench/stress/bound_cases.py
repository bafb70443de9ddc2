"""Stress cases of the bound, where the answer is known exactly."""

from __future__ import annotations

import numpy as np

from tactsim.bench.bound.cramer_rao import bound_mm, mean_length
from tactsim.bench.bound.exact_bayes import least_expected_error
from tactsim.bench.bound.pose_information import of_classes, of_pressures
from tactsim.bench.bound.response import Response
from tactsim.bench.placement import Properties, placement_error
from tactsim.bench.stress.case import Worst, case
from tactsim.core.poses import invert
from tactsim.press import SensorOptions


@case(
    "bound.mean-length",
    varied="Gaussians of one to three dimensions, of equal variances from 1e-12 to 1e12",
    deviation="their mean length from the closed form, relative",
    limit=1e-9,
    because="the trapezoid rule of an integral that is smooth and vanishes at both ends",
    quick=True,
)
def mean_lengths(worst: Worst) -> None:
    """Compare with sqrt(2 / pi), sqrt(pi / 2) and 2 sqrt(2 / pi) standard deviations."""
    closed = {1: np.sqrt(2 / np.pi), 2: np.sqrt(np.pi / 2), 3: 2 * np.sqrt(2 / np.pi)}
    for size, length in closed.items():
        for variance in 10.0 ** np.arange(-12, 13, 4):
            found = float(mean_length(np.full(size, variance)))
            worst.see(
                abs(found / (length * np.sqrt(variance)) - 1), f"{size} dimensions, variance {variance:g}"
            )


@case(
    "bound.gaussian-toy",
    varied="toys that are linear in pose and unknowns, noise from 1e-3 to 1e3 kPa",
    deviation="the bound from that of the closed form, relative",
    limit=1e-6,
    because="both are the inverse of one matrix, worked out in two ways",
    quick=True,
)
def gaussian_toy(worst: Worst) -> None:
    """Compare `of_pressures`, which takes the unknowns away last, with H' S^-1 H."""
    rng, of = np.random.default_rng(0), Properties(1, (0.0, 0.0), 50.0)
    for noise in 10.0 ** np.arange(-3, 4):
        slopes, unknown = rng.normal(size=(1, 8, 3)), rng.normal(size=(1, 8, 4))
        model = Response(np.zeros((1, 8)), noise * slopes, noise * unknown)
        found = of_pressures(model, np.zeros((1, 3)), SensorOptions(noise=noise, resolution=0.0))
        covariance = noise**2 * (np.eye(8) + unknown[0] @ unknown[0].T)
        closed = noise**2 * slopes[0].T @ np.linalg.inv(covariance) @ slopes[0]
        worst.see(abs(bound_mm(found[0], of) / bound_mm(closed, of) - 1), f"noise {noise:g} kPa")


@case(
    "bound.classes-below-pressures",
    varied="1,000 toys with pressures on both sides of eq. 3's limits, noise of 0.5 to 8 kPa",
    deviation="the most by which classes tell more than pressures in any direction, relative",
    limit=1e-9,
    because="classes are made of pressures",
)
def classes_below_pressures(worst: Worst) -> None:
    """Look at the least eigenvalue of the difference; the largest taxel is in contact whatever its noise."""
    rng = np.random.default_rng(0)
    for number in range(1000):
        noise, mean = rng.uniform(0.5, 8), rng.uniform(0, 40, (1, 6))
        mean[0, 0] = 150.0
        model = Response(mean, 10 * rng.normal(size=(1, 6, 3)), np.zeros((1, 6, 0)))
        sensor, pose = SensorOptions(noise=noise, resolution=0.0), np.zeros((1, 3))
        more = of_pressures(model, pose, sensor)
        left = np.linalg.eigvalsh(more - of_classes(model, pose, sensor, rng))[0]
        worst.see(-left[0] / np.abs(more).max(), f"toy {number}, noise {noise:.2g} kPa")


@case(
    "bound.least-expected-error",
    varied="weighted poses of objects with one-, two- and any-fold symmetry, spread over 0.01 to 10 mm",
    deviation="expected error at the pose found over that of the best of 2,000 others near it, less 1",
    limit=1e-3,
    because="the geometric median is where the mean distance is least; the search has ended then",
)
def least_errors(worst: Worst) -> None:
    """Compare Weiszfeld's answer with poses drawn around it."""
    rng = np.random.default_rng(0)
    for symmetry in (1, 2, 0):
        of = Properties(symmetry, (0.0, 0.0), 50.0)
        for spread in (0.01, 0.1, 1.0, 10.0):
            sizes = np.array([spread, spread, min(spread / 7, 0.5)])
            poses = invert(sizes * rng.standard_normal((300, 3)) + (3, -2, 1))
            weights = rng.dirichlet(np.ones(300))
            found = least_expected_error(poses, weights, of)
            others = invert(invert(found) + sizes * rng.standard_normal((2000, 3)) * 0.3)
            expected = placement_error(poses[:, None], np.vstack([found, others])[None], of).T @ weights
            worst.see(expected[0] / expected[1:].min() - 1, f"symmetry {symmetry}, spread {spread:g} mm")
