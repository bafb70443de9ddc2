"""Draws in proportion to weights."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.estimators.filters.multinomial import draw, sort_uniform


def test_draws_are_in_proportion_to_the_weights():
    rng = np.random.default_rng(0)
    weights = np.array([0.0, 3.0, 1.0, 0.0, 6.0, 0.0])
    chosen = np.empty(100_000, dtype=np.int64)
    draw(chosen, weights, rng.random(len(chosen)))
    assert (np.diff(chosen) >= 0).all()
    shares = np.bincount(chosen, minlength=6) / len(chosen)
    # Five standard deviations of a binomial share.
    assert shares == pytest.approx(weights / 10, abs=5 * 0.5 / math.sqrt(len(chosen)))
    assert shares[[0, 3, 5]].tolist() == [0, 0, 0]


@given(st.lists(st.floats(0, 1, exclude_max=True), max_size=60))
def test_numbers_are_sorted(values):
    array = np.array(values)
    sort_uniform(array)
    assert array.tolist() == sorted(values)
