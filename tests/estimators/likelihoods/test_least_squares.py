"""Least squares without negative unknowns: against SciPy, and by the conditions that hold at a minimum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from tactsim.estimators.likelihoods.least_squares import non_negative


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_the_factors_are_those_of_scipy(seed, count):
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(count + rng.integers(0, 40), count)) * 10.0 ** rng.integers(-12, 13, count)
    wanted = rng.normal(size=len(columns))
    assert non_negative(columns, wanted) == pytest.approx(nnls(columns, wanted)[0], rel=1e-6, abs=1e-30)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_no_small_change_comes_nearer(seed, count):
    """Karush, Kuhn and Tucker: the error falls in no direction that is allowed."""
    rng = np.random.default_rng(seed)
    columns, wanted = rng.normal(size=(6, count)), rng.normal(size=6)
    factors = non_negative(columns, wanted)
    rises = columns.T @ (columns @ factors - wanted)
    assert (factors >= 0).all()
    assert rises[factors > 0] == pytest.approx(0, abs=1e-9)
    assert (rises[factors == 0] > -1e-4).all()


@pytest.mark.parametrize("share", [0.003, 0.5, 2.0, 300.0])
def test_of_columns_that_are_alike_one_is_used_that_needs_the_smaller_factor(share):
    rng = np.random.default_rng(1)
    one, other = rng.uniform(1, 2, (2, 5))
    found = non_negative(np.column_stack([share * one, one, other]), 3 * one + 2 * other)
    assert found == pytest.approx([3 / share if share > 1 else 0, 3 if share < 1 else 0, 2])


def test_nothing_is_fitted_to_nothing_or_by_columns_that_lead_away():
    assert (non_negative(np.eye(3), np.zeros(3)) == 0).all()
    assert (non_negative(np.zeros((3, 2)), np.ones(3)) == 0).all()
    assert (non_negative(np.ones((3, 2)), -np.ones(3)) == 0).all()
