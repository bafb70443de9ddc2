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
    shift, size, states = trust._moves(centre, np.random.default_rng(0))
    moved = np.array([compose(state, [*centre, 0.0]) for state in states.T])
    assert moved[:, :2] - centre == pytest.approx(shift)
    assert np.hypot(np.hypot(*shift.T), trust._GYRATION * moved[:, 2]) == pytest.approx(size)


@pytest.mark.parametrize("too_sure", [1.0, 2.0, 5.0])
def test_a_gaussian_likelihood_that_is_too_sure_gets_the_weight_that_makes_up_for_it(monkeypatch, too_sure):
    # Readings whose log p is that of a Gaussian about a place drawn from it, times a factor.
    rng = np.random.default_rng(1)
    sigma = np.array([0.4, 0.4, 0.4])

    def left_out(likelihood, train, labels, states):
        shift, _, _ = trust._moves(np.zeros(2), np.random.default_rng(0))
        place = np.column_stack([shift, trust._GYRATION * states[2]])
        seen = rng.normal(size=(3, 400, 3)) * sigma
        return [-too_sure * (((place[None] - one[:, None]) / sigma) ** 2).sum(axis=2) / 2 for one in seen]

    monkeypatch.setattr(trust, "_left_out", left_out)
    monkeypatch.setattr(trust, "_MOVES", 2000)
    scan = SimpleNamespace(
        where=lambda split: SimpleNamespace(letters=("E", "I", "L"), poses=np.zeros((3, 3)))
    )
    assert learn_trust(None, scan) == pytest.approx(1 / too_sure, rel=0.25)


@pytest.mark.parametrize("likelihood", ["calibrated", "force"])
def test_it_is_learned_from_training_readings_alone(likelihood):
    scan = make_scan("EI", poses=paper_poses(3, 6))
    weights = []
    for one in (scan, scan.where("train")):
        estimator = create("refined", likelihood=likelihood, bins=500)
        estimator.fit(one)
        weights.append(learn_trust(estimator.likelihood, one))
    assert weights[0] == weights[1]
    assert 0 < weights[0] <= 2


def test_a_likelihood_that_cannot_leave_readings_out_counts_fully():
    scan = make_scan("EI", poses=paper_poses(3, 4))
    estimator = create("refined", likelihood="paper", bins=500)
    estimator.fit(scan)
    assert math.isclose(learn_trust(estimator.likelihood, scan), 1.0)
