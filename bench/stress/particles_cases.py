"""Particles, objects that are none of these, and objects that move: odd weights, priors, readings and steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tactsim.bench.stress.case import (
    Worst,
    after,
    case,
    draws,
    every_estimator,
    few,
    fitted,
    flaw,
    hidden,
    pressed,
    probabilities,
    see_sound,
)
from tactsim.core import compose, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.motion import parse_motion
from tactsim.estimators.filters.particle_kernels import PARZEN_STEP, draw, parzen_mode
from tactsim.estimators.registry import load


def drawing(budget: int) -> list[tuple[str, dict[str, Any]]]:
    """List the registered filters that draw, with this many particles and the paper's measurement model.

    Those that draw once a motion is seen follow one from the first reading.
    """
    found = []
    for name, options in every_estimator(budget):
        if draws(name):
            known = load(name).options_type.model_fields
            seen = "motion" in known and known["motion"].default == "seen"
            found.append((name, {**options, "likelihood": "paper", **({"motion": "auto"} if seen else {})}))
    return found


@case(
    "particles.all-weights-tiny",
    varied="gamma from 0.1 to 1e-300 under readings that fit nothing: weights down to exp(-20,000)",
    deviation="sum of the probabilities from 1",
    limit=1e-9,
    because="weights are kept in logs, relative to the heaviest, so not all of them can be zero",
)
def all_weights_tiny(worst: Worst) -> None:
    """Contradict every particle with every reading."""
    scan = pressed("AEI")
    rng = np.random.default_rng(0)
    for name, options in drawing(200):
        for gamma in (0.1, 1e-10, 1e-100, 1e-300):
            estimator = fitted(name, scan, gamma=gamma, **options)
            for _ in range(10):
                estimator.update(rng.choice([0.0, 60.0], 36), rng.uniform(-10, 10, 3))
                worst.see(flaw(estimator.estimate()), f"{name}, gamma {gamma}")


@case(
    "particles.resampling",
    varied="weights over 300 decades, equal ones, and all zero but one",
    deviation="share of draws from the weight's share, in standard deviations of the draw",
    limit=5.0,
    because="a draw is right on average; 5 standard deviations happen once in two million",
)
def resampling(worst: Worst) -> None:
    """Draw 200,000 times and count."""
    rng = np.random.default_rng(1)
    draws = 200_000
    for what, weight in {
        "equal": np.ones(50),
        "over 300 decades": 10.0 ** -np.linspace(0, 300, 50),
        "one alone, first": np.eye(50)[0],
        "one alone, last": np.eye(50)[-1],
        "all tiny": np.full(50, 1e-300),
        "one particle": np.ones(1),
    }.items():
        chosen = np.empty(draws, dtype=np.int64)
        draw(chosen, weight, rng.standard_exponential(draws + 1))
        share = weight / weight.sum()
        count = np.bincount(chosen, minlength=len(weight))
        spread = np.sqrt(draws * share * (1 - share)) + 1e-9 + (share > 0)
        worst.see(np.abs(count - draws * share) / spread, what)


@case(
    "particles.mode-of-the-density",
    varied="particles across the seam of the circle, weights over 30 decades, one to 200 of them",
    deviation="height of the highest node over that of the mode found, relative, by brute force",
    limit=1e-9,
    because="both add up the same cones; columns are left out only where their upper bound is lower",
)
def mode_of_the_density(worst: Worst) -> None:
    """Add up every particle's cone (eq. 10, 11) at every node of the grid."""
    rng = np.random.default_rng(2)
    turns = round(2 * math.pi / PARZEN_STEP[2])
    for trial in range(8):
        count = (1, 2, 30, 200)[trial % 4]
        seam = rng.choice([0.0, math.pi, -math.pi, 2 * math.pi, 7.0])
        state = np.stack([rng.uniform(-2, 2, count), rng.uniform(-2, 2, count), rng.normal(seam, 0.4, count)])
        weight = 10.0 ** -rng.uniform(0, rng.choice([0.5, 30]), count)
        found, _ = parzen_mode(state, weight)
        x, y, k = np.meshgrid(np.arange(-8, 9), np.arange(-8, 9), np.arange(turns), indexing="ij")
        nodes = np.stack([x.ravel(), y.ravel(), k.ravel()], axis=-1) * PARZEN_STEP
        worst.see(
            cones(nodes, state, weight).max() / cones(found[None], state, weight)[0] - 1, f"trial {trial}"
        )


def cones(nodes: FloatArray, state: FloatArray, weight: FloatArray) -> FloatArray:
    """Sum eq. 10 and 11, with rho 1, at nodes (n, 3)."""
    away = nodes[:, :, None] - state
    away[:, 2] = np.mod(away[:, 2] + math.pi, 2 * math.pi) - math.pi
    return np.maximum(0, 1 - np.sqrt((away**2).sum(axis=1))) @ weight


@case(
    "particles.same-seed",
    varied="the seed of the particles",
    deviation="answers that differ for one seed, or agree for two",
    limit=0,
    because="all randomness comes from the generator that reset is given",
)
def same_seed(worst: Worst) -> None:
    """Repeat a sequence with the same and with another seed."""
    scan = pressed("AEI")
    readings, poses, _ = hidden(scan, "E", 5)
    for name, options in drawing(200):
        estimator = fitted(name, scan, gamma=0.6, **options)
        answers = []
        for seed in (0, 0, 1):
            # The poses too: few particles may all be of one letter, whatever the seed.
            got = after(estimator, readings, poses, seed)
            samples = [] if got.samples is None else got.samples.poses.tolist()
            answers.append([probabilities(got).tolist(), got.robot_in_object.tolist(), samples])
        worst.holds(answers[0] == answers[1], f"{name}: two runs of one seed differ")
        worst.holds(answers[0] != answers[2], f"{name}: two seeds agree")


@case(
    "none.odd-readings",
    varied="prior of none 1e-12 to 1 - 1e-12; readings times 0 to 1e6, below 0, all alike",
    deviation="sum of the probabilities from 1, after each of 5 readings",
    limit=1e-9,
    because="odds are kept in logs, and every variance has a floor",
)
def odd_readings(worst: Worst) -> None:
    """Ask whether it is none of the letters, whatever is felt."""
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 5)
    for unknown in (1e-12, 0.5, 1 - 1e-12):
        estimator = fitted("refined", scan, bins=1000, unknown=unknown)
        for what, felt in (
            *((f"times {factor:g}", factor * readings) for factor in (0, 1e-3, 0.1, 10, 1e6)),
            ("below 0", -readings),
            ("all alike", np.full_like(readings, 40.0)),
        ):
            see_sound(worst, estimator, felt, poses, f"prior {unknown:g}, {what}")


@case(
    "motion.frames",
    varied="placements all over the plane, steps of 1e-9 to 10 mm and rad",
    deviation="mm between states and the same states turned into placements and back; or a step seen in another frame",
    limit=1e-9,
    because="a state and its placement are one pose and its inverse",
)
def frames(worst: Worst) -> None:
    """Turn states into placements and back, and take a step of the object in the robot's frame."""
    rng = np.random.default_rng(0)
    motion = parse_motion("0.5,0.03")
    assert motion is not None
    state = rng.uniform(-20, 20, (3, 500))
    state[2] = wrap_angle(state[2])
    again = motion.state(motion.placed(state))
    worst.see(np.abs(again[:2] - state[:2]), "there and back")
    worst.see(np.abs(wrap_angle(again[2] - state[2])), "there and back")
    for size in (1e-9, 1e-3, 10.0):
        step = rng.standard_normal(3) * size
        moved = motion.state(motion.placed(state) + step / [1, 1, motion.ratio])
        # Placements T_O^R compose with states T_R^O to nothing, before the step and after.
        nothing = compose((motion.placed(state) * [1, 1, motion.ratio]) + step, moved.T)
        worst.see(np.abs(nothing[:, :2]), f"steps of {size}")
