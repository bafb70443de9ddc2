"""Beliefs: very long and very odd sequences, budgets of one, odd weights, none of these, objects that move."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tactsim.bench.placement import placement_error, properties
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
    refused,
    see_sound,
)
from tactsim.bench.stress.maps_cases import (
    exact_log_p_of_letters,
    on_the_lattice,
    one_state,
    straight_readings,
)
from tactsim.core import compose, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.motion import parse_motion
from tactsim.estimators.filters.particle_kernels import PARZEN_STEP, draw, parzen_mode
from tactsim.estimators.filters.trust_kernels import influence
from tactsim.estimators.registry import load
from tactsim.models import names

LONG = 10_000
_FEWER = 300


def exact_estimators() -> list[tuple[str, dict[str, object]]]:
    """List the estimators whose belief depends on the set of readings alone: no sampling, no search.

    With gamma = 0.9 a belief stays soft for some readings, so that a difference shows.
    """
    return [
        ("histogram", {"bins": 1000, "gamma": 0.9, "skip": True}),
        ("histogram", {"bins": 1000, "gamma": 0.9, "skip": False}),
        ("refined", {"bins": 1000, "cells": 50, "halvings": 2}),
        ("force-mosaic", {"bins": 1000, "cells": 50, "halvings": 2}),
    ]


@case(
    "filters.10,000-readings",
    varied="10,000 readings in a row, with fresh noise, for every estimator",
    deviation="sum of the probabilities from 1; 1 for a wrong letter (but of particles), at every decade",
    limit=1e-9,
    because="probabilities are made from differences of logs, which do not drift",
    quick=False,
)
def _ten_thousand_readings(worst: Worst) -> None:
    scan = pressed("AEI")
    rng = np.random.default_rng(2)
    readings, poses, _ = hidden(scan, "E", 192)
    for name, budget in every_estimator(budget=300):
        estimator = fitted(name, scan, **budget)
        for count in range(1, LONG + 1):
            which = rng.integers(len(readings))
            estimator.update(readings[which] + rng.normal(0, 0.5, 36), poses[which])
            if count in (10, 100, 1000, 3000, LONG):
                estimate = estimator.estimate()
                worst.see(flaw(estimate), f"{name}, {count:,} readings")
                if not draws(name):  # 300 particles may well lose a letter at the first reading
                    worst.holds(estimate.label == "E", f"{name} says {estimate.label} after {count:,}")


@case(
    "filters.one-reading-10,000-times",
    varied="one reading repeated 1 to 10,000 times, 300 where all are pressed anew, for every estimator",
    deviation="sum of the probabilities from 1; 1 if the mode moves (histogram)",
    limit=1e-9,
    because="n times a log-likelihood has its maximum where one has it",
    quick=False,
)
def _one_reading_many_times(worst: Worst) -> None:
    scan = pressed("E")
    readings, poses, _ = hidden(scan, "E", 1, seed=3)
    for name, budget in every_estimator(budget=300):
        estimator = fitted(name, scan, **budget)
        estimator.update(readings[0], poses[0])
        first = estimator.estimate().robot_in_object
        # A mode keeps moving in the valley that one reading leaves, and each time a forward model predicts all of
        # the readings so far: 10,000 would be 50 million of them for each mode.
        longest = _FEWER if load(name).uses_forward_model else LONG
        for count in range(2, longest + 1):
            estimator.update(readings[0], poses[0])
            if count in (2, 10, 100, 1000, longest):
                estimate = estimator.estimate()
                worst.see(flaw(estimate), f"{name}, {count:,} times")
                if name == "histogram":
                    worst.holds(np.array_equal(estimate.robot_in_object, first), f"{name}, {count:,} times")


@case(
    "filters.no-drift",
    varied="10,000 readings chosen so that two letters stay about equally probable",
    deviation="log p(A) / p(E) from the exactly rounded sum, nats",
    limit=0.1,
    because="10,000 x 36 terms, each rounded by 2^-24 of at most 4 nats, all one way",
    quick=False,
)
def _no_drift(worst: Worst) -> None:
    scan, _ = on_the_lattice()
    one = one_state(scan.of_letters("AE"), gamma=0.6)
    readings, poses = straight_readings(scan)
    said = np.array([exact_log_p_of_letters(one, *of) for of in zip(readings, poses, strict=True)])
    gain = said[:, 0] - said[:, 1]
    chosen: list[int] = []
    balance = 0.0
    for count in range(1, LONG + 1):
        chosen.append(int(np.argmin(np.abs(balance + gain))))
        balance += gain[chosen[-1]]
        one.update(readings[chosen[-1]], poses[chosen[-1]])
        if count in (10, 100, 1000, LONG):
            p = one.estimate().probabilities
            exact = math.fsum(gain[chosen].tolist())
            worst.see(abs(math.log(p["A"] / p["E"]) - exact), f"{count:,} readings")


@case(
    "filters.readings-that-disagree",
    varied="normal beliefs 1e-6 to 1e3 mm wide, up to 1,000 times as long; 2 to 200 readings; log p off by 1e6 nats",
    deviation="variance that the jackknife shows, from that of the readings' places in closed form, relative",
    limit=1e-4,
    because="the states are a tenth of the width apart and end five widths away; 1e6 nats cancel to 1e-9",
)
def _readings_that_disagree(worst: Worst) -> None:
    rng = np.random.default_rng(0)
    steps = np.linspace(-5, 5, 101)
    grid = np.stack([part.ravel() for part in np.meshgrid(steps, steps)])
    weight, turn = np.exp(-(grid**2).sum(axis=0) / 2), np.array([[0.8, -0.6], [0.6, 0.8]])
    for width in 10.0 ** np.arange(-6, 4):
        for length in (1.0, 30.0, 1e3):
            for count in (2, 20, 200):
                # In units of one reading's error; the belief is narrower by the root of their number.
                felt = rng.normal(size=(2, count))
                mean = felt.mean(axis=1, keepdims=True)
                away = grid[:, None, :] / math.sqrt(count) + (mean - felt)[:, :, None]
                place = turn @ (np.array([[width], [width * length]]) * (grid + math.sqrt(count) * mean))
                variance = ((felt - mean) ** 2).sum() / (2 * (count - 1))
                for offset in (0.0, -1e6):
                    found = influence(-(away**2).sum(axis=0) / 2 + offset, weight, place)
                    at = f"{width:.0e} mm, {length:g} times as long, {count} readings, {offset:g} nats"
                    worst.see(abs(count**2 / (count - 1) * found / variance - 1), at)


@case(
    "filters.order-of-readings",
    varied="8 readings in 10 orders, histogram filter with and without skipping",
    deviation="probability of a letter",
    limit=1e-6,
    because="eq. 13 is a product; 8 sums of 36 float32 terms in another order round by 1e-6 nats",
)
def _order_of_readings(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    for name, options in exact_estimators():
        estimator = fitted(name, scan, **options)
        for label in scan.letters:
            for count in (2, 3, 8):
                readings, poses, _ = hidden(scan, label, count, seed=4)
                first = probabilities(after(estimator, readings, poses))
                for seed in range(10):
                    order = np.random.default_rng(seed).permutation(count)
                    again = probabilities(after(estimator, readings[order], poses[order]))
                    worst.see(np.abs(again - first), f"{options}, letter {label}, order {seed}")


@case(
    "filters.order-of-letters",
    varied="the same readings with the letters in three orders, for every estimator but those that draw",
    deviation="probability of a letter",
    limit=1e-12,
    because="letters are only summed over, and five numbers are summed in another order",
)
def _order_of_letters(worst: Worst) -> None:
    scan = few(pressed("AEIO"), 5)
    readings, poses, _ = hidden(scan, "O", 3, seed=5)
    for name, options in exact_estimators():
        first = probabilities(after(fitted(name, scan, **options), readings, poses))
        for letters in ("OIEA", "IOAE"):
            order = np.concatenate([np.flatnonzero(scan.labels == letter) for letter in letters])
            again = probabilities(after(fitted(name, scan.chosen(order), **options), readings, poses))
            worst.see(np.abs(again - first), f"{options}, {letters}")


@case(
    "filters.budget-of-one",
    varied="1, 2 and 3 bins or particles; one letter; for every estimator",
    deviation="sum of the probabilities from 1",
    limit=1e-9,
    because="a belief over one state is certain, and over none is refused",
)
def _budget_of_one(worst: Worst) -> None:
    several = few(pressed("AEI"), 5)
    for name, _ in every_estimator():
        for budget in (1, 2, 3):
            for scan in (several, several.of_letters(["E"])):
                options = dict(every_estimator(budget))[name]
                where = f"{name}, {budget} for {len(scan.letters)} letters"
                if refused(fitted, name, scan, **options):
                    worst.holds(True, where)
                    continue
                readings, poses, _ = hidden(scan, "E", 3)
                see_sound(worst, fitted(name, scan, **options), readings, poses, where)


@case(
    "filters.every-letter",
    varied="all letters and digits at once, for every estimator",
    deviation="sum of the probabilities from 1; 1 for a wrong letter after 30 readings (histogram)",
    limit=1e-9,
    because="thirty-six beliefs are normalised together",
    quick=False,
)
def _every_letter(worst: Worst) -> None:
    scan = pressed("".join(names()))
    for name, budget in every_estimator(budget=1000):
        estimator = fitted(name, scan, **budget)
        for label in scan.letters[::5]:
            readings, poses, _ = hidden(scan, label, 30, seed=8)
            estimate = after(estimator, readings, poses)
            worst.see(flaw(estimate), f"{name}, {label}")
            if name == "histogram":
                worst.holds(estimate.label == label, f"{name} takes {label} for {estimate.label}")


@case(
    "filters.faulty-taxels",
    varied="dead, stuck, saturated, negative, alternating and equal taxels up to 1e9 kPa, every estimator",
    deviation="sum of the probabilities from 1",
    limit=1e-9,
    because="any finite reading has a finite likelihood",
)
def _faulty_taxels(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 4)
    faults = {
        "all dead": np.zeros_like(readings),
        "all stuck": np.full_like(readings, 50.0),
        "all saturated": np.full_like(readings, 1e9),
        "all negative": -np.abs(readings) - 1,
        "far below zero": np.full_like(readings, -1e9),
        "alternating": np.where(np.arange(36) % 2, 1e9, -1e9) + 0 * readings,
        "one dead": np.where(np.arange(36) == 7, 0, readings),
        "one stuck": np.where(np.arange(36) == 7, 900, readings),
        "subnormal": np.full_like(readings, 5e-324),
    }
    for name, budget in every_estimator():
        estimator = fitted(name, scan, **budget)
        for what, faulty in faults.items():
            see_sound(worst, estimator, faulty, poses, f"{name}, {what}")


@case(
    "filters.far-off-the-map",
    varied="sensor poses 100 to 1e9 mm away, for every estimator",
    deviation="probability of a letter, from before; sum from 1",
    limit=1e-6,
    because="out there every letter's map says the prior, so nothing is learned about the letter",
)
def _far_off_the_map(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 6)
    for name, budget in every_estimator():
        estimator = fitted(name, scan, **budget)
        estimator.update(readings[0], poses[0])
        before = probabilities(estimator.estimate())
        for decade in (2, 4, 6, 8.99):
            for reading in readings:
                estimator.update(reading, [10.0**decade, -(10.0**decade), 1.0])
            estimate = estimator.estimate()
            worst.see(flaw(estimate), f"{name}, 1e{decade} mm")
            if name == "histogram":
                worst.see(np.abs(probabilities(estimate) - before), f"{name}, 1e{decade} mm")


@case(
    "filters.symmetric-letters",
    varied="I and O hidden at 12 poses each, and what the readings cannot tell",
    deviation="placement error over the size of a bin, histogram filter",
    limit=2.0,
    because="the error is folded by the letter's symmetry; the free angle of O costs nothing",
)
def _symmetric_letters(worst: Worst) -> None:
    scan = pressed("IO")
    objects = properties(scan)
    estimator = fitted("histogram", scan, split="20x20x24")
    for label in "IO":
        for seed in range(12):
            readings, poses, truth = hidden(scan, label, 30, seed=seed)
            estimate = after(estimator, readings, poses)
            half_bin = math.hypot(0.5, 0.5) + math.sqrt(objects[label].inertia_over_mass) * math.pi / 24
            error = float(placement_error(estimate.robot_in_object, truth, objects[label])) / (2 * half_bin)
            worst.see(error if estimate.label == label else np.inf, f"{label}, trial {seed}")


@case(
    "filters.nothing-said",
    varied="readings whose every taxel is Unknown, for every estimator",
    deviation="probability of a letter, from before",
    limit=1e-9,
    because="an Unknown taxel has the same likelihood everywhere",
)
def _nothing_said(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 1)
    unknown = np.full(36, 1.5)  # below T = 2, above 0.3 of the largest
    for name, budget in every_estimator():
        estimator = fitted(name, scan, **budget)
        estimator.update(readings[0], poses[0])
        before = probabilities(estimator.estimate())
        for count in range(20):
            estimator.update(unknown, compose(poses[0], [count, 0, 0]))
            worst.see(flaw(estimator.estimate()), name)
        if name == "histogram":
            worst.see(np.abs(probabilities(estimator.estimate()) - before), name)


@case(
    "filters.after-nonsense",
    varied="3 readings that no letter gives, then 30 good ones, for every estimator but those that draw",
    deviation="letters of 3 that are not found again",
    limit=0,
    because="a belief in logs loses no state for good",
)
def _after_nonsense(worst: Worst) -> None:
    scan = pressed("AEI")
    rng = np.random.default_rng(9)
    for name, budget in every_estimator():
        if draws(name):
            continue  # they may stay at a wrong letter or place; docs/stress.md says how they find the right one again
        estimator = fitted(name, scan, **budget)
        for label in scan.letters:
            readings, poses, _ = hidden(scan, label, 33, seed=10)
            readings[:3] = rng.choice([0.0, 60.0], (3, 36))
            worst.holds(after(estimator, readings, poses).label == label, f"{name}, letter {label}")


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
def _all_weights_tiny(worst: Worst) -> None:
    scan = pressed("AEI")
    rng = np.random.default_rng(0)
    for name, options in drawing(200):
        for gamma in (0.1, 1e-10, 1e-100, 1e-300):
            estimator = fitted(name, scan, gamma=gamma, **options)
            for _ in range(10):
                estimator.update(rng.choice([0.0, 60.0], 36), rng.uniform(-10, 10, 3))
                worst.see(flaw(estimator.estimate()), f"{name}, gamma {gamma}")


@case(
    "none.odd-readings",
    varied="prior of none 1e-12 to 1 - 1e-12; readings times 0 to 1e6, below 0, all alike",
    deviation="sum of the probabilities from 1, after each of 5 readings",
    limit=1e-9,
    because="odds are kept in logs, and every variance has a floor",
)
def _odd_readings(worst: Worst) -> None:
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
def _frames(worst: Worst) -> None:
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


@case(
    "filters.skipping",
    varied="bins left alone or not, 60 readings of every letter",
    deviation="probability of a letter; 1 for another letter or pose",
    limit=1e-6,
    because="bins that are left alone hold 1e-8 of the belief together",
)
def _skipping(worst: Worst) -> None:
    scan = pressed()
    lazy, full = (fitted("histogram", scan, bins=2000, gamma=0.6, skip=skip) for skip in (True, False))
    for label in scan.letters:
        readings, poses, _ = hidden(scan, label, 60, seed=6)
        for estimator in (lazy, full):
            estimator.reset(np.random.default_rng(0))
        for count, (reading, pose) in enumerate(zip(readings, poses, strict=True), start=1):
            lazy.update(reading, pose)
            full.update(reading, pose)
            ours, whole = lazy.estimate(), full.estimate()
            where = f"letter {label}, reading {count}"
            worst.see(np.abs(probabilities(ours) - probabilities(whole)), where)
            worst.holds(
                ours.label == whole.label and np.array_equal(ours.robot_in_object, whole.robot_in_object),
                where,
            )


@case(
    "filters.trained-on-faults",
    varied="training readings dead, stuck, saturated or negative throughout, every estimator that learns",
    deviation="sum of the probabilities from 1",
    limit=1e-9,
    because="a map of nothing, or of everything, is a map",
)
def _trained_on_faults(worst: Worst) -> None:
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 4)
    for what, value in (("dead", 0.0), ("stuck", 50.0), ("saturated", 1e9), ("negative", -1e9)):
        faulty = np.where(scan.split[:, None] == "train", value, scan.readings)
        broken = replace(scan, readings=faulty)
        for name, budget in every_estimator(budget=200, learning=True):
            see_sound(worst, fitted(name, broken, **budget), readings, poses, f"{name}, {what}")


@case(
    "particles.resampling",
    varied="weights over 300 decades, equal ones, and all zero but one",
    deviation="share of draws from the weight's share, in standard deviations of the draw",
    limit=5.0,
    because="a draw is right on average; 5 standard deviations happen once in two million",
)
def _resampling(worst: Worst) -> None:
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


def cones(nodes: FloatArray, state: FloatArray, weight: FloatArray) -> FloatArray:
    """Sum eq. 10 and 11, with rho 1, at nodes (n, 3)."""
    away = nodes[:, :, None] - state
    away[:, 2] = np.mod(away[:, 2] + math.pi, 2 * math.pi) - math.pi
    return np.maximum(0, 1 - np.sqrt((away**2).sum(axis=1))) @ weight


@case(
    "particles.mode-of-the-density",
    varied="particles across the seam of the circle, weights over 30 decades, one to 200 of them",
    deviation="height of the highest node over that of the mode found, relative, by brute force",
    limit=1e-9,
    because="both add up the same cones; columns are left out only where their upper bound is lower",
)
def _mode_of_the_density(worst: Worst) -> None:
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


@case(
    "particles.same-seed",
    varied="the seed of the particles",
    deviation="answers that differ for one seed, or agree for two",
    limit=0,
    because="all randomness comes from the generator that reset is given",
)
def _same_seed(worst: Worst) -> None:
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
