"""Which points lie near a point of another part, against all pairs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactsim.estimators.likelihoods.nearness_kernels import near_another_part


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 4), st.sampled_from([0.3, 1.0, 4.0]))
def test_it_is_what_all_pairs_say(seed, count, parts, near):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 8, (2, count))
    x[: count // 2] = np.round(x[: count // 2])  # many in one column
    x.sort()
    part = rng.integers(0, parts, count)
    away = np.hypot(x[:, None] - x, y[:, None] - y)
    expected = ((away < near) & (part[:, None] != part)).any(axis=1)
    assert np.array_equal(near_another_part(x, y, part, near), expected)
