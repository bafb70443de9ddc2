"""The belief over the plane, of every estimator that shows one."""

import numpy as np
import pytest
from synthetic import CHEAPER, draw_trial, fitted, make_scan, paper_poses

from tactsim import estimators

NOT_SHOWING = (
    "synthesis",
    "nearest",
    "bag-of-features",
    "mlp",
    "spectrum",
    "space-refined",
    "space-tempered",
)
SHOWING = [name for name in estimators.names() if name not in NOT_SHOWING]


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=4, angles=6))


def begun(name, scan, count, **options):
    """An estimator after `count` readings, with the readings and poses that follow."""
    estimator = fitted(name, scan, **CHEAPER.get(name, {}), **options)
    rng = np.random.default_rng(5)
    readings, poses, _ = draw_trial(scan, "L", count + 2, rng)
    estimator.reset(rng)
    for reading, pose in zip(readings[:count], poses[:count], strict=True):
        estimator.update(reading, pose)
    return estimator, readings[count:], poses[count:]


@pytest.mark.parametrize("count", [0, 1, 4])
@pytest.mark.parametrize("name", SHOWING)
def test_a_plane_says_of_each_letter_what_the_estimate_says(name, count, scan):
    estimator, _, _ = begun(name, scan, count)
    plane = estimator.belief_over_plane()
    assert plane.probability.shape == (len(plane.labels), len(plane.y), len(plane.x))
    assert plane.probability.min() >= 0
    assert plane.probability.sum() == pytest.approx(1)
    said = estimator.estimate().probabilities
    for label, mass in zip(plane.labels, plane.probability.sum(axis=(1, 2)), strict=True):
        assert mass == pytest.approx(said[label], abs=1e-6)


@pytest.mark.parametrize("name", SHOWING)
def test_the_cells_stay_where_they_are(name, scan):
    estimator, readings, poses = begun(name, scan, 1)
    before = estimator.belief_over_plane()
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
    after = estimator.belief_over_plane()
    assert (before.labels, before.x.tolist(), before.y.tolist()) == (
        after.labels,
        after.x.tolist(),
        after.y.tolist(),
    )


@pytest.mark.parametrize("split", ["25x25x16", "3x9x2", "7x4x5"])
def test_bins_that_are_skipped_are_not_missed_in_the_plane(split, scan):
    planes = [
        begun("histogram", scan, 4, split=split, skip=skip)[0].belief_over_plane() for skip in (True, False)
    ]
    assert planes[0].probability == pytest.approx(planes[1].probability, abs=1e-7)


def test_the_plane_lies_as_the_estimate_does(scan):
    # One angle: the plane's peak is the joint mode.
    estimator, _, _ = begun("histogram", scan, 4, split="11x8x1")
    plane, estimate = estimator.belief_over_plane(), estimator.estimate()
    letter, row, column = np.unravel_index(plane.probability.argmax(), plane.probability.shape)
    assert plane.labels[letter] == estimate.label
    assert [plane.x[column], plane.y[row]] == pytest.approx(estimate.robot_in_object[:2])
