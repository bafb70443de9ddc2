"""Poses, angles and the placement error: far away, many turns round, and at the seams of the circle."""

from __future__ import annotations

import math

import numpy as np

from tactsim.bench.placement import Properties, certainty, fold_angle, placement_error
from tactsim.bench.stress.case import (
    Worst,
    case,
    every_estimator,
    few,
    fitted,
    hidden,
    pressed,
    probabilities,
)
from tactsim.core import compose, invert, transform, wrap_angle
from tactsim.estimators.estimator import Estimate, PoseSamples

TURN = 2 * math.pi


@case(
    "frames.there-and-back",
    varied="poses from 1e-5 to 1e5 mm away, up to 1e4 turns round",
    deviation="pose * its inverse from none, relative to the distance (mm, rad)",
    limit=1e-11,
    because="a turn of 1e4 rounds at 1e-11 rad; everything else at 1e-16",
)
def _there_and_back(worst: Worst) -> None:
    rng = np.random.default_rng(0)
    for decade in range(-5, 6):
        pose = rng.uniform(-1, 1, (2000, 3)) * (10.0**decade, 10.0**decade, TURN * 1e4)
        scale = np.maximum(1, np.hypot(pose[:, 0], pose[:, 1]))[:, None]
        for both in (compose(pose, invert(pose)), compose(invert(pose), pose)):
            worst.see(np.abs(both) / scale, f"1e{decade} mm")


@case(
    "frames.chain",
    varied="10,000 small steps round a circle",
    deviation="from the start after a whole turn, mm and rad",
    limit=1e-8,
    because="an angle rounds by 4e-16 rad a step, and the circle has a radius of 1,592 mm",
    quick=False,
)
def _chain(worst: Worst) -> None:
    pose = np.zeros(3)
    for _ in range(10_000):
        pose = compose(pose, [1.0, 0.0, TURN / 10_000])
    worst.see(np.abs(pose), "the last step")


@case(
    "frames.wrap",
    varied="angles at and beside every multiple of pi up to 1e6, subnormal ones, 1e15",
    deviation="rad outside [-pi, pi), or from the same direction",
    limit=2e-10,
    because="1e6 pi in doubles is 2e-10 rad from the true one; the range itself is exact",
)
def _wrap(worst: Worst) -> None:
    whole = np.concatenate([np.arange(-50, 51), [10**6, -(10**6)]]) * math.pi
    beside = np.concatenate([whole, np.nextafter(whole, np.inf), np.nextafter(whole, -np.inf)])
    small = np.array([0.0, -0.0, 5e-324, -5e-324, 1e-17, -1e-17])
    angles = np.concatenate([beside, small, small - math.pi, small + math.pi])
    folded = wrap_angle(angles)
    worst.see(np.abs(np.sin((folded - angles) / 2)), "the direction")
    for values in (folded, wrap_angle([1e15, -1e15, 1e300])):
        inside = (values >= -math.pi) & (values < math.pi)
        worst.see(np.where(inside, 0, 1), "the range")


@case(
    "frames.symmetric-objects",
    varied="symmetry of order 1 to 24 and a disc; the object turned by any of its symmetries",
    deviation="placement error of an object that looks the same, mm",
    limit=1e-9,
    because="the turns round at 1e-13 rad; an O turned by 2 rad is where it was",
)
def _symmetric_objects(worst: Worst) -> None:
    rng = np.random.default_rng(1)
    for order in range(25):
        of = Properties(order, (0.0, 0.0), 80.0)
        true = rng.uniform([-10, -10, -math.pi], [10, 10, math.pi], (500, 3))
        steps = rng.uniform(-50, 50, 500) if order == 0 else rng.integers(-50, 50, 500) * (TURN / order)
        object_in_robot = compose(invert(true), np.column_stack([np.zeros((500, 2)), steps]))
        worst.see(placement_error(invert(object_in_robot), true, of), f"order {order or 'infinite'}")
        worst.see(np.abs(fold_angle(steps, order)) * 1e-3, f"folding by order {order or 'infinite'}")


@case(
    "frames.angles-many-turns-away",
    varied="every sensor pose turned by up to a million whole turns, for every estimator",
    deviation="probability of a letter after each of 8 readings",
    limit=1e-6,
    because="1e6 turns round at 1e-9 rad, which moves a taxel by 1e-8 mm",
)
def _angles_many_turns_away(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 8)
    for name, budget in every_estimator():
        answers = []
        estimator = fitted(name, scan, **budget)
        for turns in (0, 1, -1000, 10**6):
            estimator.reset(np.random.default_rng(0))
            steps = []
            for reading, pose in zip(readings, poses + [0, 0, TURN * turns], strict=True):
                estimator.update(reading, pose)
                steps.append(probabilities(estimator.estimate()))
            answers.append(np.array(steps))
            worst.see(np.abs(answers[-1] - answers[0]), f"{name}, {turns:,} turns")


@case(
    "frames.regions",
    varied="Gaussian beliefs 1e-6 to 1e3 mm wide, of discs, about places up to 1e3 mm away, in 40,401 weighted poses",
    deviation="radius of the 90 % region from that of the Rayleigh distribution, credibility of a truth from its own",
    limit=0.02,
    because="the poses are a twentieth of the width apart",
)
def _regions(worst: Worst) -> None:
    steps = np.linspace(-5, 5, 201)
    x, y = (part.ravel() for part in np.meshgrid(steps, steps))
    weights = np.exp(-(x**2 + y**2) / 2)
    weights /= weights.sum()
    of = Properties(0, (0.0, 0.0), 80.0)
    for width in 10.0 ** np.arange(-6, 4):
        for away in (0.0, 1.0, 1e3):
            placed = np.column_stack([away + width * x, width * y, np.zeros(len(x))])
            estimate = Estimate(
                "O", {"O": 1.0}, np.array([-away, 0.0, 0.0]), PoseSamples(invert(placed), weights)
            )
            # Not on a pose of the grid, nor at the distance of one.
            truth = invert(np.array([away + 1.513 * width, 0.0, 0.0]))
            found = certainty(estimate, truth, of)
            at = f"{width:.0e} mm wide, {away:g} mm away"
            worst.see(abs(found.radius / (width * math.sqrt(-2 * math.log(0.1))) - 1), at)
            worst.see(abs(found.credibility - (1 - math.exp(-(1.513**2) / 2))), at)


@case(
    "frames.error-at-the-seam",
    varied="estimates that lie on the other side of 0 or pi from the truth",
    deviation="placement error from the rms displacement of the object's points, mm",
    limit=1e-9,
    because="both are sums of a few doubles; the mod that the paper prints is off by 17 mm",
)
def _error_at_the_seam(worst: Worst) -> None:
    gyration = 9.0
    points = gyration * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
    of = Properties(1, (0.0, 0.0), gyration**2)
    for seam in (0.0, math.pi, -math.pi, 3 * math.pi, 100 * TURN):
        for off in (1e-6, 0.05, 0.1, 1.5):
            true, estimated = np.array([3.0, -4.0, seam + off]), np.array([3.5, -4.2, seam - off])
            moved = transform(invert(estimated), points) - transform(invert(true), points)
            rms = math.sqrt((moved**2).sum(axis=-1).mean())
            worst.see(abs(float(placement_error(estimated, true, of)) - rms), f"{seam:.3g} +- {off} rad")
