"""Tempered particles against closed forms, against themselves without skipping, and on hidden letters."""

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, follow, make_scan, paper_poses

from tactsim.core import Scan, transform
from tactsim.estimators.filters.states import Weights

LETTERS = "EIL"


@pytest.fixture(scope="module")
def scan():
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


@pytest.mark.long
def test_the_evidence_of_one_reading_is_the_mean_likelihood_over_the_prior(scan):
    # A classifier that often fails makes a likelihood without needles, which plain sampling can integrate.
    estimator = fitted_anew("tempered", scan, particles=30_000, likelihood="paper", gamma=0.8)
    readings, poses, *_ = draw_trial(scan, "E", 1, np.random.default_rng(3))
    ratios = []
    for seed in range(6):
        estimator.reset(np.random.default_rng(seed))
        estimator.update(readings[0], poses[0])
        p = estimator.estimate().probabilities
        ratios.append([np.log(p["I"] / p["E"]), np.log(p["L"] / p["E"])])

    rng = np.random.default_rng(2)
    states = np.column_stack([rng.uniform(-10, 10, (100_000, 2)), rng.uniform(-np.pi, np.pi, 100_000)])
    evidence = estimator.likelihood.evidence(readings[0])
    points = transform(states, transform(poses[0], estimator.taxel_xy)[evidence.taxel])
    mean = {}
    for label in estimator.labels:
        tables = estimator.likelihood.log_tables(label, points)
        log_p = tables[evidence.table, :, np.arange(len(evidence.table))].sum(axis=0)
        mean[label] = Weights(log_p).log_mean
    expected = [mean["I"] - mean["E"], mean["L"] - mean["E"]]
    assert np.mean(ratios, axis=0) == pytest.approx(expected, abs=0.1)
    assert np.std(ratios, axis=0).max() < 0.2


def test_letters_that_are_alike_have_the_same_answers_to_the_bit(scan):
    train = scan.where("train")
    one, other = (train.where(label=label) for label in LETTERS[:2])
    parts = [("P", one), ("Q", other), ("R", one), ("S", one)]
    copies = Scan(
        np.concatenate([part.readings for _, part in parts]),
        np.concatenate([part.poses for _, part in parts]),
        np.concatenate([np.repeat(label, len(part)) for label, part in parts]),
        np.concatenate([part.split for _, part in parts]),
        scan.taxel_xy,
    )
    estimator = fitted_anew("tempered", copies, particles=1200)
    for seed in range(4):
        drawn = draw_trial(scan, LETTERS[seed % 2], 6, np.random.default_rng(seed))
        for estimate in follow(estimator, *drawn[:2], seed):
            p = estimate.probabilities
            assert p["P"] == p["R"] == p["S"]
