"""The parts of a filter on maps: made only if they are asked for, and each does what is written out here by hand."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, follow, make_scan, paper_poses

from tactsim.estimators import create
from tactsim.estimators.registry import load

SMALL = {"bins": 500, "cells": 20, "cell": 0.8}


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=3, angles=4))


def test_a_fit_to_the_pad_is_a_transformation_of_what_goes_in_and_comes_out(scan):
    """A filter of the fitted options on readings that were brought to the paper's pad, its answers brought back."""
    ours = replace(
        scan, readings=scan.readings / 1000, poses=scan.poses * [2, 2, 1], taxel_xy=2 * scan.taxel_xy
    )
    fitted = fitted_anew("refined", ours, fit="auto", unknown=0.2, **SMALL)
    units = fitted.pad_fit.units
    back = [units.length, units.length, 1]
    assert back == pytest.approx([2, 2, 1])
    plain = create("refined", **(fitted.fitted_options.model_dump(exclude_defaults=True) | {"fit": "off"}))
    plain.fit(units.scan(ours))
    assert plain.pad_fit is None
    readings, poses, _ = draw_trial(ours, "L", 4, np.random.default_rng(1))
    brought = units.readings(readings), units.poses(poses)
    expected = follow(plain, *brought)
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


@pytest.mark.parametrize("name", ["histogram", "particle", "augmented-mcl", "refined"])
def test_a_filter_without_a_letter_leaves_the_sequence_of_the_whole_alone(scan, name):
    """A sequence of the whole filter with one of the copy in between, against one that nothing came between."""
    budget = {"particles": 300} if load(name).budget == "particles" else {"bins": 500}
    whole = fitted_anew(name, scan, cell=0.8, **budget)
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
