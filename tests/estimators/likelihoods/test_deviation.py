"""The distribution of relative pressures against numerical integrals and against what it was drawn from."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.estimators.likelihoods.deviation import Deviation, integral, learn_deviation, non_negative

LEVELS = np.linspace(-0.25, 1.4, 16)


@settings(max_examples=50, deadline=None)
@given(
    st.floats(-0.3, 1.5), st.floats(0, 2), st.floats(1e-3, 1e4), st.floats(0.01, 1),
    st.lists(st.floats(0, 5), min_size=4, max_size=4),
)  # fmt: skip
def test_between_the_levels_too_it_integrates_to_one(predicted, slope, scale, stray, variance):
    background = np.linspace(1, 3, 16) / 2 / 1.65
    deviation = Deviation(np.array(variance), stray, LEVELS, background)
    log_p = deviation.log_density(np.array([predicted]), np.array([slope]), scale)
    assert np.isfinite(log_p).all()
    fine = np.linspace(-0.25, 1.4, 15 * 2000 + 1)
    assert np.trapezoid(np.exp(np.interp(fine, LEVELS, log_p[:, 0])), fine) == pytest.approx(1, abs=1e-4)


def test_the_integral_of_a_straight_line_is_the_closed_form():
    assert integral(3 * LEVELS, LEVELS) == pytest.approx((np.exp(4.2) - np.exp(-0.75)) / 3)
    assert integral(np.full((16, 2), 0.7), LEVELS) == pytest.approx(1.65 * np.exp(0.7))


def test_it_finds_the_variance_and_the_share_of_strays_of_what_it_is_given():
    rng = np.random.default_rng(0)
    n = 60_000
    predicted, slope = rng.uniform(0, 1, n), rng.uniform(0, 0.2, n)
    scale = rng.uniform(20, 80, n)
    true = np.array([4.0, 0.001, 0.03, 0.002])
    spread = true[0] / scale**2 + true[1] + true[2] * slope + true[3] * predicted**2
    relative = predicted + np.sqrt(spread) * rng.standard_normal(n)
    stray = rng.random(n) < 0.1
    relative[stray] = rng.uniform(-0.2, 1.3, stray.sum())
    got = learn_deviation(relative, predicted, slope, scale, LEVELS)
    assert got.stray == pytest.approx(0.1, abs=0.015)
    found = (
        got.variance[0] / scale**2
        + got.variance[1]
        + got.variance[2] * slope
        + got.variance[3] * predicted**2
    )
    assert np.abs(found / spread - 1).mean() < 0.05
    assert got.variance[0] == pytest.approx(4, rel=0.15)
    assert got.variance[2] == pytest.approx(0.03, rel=0.15)
    assert got.background.sum() * (LEVELS[1] - LEVELS[0]) == pytest.approx(1)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_no_small_change_comes_nearer(seed, count):
    """Karush, Kuhn and Tucker: the error falls in no direction that is allowed, however large columns are."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.integers(-12, 13, count)
    columns = rng.normal(size=(count + rng.integers(0, 40), count))
    wanted = rng.normal(size=len(columns))
    factors = non_negative(columns * size, wanted) * size
    rises = columns.T @ (columns @ factors - wanted)
    assert (factors >= 0).all()
    assert rises[factors > 0] == pytest.approx(0, abs=1e-9)
    assert (rises[factors == 0] > -1e-9).all()
