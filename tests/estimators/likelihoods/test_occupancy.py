import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.core import Scan
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps, log_odds, log_odds_of, sigmoid


def one_reading(value, pose=(0.0, 0.0, 0.0), taxel_xy=((0.0, 0.0),)):
    values = np.atleast_2d(value).astype(float)
    return Scan(values, np.array([pose]), np.array(["X"]), np.array(["train"]), np.array(taxel_xy))


@pytest.mark.parametrize("prior", [0.01, 0.5, 0.99])
def test_a_map_reaches_as_far_as_an_taxel_says_anything(prior):
    # Where eq. 5 and 6 have fallen to 1e-12, and in whole cells not a cell further than that.
    def said(away):
        g = 0.9 * math.exp(-2 * away**2)
        return max(g * (1 - prior) / prior, g * prior / (1 - prior))

    left, right, bottom, top = learn_maps(one_reading(10.0), prior=prior, cell=0.1)["X"].extent
    assert (left, bottom) == (pytest.approx(-right), pytest.approx(-top))
    assert max(said(-left), said(right), said(-bottom), said(top)) < 3e-12
    assert min(said(-left - 0.2), said(right - 0.2), said(-bottom - 0.2), said(top - 0.2)) > 1e-13


def test_interpolation_is_bilinear_inside_and_the_prior_outside():
    chart = OccupancyMap(np.array([1.0, 2.0]), 0.5, np.array([[1.0, 3.0], [5.0, -1.0]]), 0.5)
    assert chart.log_odds_at([1.0, 2.0]) == 1
    assert chart.log_odds_at([1.5, 2.5]) == -1
    assert chart.log_odds_at([1.25, 2.0]) == 2
    assert chart.log_odds_at([1.25, 2.25]) == 2
    assert chart.log_odds_at([0.75, 2.0]) == 0.5  # halfway to the prior's frame
    assert chart.log_odds_at([[-50.0, 2.0], [1.2, 1e6]]).tolist() == [0, 0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_map_that_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="not finite"):
        OccupancyMap(np.zeros(2), 1.0, np.array([[0.0, bad]]), 0.2)


def test_log_odds_and_probabilities_are_inverse_without_overflow():
    assert sigmoid(log_odds(0.2)) == pytest.approx(0.2)
    assert sigmoid(np.array([-1e5, -800.0, 0.0, 800.0, 1e5])).tolist() == [0, 0, 0.5, 1, 1]
    assert sigmoid(-40.0) == pytest.approx(math.exp(-40))


def literal(kind, squared, sigma, peak, prior):
    """Eq. 4 to 6 as they are printed, without what p(m) adds."""
    g = peak * np.exp(-2 * squared / sigma**2)
    occupied = prior + (1 - prior) * g if kind == CONTACT else prior * (1 - g)
    free = (1 - prior) * (1 - g) if kind == CONTACT else 1 - prior + prior * g
    return np.log(occupied / free) - np.log(prior / (1 - prior))


@settings(deadline=None, max_examples=30)
@given(
    st.integers(0, 2**32 - 1), st.floats(0.3, 5), st.sampled_from([0.1, 0.4, 1.0]),
    st.sampled_from([1e-3, 0.2, 0.5, 0.99]), st.sampled_from([0.01, 0.9, 1 - 1e-9]),
)  # fmt: skip
def test_every_cell_gets_what_the_equations_say(seed, sigma, cell, prior, peak):
    rng = np.random.default_rng(seed)
    shape, origin = (23, 31), np.array([-4.0, 2.0])
    chart = OccupancyMap(origin, cell, np.zeros(shape), prior)
    # Some taxels lie beyond the map's rim.
    xy = origin + cell * rng.uniform(-3, 34, (12, 2))
    classes = rng.integers(0, 3, 12).astype(np.int8)
    x = origin[0] + cell * np.arange(shape[1])
    y = origin[1] + cell * np.arange(shape[0])
    expected = np.zeros(shape)
    for place, kind in zip(xy, classes, strict=True):
        if kind in (CONTACT, NO_CONTACT):
            squared = (x - place[0]) ** 2 + (y[:, None] - place[1]) ** 2
            expected += literal(kind, squared, sigma, peak, prior)
    found = log_odds_of(chart, xy, classes, sigma, peak)
    # A taxel is left out where it says less than 1e-12; the sums as printed round, the more the nearer p(m) is to 1.
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-10)


def test_a_taxel_that_says_little_says_it_exactly():
    # Far from its centre a taxel's log-odds are small, and the logarithm of a ratio near 1 would round them off.
    chart = OccupancyMap(np.zeros(2), 0.1, np.zeros((1, 60)), 0.2)
    found = log_odds_of(chart, np.array([[0.0, 0.0]]), np.array([CONTACT], dtype=np.int8), 1.0, 0.9)[0]
    g = 0.9 * np.exp(-2 * (0.1 * np.arange(60)) ** 2)
    exact = np.log1p(4 * g) - np.log1p(-g)
    near = g > 1e-11
    assert found[near] == pytest.approx(exact[near], rel=1e-12)
    assert not found[-1]
    assert log_odds(0.2) < 0
