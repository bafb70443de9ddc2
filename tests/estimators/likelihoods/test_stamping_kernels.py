"""What taxels add to the cells around them, against eq. 5 and 6 cell by cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, log_odds, log_odds_of


def literal(kind, squared, sigma, peak, prior):
    """Eq. 4 to 6 as they are printed, without what p(m) adds."""
    g = peak * np.exp(-2 * squared / sigma**2)
    occupied = prior + (1 - prior) * g if kind == CONTACT else prior * (1 - g)
    free = (1 - prior) * (1 - g) if kind == CONTACT else 1 - prior + prior * g
    return np.log(occupied / free) - np.log(prior / (1 - prior))


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.3, 5),
    st.sampled_from([0.1, 0.4, 1.0]),
    st.sampled_from([1e-3, 0.2, 0.5, 0.99]),
    st.sampled_from([0.01, 0.9, 1 - 1e-9]),
)
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
