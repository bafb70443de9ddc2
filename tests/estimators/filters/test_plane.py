"""The belief over the plane, of every estimator that shows one."""

import numpy as np
import pytest
from synthetic import CHEAPER, draw_trial, fitted, follow, quick_first

from tactsim import estimators

NOT_SHOWING = ("synthesis", "nearest", "bag-of-features", "whole-image", "space-refined")
SHOWING = [name for name in estimators.names() if name not in NOT_SHOWING]


def begun(name, scan, count, **options):
    """Give an estimator after `count` readings."""
    estimator = fitted(name, scan, **CHEAPER.get(name, {}), **options)
    readings, poses, _ = draw_trial(scan, "L", count, np.random.default_rng(5))
    follow(estimator, readings, poses)
    return estimator


@pytest.mark.parametrize("count", [0, 4])
@pytest.mark.parametrize("name", quick_first(SHOWING))
def test_a_plane_says_of_each_letter_what_the_estimate_says(name, count, scan):
    estimator = begun(name, scan, count)
    plane = estimator.belief_over_plane()
    assert plane.probability.shape == (len(plane.labels), len(plane.y), len(plane.x))
    assert plane.probability.min() >= 0
    assert plane.probability.sum() == pytest.approx(1)
    said = estimator.estimate().probabilities
    for label, mass in zip(plane.labels, plane.probability.sum(axis=(1, 2)), strict=True):
        assert mass == pytest.approx(said[label], abs=1e-6)


@pytest.mark.parametrize("split", ["25x25x16", "3x9x2"])
def test_bins_that_are_skipped_are_not_missed_in_the_plane(split, scan):
    planes = [
        begun("histogram", scan, 4, split=split, skip=skip).belief_over_plane() for skip in (True, False)
    ]
    assert planes[0].probability == pytest.approx(planes[1].probability, abs=1e-7)


def test_the_plane_lies_as_the_estimate_does(scan):
    # One angle: the plane's peak is the joint mode.
    estimator = begun("histogram", scan, 4, split="11x8x1")
    plane, estimate = estimator.belief_over_plane(), estimator.estimate()
    letter, row, column = np.unravel_index(plane.probability.argmax(), plane.probability.shape)
    assert plane.labels[letter] == estimate.label
    assert [plane.x[column], plane.y[row]] == pytest.approx(estimate.robot_in_object[:2])
