"""The distribution of relative pressures against numerical integrals and against what it was drawn from."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import draw_trial, fitted_anew, follow, make_scan, model_of, paper_poses

from tactsim.core import transform
from tactsim.estimators.likelihoods.deviation import Deviation, integral, learn_deviation, non_negative
from tactsim.estimators.likelihoods.folds import folds, touched_elsewhere
from tactsim.estimators.likelihoods.graded import _GRADES, _SHARES
from tactsim.estimators.likelihoods.likelihood import BUILT_IN

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
    assert integral(np.exp(3 * LEVELS), 3 * LEVELS, LEVELS) == pytest.approx(
        (np.exp(4.2) - np.exp(-0.75)) / 3
    )
    rise = np.array([0, 1e-4, 9e-3, 2e-2])
    log_p, ends = rise * LEVELS[:, None], np.exp(rise[1:] * LEVELS[[0, -1], None])
    exact = np.append(1.65, (ends[1] - ends[0]) / rise[1:])
    assert integral(np.exp(log_p), log_p, LEVELS) == pytest.approx(exact, rel=1e-11)


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


every_model = pytest.mark.parametrize("name", BUILT_IN)


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(4, 6))


@every_model
def test_tables_are_finite_and_constant_beyond_the_extent(name, scan):
    model = model_of(name, scan)
    low, high = model.extent
    xy = np.random.default_rng(0).uniform(low - 5, high + 5, (200, 2))
    for label in scan.letters:
        tables = model.log_tables(label, xy)
        assert tables.shape[1] == 200
        assert np.isfinite(tables).all()
        beyond = model.log_tables(label, np.array([high + 10, low - 10, high + 1e6]))
        assert np.allclose(beyond, beyond[:, :1])


@every_model
def test_evidence_names_tables_and_taxels_that_exist(name, scan):
    model = model_of(name, scan)
    tables = len(model.log_tables("E", np.zeros(2)))
    for reading in (*scan.readings[:20], np.zeros(36), np.full(36, 1e4), -np.ones(36)):
        model.evidence(reading).check(tables, 36)


@every_model
def test_the_true_place_says_more_than_others(name, scan):
    model, test = model_of(name, scan), scan.where("test", "E")
    shifts = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0], [-5, 0, 0], [0, -5, 0]])
    ahead = []
    for reading, pose in zip(test.readings[:30], test.poses[:30], strict=True):
        terms = model.evidence(reading)
        log_p = []
        for xy in transform(pose + shifts, scan.taxel_xy):
            tables = model.log_tables("E", xy[terms.taxel])
            log_p.append(terms.weight @ tables[terms.table, np.arange(len(terms.table))])
        ahead.append(log_p[0] > np.mean(log_p[1:]))
    assert np.mean(ahead) > 0.8


def test_a_grade_says_between_which_shares_of_its_scale_a_taxel_lies(scan):
    model = model_of("graded", scan)
    reading = np.zeros(36)
    reading[:8] = [40, 40, 40, 40, 25, 17, 9, 3]
    grades, scale = model.graded(reading)
    assert scale == pytest.approx((reading**4).sum() / (reading**3).sum())
    assert grades.tolist() == [int((value / scale > _SHARES).sum()) for value in reading]
    assert grades[:4].tolist() == [6] * 4
    assert model.graded(1e3 * reading)[0].tolist() == grades.tolist()
    assert model.graded(np.zeros(36))[1] == model.least > 0


def test_grades_are_counted_as_by_brute_force(scan):
    model = model_of("graded", scan, quantiles=1)
    counts = np.ones((3, _GRADES))
    scales = [model.graded(reading)[1] for reading in scan.where("train").readings]
    lower, upper = np.quantile(scales, [1 / 3, 2 / 3])
    for label in scan.letters:
        letter = scan.where("train", label)
        for reading, known in zip(letter.readings, touched_elsewhere(letter, folds(letter)), strict=True):
            grades, scale = model.graded(reading)
            for grade in grades[known]:
                counts[int(scale > lower) + int(scale > upper), grade] += 1
    expected = counts / counts.sum(axis=1, keepdims=True)
    table = np.exp(model.log_tables("E", np.zeros((1, 2))))
    assert table[:, 0].reshape(3, _GRADES) == pytest.approx(expected)


def test_graded_stands_presses_of_varied_load_and_a_bent_response(scan):
    rng = np.random.default_rng(3)
    load = np.exp(0.5 * rng.standard_normal(len(scan.readings)))
    bent = replace(scan, readings=25 * (np.maximum(scan.readings * load[:, None], 0) / 25) ** 1.7)
    estimator = fitted_anew("graded", bent, bins=2000)
    for seed, label in enumerate("EIL"):
        readings, poses, _ = draw_trial(bent, label, 8, np.random.default_rng(seed))
        assert follow(estimator, readings, poses)[-1].label == label
