"""Where an unknown object may still differ: against Bayes' rule written out, and what a planner makes of it."""

import numpy as np
import pytest
from synthetic import draw_trial, make_scan, paper_poses

from tactsim.core import compose, transform
from tactsim.estimators.filters.open_set import Doubts
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIT", poses=paper_poses(positions=4, angles=6))


@pytest.fixture(scope="module")
def model(scan):
    model = CalibratedLikelihood(LikelihoodOptions())
    model.fit(scan, learn_maps(scan))
    return model


@pytest.fixture(scope="module")
def doubts(model, scan):
    return Doubts(model, scan.taxel_xy)


def changed(model, doubts, xy, place):
    """p of the classes at points (n, 2), for the letter E changed around a place: (3, n)."""
    p = np.exp(model.log_tables("E", xy))
    w = np.exp(-((xy - place) ** 2).sum(axis=1) / (2 * 2.5**2))
    return (1 - w) * p + w * p[[1, 0, 2]]


def test_weights_are_bayes_rule(model, doubts, scan):
    readings, poses, truth = draw_trial(scan, "E", 3, np.random.default_rng(0))
    weights = doubts.weights("E", truth, readings, poses, unknown=0.3)
    xy = transform(compose(truth, poses), scan.taxel_xy)
    classes = model.classes(readings)

    def p(place):
        return np.prod(
            [changed(model, doubts, xy[i], place)[classes[i], np.arange(36)].prod() for i in range(3)]
        )

    far = np.array([1e3, 1e3])
    joint = np.array([0.3 / len(doubts.places) * p(place) for place in doubts.places])
    assert weights == pytest.approx(joint / (joint.sum() + 0.7 * p(far)), rel=1e-9)
    before = doubts.weights("E", truth, readings[:0], poses[:0], unknown=0.3)
    assert before == pytest.approx(0.3 / len(doubts.places))


def test_information_is_what_changed_classes_would_say(model, doubts, scan):
    pose, candidate = np.array([0.5, 0.2, 0.3]), np.array([[2.0, -4.0, 1.0], [90.0, 0.0, 0.0]])
    weights = np.full(len(doubts.places), 1e-9)
    weights[3] = 0.01
    xy = transform(compose(pose, candidate[0]), scan.taxel_xy)
    p, q = np.exp(model.log_tables("E", xy)), changed(model, doubts, xy, doubts.places[3])
    divergence = (q * np.log(q / p)).sum()
    found = doubts.information("E", pose, weights, candidate)
    assert found[0] == pytest.approx(0.01 * min(divergence, -np.log(0.01)), abs=1e-6)
    assert found[1] == pytest.approx(0, abs=1e-6)
