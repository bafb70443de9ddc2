"""The graded model: its counts by brute force, and that neither load, unit nor response decide the answer."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, follow, make_scan, model_of, paper_poses

from tactsim.estimators.likelihoods.folds import folds, touched_elsewhere
from tactsim.estimators.likelihoods.graded import _GRADES, _SHARES


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(4, 6))


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
