"""The belief as weighted states, of every built-in filter."""

import numpy as np
import pytest
from synthetic import draw_trial, fitted, make_scan, paper_poses

from tactsim import estimators
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.states import WeightedStates, Weights
from tactsim.estimators.registry import BUILT_IN, load

FILTERS = [name for name in BUILT_IN if issubclass(load(name), MapFilter)]


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=4, angles=6))


def test_bins_are_drawn_with_a_place_inside_them(scan):
    estimator = estimators.create("histogram", split="4x5x6")
    estimator.fit(scan)
    estimator.reset(np.random.default_rng(0))
    _, state = estimator.weighted_states().draw(6000, np.random.default_rng(1))
    reach = np.array([[10.0], [10.0], [np.pi]])
    assert (np.abs(state) <= reach).all()
    # Before the first reading the whole space is uniform: five standard errors of the mean and the variance.
    assert np.abs(state.mean(axis=1) / reach[:, 0]) == pytest.approx(np.zeros(3), abs=5 * 0.58 / 6000**0.5)
    assert (state / reach).var(axis=1) == pytest.approx(np.full(3, 1 / 3), abs=0.02)


@pytest.mark.parametrize("name", FILTERS)
def test_states_are_drawn_as_the_belief_says(name, scan):
    estimator = fitted(name, scan)
    estimator.reset(np.random.default_rng(3))
    readings, poses = draw_trial(scan, "E", 3, np.random.default_rng(4))[:2]
    for count in range(3):
        letter, state = estimator.weighted_states().draw(20_000, np.random.default_rng(5))
        shares = np.bincount(letter, minlength=3) / 20_000
        assert shares == pytest.approx(list(estimator.estimate().probabilities.values())[:3], abs=0.02)
        assert state.shape == (3, 20_000)
        assert np.abs(state[:2]).max() <= 10 + 1e-9
        estimator.update(readings[count], poses[count])


@pytest.mark.parametrize("name", FILTERS)
def test_the_weighted_states_are_the_belief_that_the_estimate_sums(name, scan):
    estimator = fitted(name, scan)
    estimator.reset(np.random.default_rng(3))
    readings, poses = draw_trial(scan, "L", 4, np.random.default_rng(4))[:2]
    for count in range(5):
        if count:
            estimator.update(readings[count - 1], poses[count - 1])
        belief = estimator.weighted_states()
        assert belief.state.shape == (3, len(belief.letter))
        assert np.abs(belief.state[:2]).max() <= estimator.reach
        mass = np.bincount(belief.letter, belief.weights.normalised, minlength=3)
        assert list(estimator.estimate().probabilities.values()) == pytest.approx(mass, abs=1e-6)


def test_a_point_is_drawn_as_it_is_and_a_cell_at_any_place_in_it():
    letter, state, weights = (
        np.array([2, 0]),
        np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 0.5]]),
        Weights(np.zeros(2)),
    )
    drawn, points = WeightedStates(letter, state, weights).draw(1000, np.random.default_rng(0))
    assert (points == state[:, (drawn == 0).astype(int)]).all()
    size = np.array([[0.5, 1.0], [1.0, 2.0], [0.1, 0.2]])
    drawn, inside = WeightedStates(letter, state, weights, size).draw(1000, np.random.default_rng(0))
    away = (inside - state[:, (drawn == 0).astype(int)]) / size[:, (drawn == 0).astype(int)]
    assert np.abs(away).max() <= 0.5
    # A uniform place has a variance of 1/12; five standard errors.
    assert away.var(axis=1) == pytest.approx(np.full(3, 1 / 12), abs=5 * 0.075 / 1000**0.5)
