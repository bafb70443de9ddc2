"""The parts of a filter on maps: made only if they are asked for, and each does what is written out here by hand."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import draw_trial, make_scan, paper_poses

from tactsim.core import compose
from tactsim.estimators import NONE, create
from tactsim.estimators.filters.histogram import HistogramFilter
from tactsim.estimators.filters.refined import RefinedFilter
from tactsim.estimators.registry import load

SMALL = {"bins": 500, "cells": 20, "cell": 0.8}


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=3, angles=4))


def follow(estimator, readings, poses, seed=0):
    """Feed a sequence from a reset; the estimates after each reading."""
    estimator.reset(np.random.default_rng(seed))
    found = []
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        found.append(estimator.estimate())
    return found


def test_what_is_created_is_the_filter_itself():
    estimator = create("histogram", bins=100)
    assert type(estimator) is HistogramFilter
    assert (estimator.pad_fit, estimator.motion, estimator.moving, estimator.open_set) == (None,) * 4
    moving = create("refined", motion="auto")
    assert type(moving) is RefinedFilter
    assert moving.moving is not None
    particles = create("particle", motion="auto")
    assert (particles.motion is None, particles.moving) == (False, None)  # it follows the motion by itself


def test_a_fit_to_the_pad_is_a_transformation_of_what_goes_in_and_comes_out(scan):
    """A filter of the fitted options on readings that were brought to the paper's pad, its answers brought back."""
    ours = replace(
        scan, readings=scan.readings / 1000, poses=scan.poses * [2, 2, 1], taxel_xy=2 * scan.taxel_xy
    )
    fitted = create("refined", fit="auto", unknown=0.2, **SMALL)
    fitted.fit(ours)
    units = fitted.pad_fit.units
    back = [units.length, units.length, 1]
    assert back == pytest.approx([2, 2, 1])
    plain = create("refined", **(fitted.fitted_options.model_dump(exclude_defaults=True) | {"fit": "off"}))
    plain.fit(units.scan(ours))
    assert plain.pad_fit is None
    readings, poses, _ = draw_trial(ours, "L", 4, np.random.default_rng(1))
    brought = [units.bring(reading, pose) for reading, pose in zip(readings, poses, strict=True)]
    expected = follow(plain, *zip(*brought, strict=True))
    for known, other in zip(follow(fitted, readings, poses), expected, strict=True):
        assert known.probabilities == other.probabilities
        assert known.robot_in_object.tobytes() == (other.robot_in_object * back).tobytes()
        assert known.samples.poses.tobytes() == (other.samples.poses * back).tobytes()
    plane, other = fitted.belief_over_plane(), plain.belief_over_plane()
    assert plane.x.tolist() == (units.length * other.x).tolist()
    assert plane.probability.tobytes() == other.probability.tobytes()
    for label, chart in fitted.maps.items():
        assert chart.extent == pytest.approx([2 * end for end in plain.maps[label].extent])
    assert fitted.propose(poses) == plain.propose(units.poses(poses))


def test_none_is_added_beside_what_the_filter_says_of_the_letters(scan):
    readings, poses, _ = draw_trial(scan, "E", 4, np.random.default_rng(2))
    plain, open_set = create("refined", **SMALL), create("refined", unknown=0.3, **SMALL)
    for estimator in (plain, open_set):
        estimator.fit(scan)
    for known, other in zip(follow(open_set, readings, poses), follow(plain, readings, poses), strict=True):
        none = known.probabilities[NONE]
        assert {label: (1 - none) * p for label, p in other.probabilities.items()} == {
            label: p for label, p in known.probabilities.items() if label != NONE
        }
        assert known.robot_in_object.tobytes() == other.robot_in_object.tobytes()


def test_all_parts_at_once_and_without_a_letter(scan):
    """A filter with every part: without a letter it is as if that had never been there, and keeps its own state."""
    asked = {"fit": "auto", "motion": "auto", "unknown": 0.2, **SMALL}
    whole, rest = create("refined", **asked), create("refined", **asked)
    whole.fit(scan)
    rest.fit(scan.untrained(["I"]))
    readings, poses, _ = draw_trial(scan, "E", 4, np.random.default_rng(3))
    before = follow(whole, readings[:2], poses[:2])[-1]
    left = whole.without("I", scan)
    for known, other in zip(follow(left, readings, poses), follow(rest, readings, poses), strict=True):
        assert known.probabilities == pytest.approx(other.probabilities, abs=1e-6)
    after = whole.estimate()
    assert after.probabilities == before.probabilities
    assert after.robot_in_object.tobytes() == before.robot_in_object.tobytes()
    assert whole.open_set is not left.open_set
    assert whole.propose(compose(poses, np.array([1.0, 0, 0]))) in range(4)


@pytest.mark.parametrize(
    "name", ["histogram", "particle", "augmented-mcl", "tempered", "refined", "scan-matching"]
)
def test_a_filter_without_a_letter_leaves_the_sequence_of_the_whole_alone(scan, name):
    """A sequence of the whole filter with one of the copy in between, against one that nothing came between."""
    budget = {"particles": 300} if load(name).budget == "particles" else {"bins": 500}
    whole = create(name, cell=0.8, **budget)
    whole.fit(scan)
    drawn = [draw_trial(scan, label, 6, np.random.default_rng(4)) for label in "EL"]
    # Readings that contradict the first ones: random particles are injected then.
    readings, poses = (np.concatenate([trial[k][:4] for trial in drawn]) for k in (0, 1))
    expected = follow(whole, readings, poses)[-1]
    follow(whole, readings[:5], poses[:5])
    follow(whole.without("I", scan), readings[::-1], poses[::-1], seed=1)
    for reading, pose in zip(readings[5:], poses[5:], strict=True):
        whole.update(reading, pose)
    assert whole.estimate().probabilities == expected.probabilities
    assert whole.estimate().robot_in_object.tobytes() == expected.robot_in_object.tobytes()
