"""How much a sequence counts, where the right answer is known: likelihoods that are exact, and too sure by a factor."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import fitted_anew, make_scan, paper_poses

from tactsim.core import compose
from tactsim.estimators.filters import trust
from tactsim.estimators.filters.trust import learn_trust
from tactsim.estimators.filters.trust_kernels import (
    influence,
    influence_in_sequences,
    mostly_held,
    sums_of_readings,
)


def test_moves_turn_about_the_centre_and_have_the_sizes_that_are_said():
    centre = np.array([3.0, -2.0])
    shift, size, states = trust._moves(centre, 4096)
    moved = np.array([compose(state, [*centre, 0.0]) for state in states.T])
    assert moved[:, :2] - centre == pytest.approx(shift)
    assert np.hypot(np.hypot(*shift.T), trust._GYRATION * moved[:, 2]) == pytest.approx(size)


LETTERS, READINGS = ("E", "I", "L", "O", "U"), 192


def gaussian(rng, too_sure, share=0.0):
    """Make a stand-in for left-out readings: Gaussians about places drawn from them, log p times a factor.

    They are 0.4 mm wide. share: what a position has of the map; with it there its presses err by so much less, and
    without it by so much more.
    """

    def left_out(likelihood, train, labels, states):
        shift, _, _ = trust._moves(np.zeros(2), states.shape[1])
        place = np.column_stack([shift, trust._GYRATION * states[2]])
        for error in (1 - share, 1 / (1 - share)):
            seen = rng.normal(size=(len(LETTERS), READINGS, 3)) * math.sqrt(error)
            yield [
                trust._LeftOut(
                    -too_sure * ((place[None] / 0.4 - one[:, None]) ** 2).sum(axis=2) / 2, np.zeros(READINGS)
                )
                for one in seen
            ]

    return left_out


class Train(SimpleNamespace):
    def __len__(self):
        return len(LETTERS) * READINGS


SCAN = SimpleNamespace(where=lambda split: Train(letters=LETTERS, poses=np.zeros((3, 3))))


def known(too_sure):
    """Give 1 / the right weight: what makes up for `too_sure`, and the error of a mean over all training readings."""
    return [too_sure * (1 + n / READINGS) for n in (3, 8, 20)]


@pytest.mark.parametrize("too_sure", [1.0, 5.0])
def test_a_gaussian_likelihood_that_is_too_sure_gets_the_weight_that_makes_up_for_it(monkeypatch, too_sure):
    """The misfit of a normal error is half a chi squared, and the jackknife sees all of it."""
    monkeypatch.setattr(trust, "_left_out", gaussian(np.random.default_rng(1), too_sure))
    learned = learn_trust(SimpleNamespace(moves=1024), SCAN)
    assert [1 / learned(n) for n in (3, 8, 20)] == pytest.approx(known(too_sure), rel=0.2)
    assert (learned.few, learned.many) == pytest.approx((1, 1), rel=0.2)
    assert learned.misfit.mean == pytest.approx(1.5 * too_sure, rel=0.1)  # of three degrees of freedom
    assert learned.misfit.deviation == pytest.approx(math.sqrt(1.5) * too_sure, rel=0.1)


def test_what_presses_at_one_position_share_is_found_from_both_ways_of_leaving_out(monkeypatch):
    # The error of a press by itself, and of the map.
    monkeypatch.setattr(trust, "_left_out", gaussian(np.random.default_rng(1), 2.0, share=0.4))
    learned = learn_trust(SimpleNamespace(moves=1024), SCAN)
    assert [1 / learned(n) for n in (3, 8, 20)] == pytest.approx(known(2.0 * 1.4), rel=0.15)


@given(st.floats(0.5, 10), st.floats(0, 1), st.floats(0, 1))
def test_more_readings_never_say_less(own, growth, shared):
    learned = trust.Trust(own, growth * own, shared)
    said = [n * learned(n) for n in range(1, 300)]
    assert np.all(np.diff(said) > 0)


def test_a_likelihood_that_cannot_leave_readings_out_counts_fully():
    scan = make_scan("EI", poses=paper_poses(3, 4))
    estimator = fitted_anew("refined", scan, likelihood="paper", bins=500)
    assert learn_trust(estimator.likelihood, scan)(20) == 1


def expected_influence(learned, readings):
    """Give the influence of readings that err as those of training do."""
    shown = learned._seen(readings) * learned._apart(readings)
    return shown * (readings - 1) / (learned(readings) * readings**2)


LEARNED = trust.Trust(own=1.5, growth=0.2, shared=0.01, few=0.7, many=0.9)


@given(st.integers(2, 500), st.floats(0, 10), st.floats(0.01, 10))
def test_the_more_readings_disagree_the_less_they_count(readings, disagree, more):
    usual = expected_influence(LEARNED, readings)
    before = LEARNED.given(readings, disagree * usual)
    assert before > LEARNED.given(readings, (disagree + more) * usual) > 0


def test_what_readings_tell_of_themselves_counts_as_their_number_says():
    # Of a variance whose prior is worth 20 readings; what all readings share is not seen and not changed.
    for readings in (2, 5, 20, 200):
        corrected = LEARNED.given(readings, 3 * expected_influence(LEARNED, readings))
        apart = LEARNED._apart(readings) * (20 + 3 * (readings - 1)) / (20 + readings - 1)
        assert 1 / corrected == pytest.approx(apart + LEARNED.shared * readings)


@pytest.mark.parametrize("unknown", [math.nan, 5.0])
def test_where_nothing_is_known_of_how_readings_disagree_the_weight_is_that_of_training(unknown):
    learned = LEARNED if math.isnan(unknown) else trust.Trust(own=1.5, growth=0.2, shared=0.01)
    assert [learned.given(n, unknown) for n in (1, 2, 9)] == [learned(n) for n in (1, 2, 9)]
    assert LEARNED.given(1, 5.0) == LEARNED(1)


@pytest.mark.parametrize("seed", range(3))
def test_sequences_whose_region_excludes_no_move_are_counted_as_defined(seed):
    rng = np.random.default_rng(seed)
    log_p, shift = rng.normal(scale=9, size=(40, 64)), rng.normal(size=(64, 2))
    log_volume, weight = rng.normal(size=64), 0.4
    shares = []
    for of_sequence in log_p:
        belief = np.exp(weight * of_sequence + log_volume)
        belief /= belief.sum()
        mean = belief @ shift
        nearer = np.linalg.norm(shift - mean, axis=1) < np.linalg.norm(mean)
        shares.append(belief[nearer].sum())
    answers, order, along = [], rng.permutation(40), np.ascontiguousarray(shift.T)
    for share in np.linspace(0.05, 0.95, 19):
        answers.append(np.mean(np.array(shares) < share) > share)
        # In any order, and in the one that the share before has left.
        assert mostly_held(log_p, order, weight, log_volume, along, share) == answers[-1]
        assert mostly_held(log_p, np.arange(40), weight, log_volume, along, share) == answers[-1]
        assert sorted(order) == list(range(40))
    assert 0 < np.mean(answers) < 1


def test_one_sequence_of_training_in_twenty_is_badly_explained():
    rng, misfit = np.random.default_rng(3), trust.Misfit(9.0, 5.0)
    sums = rng.normal(9.0, 5.0, (20_000, 8)).sum(axis=1)
    assert np.mean([misfit.unexplained(8, one) > 0 for one in sums]) == pytest.approx(0.05, abs=0.008)
    most = 72 + 1.645 * 5 * math.sqrt(8)
    assert misfit.unexplained(8, 200.0) == pytest.approx(200 - most)
    assert misfit.dispersion(8, misfit.unexplained(8, 200.0)) == pytest.approx(200 / most)
    assert misfit.dispersion(8, 0.0) == 1
    assert trust.Misfit(0.0, 0.0).dispersion(8, 3.0) == 4  # what a pad of no noise has learned


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
