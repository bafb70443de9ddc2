"""Which methods can be told apart: closed forms, and how often equal methods are called different."""

import itertools
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tactsim.bench.intervals import resampled
from tactsim.bench.leaderboard.ranking import compare_accuracies, compare_errors, holm, ranks


@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 20))
@settings(max_examples=30, deadline=None)
def test_mcnemar_is_the_binomial_of_the_trials_that_differ(won, lost, alike):
    right = np.array([[1] * won + [0] * lost + [1] * alike, [0] * won + [1] * lost + [1] * alike], dtype=bool)
    found = compare_accuracies(right)
    assert found.wins.tolist() == [[0, won], [lost, 0]]
    tail = sum(comb(won + lost, k) for k in range(min(won, lost) + 1)) / 2 ** (won + lost)
    assert found.p[0, 1] == found.p[1, 0] == pytest.approx(min(1, 2 * tail))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_rejects_what_stepping_down_rejects(p):
    rejected, left = set(), len(p)
    for place in np.argsort(p, kind="stable"):  # Holm's own words: stop at the first that fails
        if p[place] * left > 0.05:
            break
        rejected.add(int(place))
        left -= 1
    assert rejected == set(np.flatnonzero(holm(p) <= 0.05).tolist())


@pytest.mark.long
def test_equal_methods_are_seldom_called_different_by_accuracy():
    # 300 tables of five equal methods: in 0.05 at most any pair may differ; 0.088 is three standard errors above.
    rng = np.random.default_rng(1)
    false = [(compare_accuracies(rng.random((5, 100)) < 0.7).p <= 0.05).any() for _ in range(300)]
    assert np.mean(false) <= 0.088


def simulated_errors(rng, methods, shift=0.0, between=0.0, scans=5, trials=40):
    """Log-normal errors that share half of their variance, as methods on the same trials do."""
    shared, own = rng.normal(size=(1, scans * trials)), rng.normal(size=(methods, scans * trials))
    of_scans = between * np.repeat(rng.normal(size=(methods, scans)), trials, axis=1)
    return np.exp(0.5 * shared + 0.5 * own + of_scans) + shift * np.arange(methods)[:, None]


@pytest.mark.parametrize(("between", "at_most"), [(0.0, 0.05), (0.3, 0.24)])
def test_equal_methods_are_seldom_called_different_by_error(between, at_most):
    # Where scans differ nearly three times as much as their trials make them, five scans are too few, as the page says:
    # 0.24 of such tables have a false difference. Three standard errors of 200 tables are allowed for.
    rng = np.random.default_rng(2)
    counts = resampled([40] * 5, rng, draws=400)
    named = np.ones((4, 200), dtype=bool)
    false = [
        (compare_errors(simulated_errors(rng, 4, between=between), named, counts).p <= 0.05).any()
        for _ in range(200)
    ]
    assert np.mean(false) <= at_most + 3 * (at_most * (1 - at_most) / 200) ** 0.5


def test_the_interval_of_a_difference_is_that_of_a_paired_t_test_where_scans_do_not_matter():
    rng = np.random.default_rng(4)
    errors = rng.normal(5, 1, size=(2, 2000)) + rng.normal(size=2000)
    found = compare_errors(errors, np.ones((2, 2000), dtype=bool), resampled([2000], rng, draws=4000))
    wanted = stats.ttest_rel(errors[0], errors[1])
    low, high = wanted.confidence_interval(0.95)
    assert [found.low[0, 1], found.high[0, 1]] == pytest.approx([low, high], abs=0.1 * (high - low))
    assert found.p[0, 1] == pytest.approx(wanted.pvalue, abs=0.04)


def test_only_trials_that_both_named_count():
    errors = np.array([[1.0, 2.0, 50.0, 4.0], [2.0, 4.0, 1.0, 90.0], [np.pi] * 4])
    named = np.array([[1, 1, 1, 0], [1, 1, 0, 1], [0, 0, 0, 0]], dtype=bool)
    found = compare_errors(errors, named, np.ones((10, 4)))
    assert found.difference[0, 1] == pytest.approx(-1.5)
    assert np.isnan(found.difference[0, 2])
    assert found.p[2].tolist() == [1, 1, 1]


def test_a_few_common_trials_tell_nobody_apart():
    errors = np.array([np.full(40, 1.0), np.full(40, 9.0)])
    named = np.arange(40) < 6
    found = compare_errors(
        errors, np.stack([named, named]), resampled([40], np.random.default_rng(0), draws=500)
    )
    assert found.p[0, 1] == 1


@given(st.integers(1, 6), st.integers(0, 2**30))
def test_ranks_hold_the_place_of_every_order_that_the_tests_allow(count, bits):
    pairs = list(itertools.combinations(range(count), 2))
    better = np.zeros((count, count), dtype=bool)
    for number, (i, j) in enumerate(pairs):
        better[i, j] = bits >> number & 1
    found = ranks(better)
    for order in itertools.permutations(range(count)):
        place = {method: at for at, method in enumerate(order, start=1)}
        if all(place[i] < place[j] for i, j in pairs if better[i, j]):
            assert all(low <= place[k] <= high for k, (low, high) in enumerate(found))
