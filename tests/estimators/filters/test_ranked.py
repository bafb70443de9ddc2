"""The best bins without looking at all of them: against all bins, reading by reading."""

import numpy as np
import pytest
from synthetic import draw_trial, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError, memory

LETTERS = "EILT"


@pytest.fixture(scope="module")
def small():
    return make_scan(LETTERS, poses=paper_poses(positions=3, angles=6))


def fitted(scan, name, **options):
    estimator = estimators.create(name, **options)
    estimator.fit(scan)
    return estimator


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("refined", {"bins": 1000}),
        ("refined", {"split": "17x33x3", "likelihood": "paper"}),
        ("refined", {"split": "40x7x5", "reach": 30.0}),
        ("force-mosaic", {"bins": 1000}),
        ("graded", {"bins": 500, "cells": 10, "halvings": 2}),
        ("refined", {"split": "30x9x2", "halvings": 0}),
    ],
)
def test_the_best_bins_and_their_proof_are_those_of_all_bins(small, name, options):
    lazy, full = fitted(small, name, **options), fitted(small, name, **options, skip=False)
    left_alone = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        trial = draw_trial(small, LETTERS[seed % 4], 5, rng)
        other = draw_trial(small, LETTERS[(seed + 1) % 4], 4, rng)  # which contradicts the first
        lazy.reset(rng)
        full.reset(rng)
        for reading, pose in (*zip(*trial[:2], strict=True), *zip(*other[:2], strict=True)):
            lazy.update(reading, pose)
            full.update(reading, pose)
            everything = full.filter._coarse.log_belief()
            some = lazy.filter._coarse.log_belief()
            known = some > -np.inf
            assert (some[known] == everything[known]).all()
            assert (everything <= lazy.filter._coarse.upper_bounds() + 1e-9).all()
            proof, whole = lazy.certificate(), full.certificate()
            best = np.unravel_index(everything.argmax(), everything.shape)
            assert proof.label == whole.label == LETTERS[best[0]]
            assert proof.robot_in_object.tolist() == whole.robot_in_object.tolist()
            x, y, theta = lazy.grid.centres
            assert proof.robot_in_object.tolist() == [x[best[3]], y[best[2]], theta[best[1]]]
            assert proof.lead >= 0
            assert proof.lead <= everything.max() - np.max(everything[~known], initial=-np.inf) + 1e-9
            assert whole.lead == np.inf
            ours, theirs = lazy.estimate(), full.estimate()
            assert ours.label == theirs.label
            assert ours.probabilities == pytest.approx(theirs.probabilities, abs=1e-9)
            assert ours.robot_in_object == pytest.approx(theirs.robot_in_object, abs=1e-9)
            left_alone += (~known).sum()
    assert left_alone > 0 or options.get("halvings") == 0


@pytest.mark.parametrize(
    ("name", "options", "what"),
    [
        ("histogram", {"bins": 1_000_000}, "4 letters with 999,600 bins each"),
        ("refined", {"split": "100x100x100"}, "4 letters with 1,000,000 bins each"),
        ("force-mosaic", {"bins": 1_000_000}, "4 letters with 999,600 bins each"),
        ("particle", {"particles": 1_000_000}, "1,000,000 particles"),
        ("augmented-mcl", {"particles": 1_000_000}, "1,000,000 particles"),
        ("tempered", {"particles": 1_000_000}, "1,000,000 particles"),
    ],
)
def test_a_budget_that_does_not_fit_in_memory_is_refused_before_anything_is_learned(
    small, name, options, what, monkeypatch
):
    monkeypatch.setattr(memory, "free_memory", lambda: 1e8)
    estimator = estimators.create(name, **options)
    with pytest.raises(InputError, match=f"{what} would take about 0.[23] GB of memory, and 0.1 GB are free"):
        estimator.fit(small)
