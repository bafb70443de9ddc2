"""By how much readings move a belief, against closed forms and NumPy by definition."""

import math

import numpy as np
import pytest
from synthetic import fitted_anew, follow, make_scan, paper_poses

from tactsim.core import invert
from tactsim.estimators.filters.trust_kernels import (
    influence,
    influence_at,
    influence_in_sequences,
    sums_of_readings,
)


def by_definition(log_p, weight, place):
    """Compute the mean over readings of cov(place, log p)' cov(place)^-1 cov(place, log p) / 2."""
    share = weight / weight.sum()
    away = place - (place @ share)[:, None]
    moved = (away * share) @ log_p.T
    return np.mean(np.sum(moved * np.linalg.solve((away * share) @ away.T, moved), axis=0)) / 2


@pytest.mark.parametrize("readings", [1, 2, 7])
def test_it_is_the_squared_covariance_of_place_and_log_p_in_units_of_the_variance(readings):
    rng = np.random.default_rng(1)
    log_p, weight, place = rng.normal(size=(readings, 50)), rng.random(50), rng.normal(size=(2, 50))
    assert influence(log_p, weight, place) == pytest.approx(by_definition(log_p, weight, place))
    # In any unit of the weights, with anything that all states have in common, and from any origin.
    assert influence(log_p - 1e3, 7 * weight, place + 5) == pytest.approx(by_definition(log_p, weight, place))


def test_at_states_it_is_that_of_what_the_field_says_there():
    scan = make_scan("EL", poses=paper_poses(3, 6))
    estimator = fitted_anew("refined", scan, bins=500, cell=0.8)
    test = scan.where("test", "L")
    follow(estimator, test.readings[:6], test.poses[:6])
    field = estimator.field
    state = np.random.default_rng(2).normal(scale=[[2.0], [2.0], [1.0]], size=(3, 40))
    log_p = np.array([field.log_p(1, state, one, one + 1) for one in range(2, 6)])
    found = influence_at(state, 1, field.terms, 2, 6, field.tables.sampled)
    assert found == pytest.approx(by_definition(log_p, np.ones(40), invert(state.T)[:, :2].T))


def test_in_sequences_it_is_the_mean_over_them_with_moves_the_other_way_in_mirrored_readings():
    rng = np.random.default_rng(3)
    log_p, shift, log_volume = rng.normal(size=(12, 30)), rng.normal(size=(2, 30)), rng.normal(size=30)
    drawn = np.array([rng.permutation(12)[:4] for _ in range(9)])
    mirrored, weight, expected = rng.integers(2, size=drawn.shape), 0.7, []
    for which, turned in zip(drawn, mirrored, strict=True):
        of_move = np.array(
            [np.roll(log_p[k], 15) if other else log_p[k] for k, other in zip(which, turned, strict=True)]
        )
        belief = np.exp(weight * of_move.sum(axis=0) + log_volume)
        expected.append(by_definition(of_move, belief, shift))
    sums = sums_of_readings(log_p, drawn, mirrored)
    found = influence_in_sequences(log_p, drawn, mirrored, sums, weight, log_volume, shift)
    assert found == pytest.approx(np.mean(expected), rel=1e-4)  # moves with less than e^-12 are left out
    nowhere = np.zeros_like(shift)
    assert math.isnan(influence_in_sequences(log_p, drawn, mirrored, sums, weight, log_volume, nowhere))
