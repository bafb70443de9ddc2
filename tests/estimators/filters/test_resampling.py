"""Drawing from weights: systematic resampling is exact in its counts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactsim.estimators.filters.resampling import systematic


@given(
    st.lists(st.floats(0, 1e6), min_size=1, max_size=30).filter(lambda w: sum(w) > 1e-3),
    st.integers(1, 200),
    st.integers(0, 2**32),
)
def test_every_index_is_drawn_as_often_as_is_due(weight, count, seed):
    weight = np.array(weight)
    chosen = systematic(weight, count, np.random.default_rng(seed))
    assert (np.diff(chosen) >= 0).all()
    times, due = np.bincount(chosen, minlength=len(weight)), count * weight / weight.sum()
    assert (np.abs(times - due) < 1 + 1e-6 * count).all()
    assert len(chosen) == count


def test_the_first_draw_is_uniform():
    weight = np.array([1.0, 3.0])
    first = [systematic(weight, 1, np.random.default_rng(seed))[0] for seed in range(2000)]
    assert abs(np.mean(first) - 0.75) < 4 * np.sqrt(0.75 * 0.25 / 2000)


def test_a_draw_that_rounds_up_to_the_whole_stays_within():
    # Of the smallest number there is, any share above a half is rounded up to the whole.
    smallest = np.array([0.0, 5e-324])
    for seed in range(20):
        assert systematic(smallest, 3, np.random.default_rng(seed)).max() <= 1
