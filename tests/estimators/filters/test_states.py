"""The belief as weighted states, of every built-in filter, and weights in logs against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import CHEAPER, draw_trial, fitted, quick_first

from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.states import WeightedStates, Weights, highest_power
from tactsim.estimators.registry import BUILT_IN, load

FILTERS = [name for name in BUILT_IN if issubclass(load(name), MapFilter)]


@pytest.mark.parametrize("name", quick_first(FILTERS))
def test_the_weighted_states_are_the_belief_that_the_estimate_sums(name, scan):
    estimator = fitted(name, scan, **CHEAPER.get(name, {}))
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


def of(weight):
    with np.errstate(divide="ignore"):
        return Weights(np.log(np.array(weight, dtype=float)))


def test_the_effective_sample_size_counts_equal_weights():
    assert Weights(np.full(7, -1000.0)).ess == pytest.approx(7)
    assert Weights(np.array([0.0, -2000.0, -2000.0, -2000.0])).ess == pytest.approx(1)
    assert of([1, 1, 0, 2]).ess == pytest.approx(16 / 6)


@given(
    st.lists(st.floats(0, 1e6), min_size=1, max_size=30).filter(lambda w: sum(w) > 1e-3),
    st.integers(1, 200),
    st.integers(0, 2**32),
)
def test_every_index_is_drawn_as_often_as_is_due(weight, count, seed):
    chosen = of(weight).systematic(count, np.random.default_rng(seed))
    assert (np.diff(chosen) >= 0).all()
    times, due = np.bincount(chosen, minlength=len(weight)), count * np.array(weight) / sum(weight)
    assert (np.abs(times - due) < 1 + 1e-6 * count).all()
    assert len(chosen) == count


def test_a_draw_that_rounds_up_to_the_whole_stays_within():
    class Highest:
        def random(self):
            return 1 - 2.0**-53

    assert of([1, 1]).systematic(10_000, Highest()).max() == 1


@pytest.mark.parametrize("low", [0.0, 0.25])
def test_the_highest_power_leaves_as_many_effective_as_asked_for(low):
    """Of 3 states with p = 1 and 5 with q = p^b = exp(-8 b), (3 + 5 q)^2 / (3 + 5 q^2) are effective."""
    start, log_p = np.full(8, -700.0), np.repeat([0.0, -8.0], [3, 5])
    for power in (0.3, 0.5, 0.9):
        q = math.exp(-8 * power)
        least = (3 + 5 * q) ** 2 / (3 + 5 * q**2)
        assert highest_power(start, log_p, least, low) == pytest.approx(power, abs=2**-14)
    assert highest_power(start, log_p, 3.0, low) == 1
    assert highest_power(start, log_p, 8.1, low) == low


def test_spaced_indices_are_where_the_sum_of_the_weights_reaches_their_shares():
    weights = Weights(np.log([1.0, 2.0, 1.0, 4.0]))
    assert weights.spaced(8, 0.5).tolist() == [0, 1, 1, 2, 3, 3, 3, 3]
    assert weights.spaced(2, 0.5).tolist() == [1, 3]
