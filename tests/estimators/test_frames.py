"""Estimates do not depend on where the origins of the poses are, nor on how a far base is turned."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic import follow

import tactsim
from tactsim.core import compose, invert, wrap_angle
from tactsim.estimators import create
from tactsim.press import forward_model

LETTERS, READINGS = "AEI", 5
FAR = [(500.0, 0.0, 0.0), (-3000.0, 271.8, 0.0), (7000.0, 7000.0, 0.0), (1234.5, -6000.0, 2.0)]
# Deterministic ones, with options that make them quick.
KINDS = {"histogram": {"split": "20x20x24"}, "refined": {"cell": 0.8}, "nearest": {}}
# These take their time.
LONG = [pytest.param(name, marks=pytest.mark.long) for name in ("force-mosaic", "synthesis")]


@pytest.fixture(scope="module")
def scan():
    return tactsim.scan(letters=LETTERS, seed=2)


def sequence(scan, letter, seed=0):
    """Draw readings of a letter, and robot_in_object and sensor_in_robot (n, 3) with the robot near the object."""
    rng = np.random.default_rng(seed)
    test = scan.where("test", letter)
    chosen = rng.permutation(len(test))[:READINGS]
    hidden = np.array([*rng.uniform(-8, 8, 2), rng.uniform(-3, 3)])
    return test.readings[chosen], hidden, compose(invert(hidden), test.poses[chosen])


def fitted(name, scan):
    estimator = create(name, **KINDS.get(name, {}))
    if estimator.uses_forward_model:
        estimator.bring(forward_model(scan))
    estimator.fit(scan)
    return estimator


@pytest.fixture(scope="module")
def near(scan):
    """Give an estimator of a name that is fitted to the scan as it is, once in all tests."""
    return cache(lambda name: fitted(name, scan))


def assert_same_touches(one, poses, other, others, moved=(0.0, 0.0)):
    """Check labels, probabilities and where on the object the pad was at each touch: 1e-6 mm, 1e-8 rad."""
    for k, (first, second) in enumerate(zip(one, other, strict=True)):
        assert first.label == second.label
        assert_allclose(list(first.probabilities.values()), list(second.probabilities.values()), atol=1e-5)
        touched = compose(first.robot_in_object, poses[k]) + [*moved, 0]
        again = compose(second.robot_in_object, others[k])
        assert_allclose(again[:2], touched[:2], rtol=0, atol=1e-6)
        assert abs(wrap_angle(again[2] - touched[2])) < 1e-8


@pytest.mark.parametrize("name", [*KINDS, *LONG])
def test_the_object_may_lie_anywhere_in_its_frame(scan, near, name):
    for away in FAR[1:3]:
        far = fitted(name, replace(scan, poses=scan.poses + away))
        for letter in LETTERS[:2]:
            readings, _, poses = sequence(scan, letter)
            assert_same_touches(
                follow(near(name), readings, poses), poses, follow(far, readings, poses), poses, away[:2]
            )


@pytest.mark.parametrize("name", [*KINDS, *LONG])
def test_each_object_may_lie_in_a_frame_of_its_own(scan, near, name):
    away = {"A": (0.0, 0.0, 0.0), "E": (40.0, -15.0, 0.0), "I": (500.0, 0.0, 0.0)}
    apart = fitted(name, replace(scan, poses=scan.poses + [away[label] for label in scan.labels]))
    for letter in LETTERS:
        readings, _, poses = sequence(scan, letter)
        one, other = (follow(estimator, readings, poses) for estimator in (near(name), apart))
        for first, second in zip(one, other, strict=True):
            moved = replace(second, robot_in_object=second.robot_in_object - away[second.label])
            assert_same_touches([first], poses, [moved], poses)


@pytest.mark.parametrize("name", [*KINDS, *LONG])
def test_a_far_base_may_stand_anywhere_and_be_turned(scan, near, name):
    estimator = near(name)
    for letter in LETTERS[:2]:
        readings, _, poses = sequence(scan, letter)
        bases = [compose(base, poses) for base in FAR]
        first, *others = (follow(estimator, readings, seen) for seen in bases)
        for seen, answers in zip(bases[1:], others, strict=True):
            assert_same_touches(first, bases[0], answers, seen)


@pytest.mark.parametrize("name", ["refined", *LONG])
@pytest.mark.parametrize("base", FAR[1::2])
def test_a_far_base_recognises_and_places_as_a_near_one(scan, near, name, base):
    estimator = near(name)
    for letter in LETTERS:
        readings, hidden, poses = sequence(scan, letter)
        seen = compose(base, poses)
        answer = follow(estimator, readings, seen)[-1]
        assert answer.label == letter
        true = compose(hidden, poses)
        symmetry = scan.meta["objects"][letter]["symmetry"]
        turned = compose(answer.robot_in_object, seen)
        halves = [compose([0, 0, 2 * np.pi * k / symmetry], true) for k in range(symmetry)]
        assert min(np.abs(turned - half)[:, :2].max() for half in halves) < 2.0


def test_maps_planes_and_samples_are_in_the_frame_of_the_user(scan, near):
    near, far = near("histogram"), fitted("histogram", replace(scan, poses=scan.poses + FAR[0]))
    readings, _, poses = sequence(scan, "A")
    one, other = (follow(estimator, readings, poses)[-1] for estimator in (near, far))
    assert_allclose(other.samples.poses - FAR[0], one.samples.poses, atol=1e-6)
    for label, chart in near.maps.items():
        assert_allclose(far.maps[label].origin - FAR[0][:2], chart.origin, atol=1e-9)
        assert_allclose(far.maps[label].log_odds, chart.log_odds, atol=1e-9)
    plane, there = near.belief_over_plane(), far.belief_over_plane()
    assert_allclose(there.x - FAR[0][0], plane.x, atol=1e-9)
    assert_allclose(there.probability, plane.probability, atol=1e-6)
