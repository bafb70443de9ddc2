"""How much a sequence counts, where the right answer is known: likelihoods that are exact, and too sure by a factor."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim.core import compose
from tactsim.estimators import create
from tactsim.estimators.filters import trust
from tactsim.estimators.filters.trust import learn_trust


def test_moves_turn_about_the_centre_and_have_the_sizes_that_are_said():
    centre = np.array([3.0, -2.0])
    shift, size, states = trust._moves(centre)
    moved = np.array([compose(state, [*centre, 0.0]) for state in states.T])
    assert moved[:, :2] - centre == pytest.approx(shift)
    assert np.hypot(np.hypot(*shift.T), trust._GYRATION * moved[:, 2]) == pytest.approx(size)


def gaussian(rng, too_sure, shared):
    """Make a stand-in for left-out readings: Gaussians about places drawn from them, log p times a factor.

    shared: variance of the error common to all readings of a letter, in the unit of one reading's own.
    """
    sigma = 0.4

    def left_out(likelihood, train, labels, states):
        shift, _, _ = trust._moves(np.zeros(2))
        place = np.column_stack([shift, trust._GYRATION * states[2]])
        common = rng.normal(size=(100, 1, 3)) * math.sqrt(shared)
        seen = (rng.normal(size=(100, 30, 3)) + common) * sigma
        return [-too_sure * ((place[None] - one[:, None]) ** 2).sum(axis=2) / (2 * sigma**2) for one in seen]

    return left_out


SCAN = SimpleNamespace(where=lambda split: SimpleNamespace(letters=("E", "I", "L"), poses=np.zeros((3, 3))))


@pytest.mark.parametrize("too_sure", [1.0, 2.0, 5.0])
def test_a_gaussian_likelihood_that_is_too_sure_gets_the_weight_that_makes_up_for_it(monkeypatch, too_sure):
    monkeypatch.setattr(trust, "_left_out", gaussian(np.random.default_rng(1), too_sure, 0.0))
    learned = learn_trust(None, SCAN)
    assert [learned(n) for n in (3, 8, 20)] == pytest.approx([1 / too_sure] * 3, rel=0.2)


def test_an_error_that_all_readings_share_makes_the_weight_fall_as_they_become_more(monkeypatch):
    # The mean of n readings errs with 1 / n + shared, and the likelihood says 1 / n.
    monkeypatch.setattr(trust, "_left_out", gaussian(np.random.default_rng(1), 1.0, 0.1))
    learned = learn_trust(None, SCAN)
    for n in (3, 8, 20):
        assert learned(n) == pytest.approx(1 / (1 + 0.1 * n), rel=0.25)


def test_more_readings_never_say_less():
    learned = trust.Trust(own=1.5, shared=0.1)
    assert np.all(np.diff([n * learned(n) for n in range(1, 1000)]) > 0)


@pytest.mark.parametrize("likelihood", ["calibrated", "force"])
def test_it_is_learned_from_training_readings_alone(likelihood):
    scan = make_scan("EI", poses=paper_poses(3, 6))
    weights = []
    for one in (scan, scan.where("train")):
        estimator = create("refined", likelihood=likelihood, bins=500)
        estimator.fit(one)
        weights.append(learn_trust(estimator.likelihood, one))
    assert weights[0] == weights[1]
    assert 0 < weights[0](20) <= weights[0](1) <= 2


def test_a_likelihood_that_cannot_leave_readings_out_counts_fully():
    scan = make_scan("EI", poses=paper_poses(3, 4))
    estimator = create("refined", likelihood="paper", bins=500)
    estimator.fit(scan)
    assert learn_trust(estimator.likelihood, scan)(20) == 1
