"""The least distance that holds a share of a belief, and distances to one placement and to many."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.bench.placement import Properties, placement_error
from tactsim.bench.placement_kernels import radius

NUMBERS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 5)), min_size=1, max_size=40)


@given(NUMBERS, st.floats(0.01, 1))
def test_the_radius_is_the_first_in_order_that_holds_the_share(pairs, share):
    # Whole numbers, so that sums are exact in any order; many distances are equal.
    away, weights = np.array(pairs, dtype=float).T.copy()
    order = np.argsort(away)
    held = np.cumsum(weights[order])
    expected = away[order][np.searchsorted(held, share * held[-1])]
    if weights.any():
        assert radius(away, weights, share) == expected
    assert radius(away, weights, share) in away


@pytest.mark.parametrize("count", [1, 2, 1000])
def test_a_share_that_rounding_keeps_out_of_reach_takes_the_farthest(count):
    away = np.arange(1.0, count + 1)
    assert radius(away, np.full(count, 0.1), 1 + 1e-12) == count


@given(st.integers(0, 2**32 - 1), st.integers(0, 5))
def test_one_placement_for_all_and_one_for_each_are_measured_alike(seed, symmetry):
    rng = np.random.default_rng(seed)
    of = Properties(symmetry, (0.7, -1.1), 60.0)
    estimated, true = rng.normal(scale=5, size=(4, 6, 3)), rng.normal(scale=5, size=(6, 3))
    every = placement_error(estimated, true, of)
    assert every.shape == (4, 6)
    for k in range(6):
        assert np.array_equal(placement_error(estimated[:, k], true[k], of), every[:, k])
    assert np.array_equal(placement_error(true, estimated, of), every) or symmetry > 2
    assert placement_error(true, estimated, of) == pytest.approx(every, abs=1e-9)
    assert placement_error(estimated[0, 0], true[0], of).shape == ()


@pytest.mark.parametrize("count", [1, 4])
def test_samples_that_may_not_be_written_are_measured_as_others_are(count):
    of = Properties(symmetry=1, centre=(1.0, 2.0), inertia_over_mass=60.0)
    poses, weights = np.random.default_rng(0).normal(size=(count, 3)), np.full(count, 1 / count)
    away = placement_error(poses, poses[0], of)
    held = radius(away, weights, 0.9)
    for array in (poses, weights):
        array.flags.writeable = False
    assert placement_error(poses, poses[0], of).tolist() == away.tolist()
    assert radius(away, weights, 0.9) == held
