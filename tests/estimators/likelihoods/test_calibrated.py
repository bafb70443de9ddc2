from dataclasses import replace

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from synthetic import fitted_anew, make_scan, model_of, paper_poses

from tactsim import estimators
from tactsim.core import InputError, Scan, transform
from tactsim.estimators.likelihoods.calibrated import (
    CalibratedLikelihood,
    _blurred,
    calibrate,
    quantile_edges,
)
from tactsim.estimators.likelihoods.classifier import (
    CONTACT,
    NO_CONTACT,
    UNKNOWN,
    classify,
    lehmer_mean,
    threshold_of,
)
from tactsim.estimators.likelihoods.folds import folds, touched_elsewhere
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps, log_odds
from tactsim.estimators.options import LikelihoodOptions


def test_calibrate_counts_by_brute_force():
    rng = np.random.default_rng(0)
    feature, kinds = rng.normal(size=300), rng.integers(4, size=300)
    feature[17] = 7.0  # alone in its bin
    edges = np.array([-5.0, -0.5, 0.5, 0.5, 6.0, 99.0])  # nothing lies outside them, and one comes twice
    got = calibrate(feature, kinds, 4, edges)
    assert len(got.feature) == 4
    for bin, (low, high) in enumerate([(-5, -0.5), (-0.5, 0.5), (0.5, 6), (6, 99)]):
        inside = [k for f, k in zip(feature, kinds, strict=True) if low <= f < high]
        assert got.probability[:, bin] == pytest.approx(
            [(inside.count(k) + 1) / (len(inside) + 4) for k in range(4)]
        )
        assert got(got.feature[bin]) == pytest.approx(got.probability[:, bin])
    middle = got((got.feature[0] + got.feature[1]) / 2)
    assert middle == pytest.approx((got.probability[:, 0] + got.probability[:, 1]) / 2)
    assert got(-100.0) == pytest.approx(got.probability[:, 0])


@pytest.mark.parametrize("bins", [43, 64, 127, 128, 1000])
def test_any_number_of_bins_is_counted_however_narrow_the_classes_are(bins):
    rng = np.random.default_rng(bins)
    feature, kinds = rng.normal(size=20_000), rng.integers(3, size=20_000)
    edges = quantile_edges(feature, bins)
    wide, narrow = (calibrate(feature, kinds.astype(kind), 3, edges) for kind in (np.int64, np.int8))
    assert np.array_equal(narrow.probability, wide.probability)
    assert narrow.probability.shape == (3, bins)


def test_a_taxel_is_judged_by_the_map_without_the_presses_at_its_position():
    scan = make_scan("E", poses=paper_poses(3, 4)).where("train")
    model = model_of("calibrated", scan)
    odds, classes, known = model.left_out(scan)
    assert np.array_equal(classes, classify(scan.readings))
    part = folds(scan)
    assert np.array_equal(known, touched_elsewhere(scan, part))
    at = transform(scan.poses, scan.taxel_xy)
    assert odds[~known] == pytest.approx(model.maps["E"].log_odds_at(at[~known]))
    for number in np.unique(part):
        mine, rest = part == number, part != number
        without = learn_maps(scan.chosen(rest))["E"]
        points = transform(scan.poses[mine], scan.taxel_xy)
        assert odds[mine][known[mine]] == pytest.approx(without.log_odds_at(points)[known[mine]], abs=1e-9)
        left = model.without(scan, mine, ("E",), True)
        prior = log_odds(without.prior)
        steeper = prior + model.steeper * (without.log_odds_at(points) - prior)
        assert left.maps["E"].log_odds_at(points) == pytest.approx(steeper, abs=1e-9)
        kept = model.without(scan, mine, ("E",), False)  # as if some presses of every position were gone
        assert kept.maps["E"].log_odds_at(points) == pytest.approx(without.log_odds_at(points), abs=1e-9)


def test_maps_are_steeper_than_those_without_a_position_by_the_presses_that_these_lack():
    half = OccupancyMap(np.zeros(2), 0.5, np.full((40, 40), -3.0), 0.5)
    whole = replace(half, log_odds=2 * half.log_odds)
    places = np.random.default_rng(0).uniform(8, 12, (50, 2))
    model = CalibratedLikelihood(LikelihoodOptions())
    model.maps = {"E": whole}
    poses, words = np.column_stack([places, np.zeros(50)]), [np.full(50, word) for word in ("E", "train")]
    pressed = Scan(np.ones((50, 1)), poses, *words, np.zeros((1, 2)))
    every = np.full((50, 1), True)
    assert model.steepness(pressed, half.log_odds_at(places)[:, None], every) == pytest.approx(2, rel=1e-6)
    assert model.steepness(pressed, np.zeros((50, 1)), every) == 1


@pytest.mark.parametrize("shape", [(130, 90), (7, 50), (3, 2)])
def test_log_odds_are_averaged_as_scipy_averages(shape):
    values = np.random.default_rng(0).random(shape)
    for width in (3.75, 1.1, 0.4):
        assert _blurred(values, width) == pytest.approx(gaussian_filter(values, width, mode="constant"))


def told_and_seen(model, shift):
    """List what the model says of fresh readings, (3, n), and their classes; checks that it sums to 1."""
    fresh = make_scan(poses=paper_poses() + [shift, shift, np.pi / 12 * (shift > 0)], seed=2).where("test")
    told, seen = [], []
    for label in fresh.letters:
        mine = fresh.where(label=label)
        log_p = model.log_tables(label, transform(mine.poses, mine.taxel_xy))
        assert np.exp(log_p).sum(axis=0) == pytest.approx(1)
        told.append(np.exp(log_p).reshape(3, -1))
        seen.append(classify(mine.readings).ravel())
    return np.concatenate(told, axis=1), np.concatenate(seen)


@pytest.mark.parametrize("shift", [1.2, 1.7])
def test_its_probabilities_are_what_readings_between_the_training_poses_show(scan, shift):
    # Off the lattice is where a user touches. The probabilities are learned from lattice positions 6.8 mm from those
    # that their map holds; these are nearer, and turned to the middle between two trained angles. A table counted
    # from taxels that are judged by a map that holds their own presses fails here, though not in surprise above.
    told, seen = told_and_seen(model_of("calibrated", scan), shift)
    for kind in range(3):
        tenth = np.minimum(told[kind] * 10, 9).astype(int)
        gaps = [abs(np.sum((seen == kind) - told[kind], where=tenth == k)) for k in range(10)]
        assert np.sum(gaps) / len(seen) < 0.05, (kind, gaps)  # a mean gap of 5 points in 100
    surprise = -np.log(told[seen, np.arange(len(seen))]).mean()
    assert surprise == pytest.approx(-(told * np.log(told)).sum(axis=0).mean(), abs=0.08)


@pytest.fixture(scope="module")
def shapes():
    return make_scan("EILT", poses=paper_poses(positions=4, angles=4))


def test_only_the_complement_makes_equation_7_a_distribution(shapes):
    sums = {}
    for failure in ("printed", "complement"):
        filter = fitted_anew("histogram", shapes, bins=100, failure=failure)
        sums[failure] = np.exp(filter.likelihood.log_tables("E", [[0.0, 0.0], [8.0, 3.0]])).sum(axis=0)
    assert sums["complement"] == pytest.approx([1, 1])
    assert sums["printed"] == pytest.approx([0.94, 0.94])  # gamma (2 p(m) - 1) short of one


def test_classes_agree_with_equation_3_taxel_by_taxel():
    rng = np.random.default_rng(0)
    names = {CONTACT: reference.CONTACT, NO_CONTACT: reference.NO_CONTACT, UNKNOWN: reference.UNKNOWN}
    for scale in (0.5, 3.0, 30.0):
        for reading in np.round(rng.normal(0, scale, size=(50, 36)) / 0.7) * 0.7:
            assert [names[k] for k in classify(reading)] == reference.classify(reading)
    # Below zero after a tare, at the threshold, and several readings at once.
    below = np.array([[-3.0, -1.0, -0.2], [2.0, 2.0, 1.0], [6.67, 2.0, 2.1]])
    assert [[names[k] for k in row] for row in classify(below)] == [reference.classify(r) for r in below]


SCAN = make_scan("EL", poses=paper_poses(4, 6))


@given(st.floats(1e-6, 1e6))
@settings(max_examples=30, deadline=None)
def test_classes_with_an_automatic_threshold_do_not_depend_on_the_unit(unit):
    train = SCAN.where("train").readings
    usual = threshold_of("auto", train)
    other = threshold_of("auto", unit * train)
    assert other == pytest.approx(unit * usual)
    clear = np.abs(train - usual) > 1e-9
    clear &= np.abs(train - 0.3 * train.max(axis=1, keepdims=True)) > 1e-9
    assert np.array_equal(classify(unit * train, other)[clear], classify(train, usual)[clear])


def test_a_threshold_that_is_given_is_taken():
    assert threshold_of(3.5, SCAN.readings) == 3.5
    assert threshold_of("auto", np.zeros((4, 36))) == 0
    even = np.full((5, 36), 18.0)
    assert threshold_of("auto", even) == pytest.approx(1.0)
    assert lehmer_mean(even) == pytest.approx(18.0)


def test_a_word_that_is_no_threshold_is_refused():
    with pytest.raises(InputError, match="threshold"):
        estimators.create("refined", threshold="automatic")
