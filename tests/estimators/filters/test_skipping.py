"""What a filter leaves out changes no answer: against itself without skipping, and every count is accounted for."""

import numpy as np
import pytest
from synthetic import draw_trial, follow

from tactsim import estimators

CASES = [
    ("histogram", {"bins": 5000}),
    ("histogram", {"split": "9x40x9", "likelihood": "calibrated"}),
    ("histogram", {"bins": 1000, "gamma": 1e-100}),  # a belief that falls by thousands
    ("refined", {"bins": 2000}),
    ("refined", {"bins": 2000, "cells": 20, "halvings": 5}),
    ("refined", {"split": "5x7x9", "likelihood": "paper"}),
    ("particle", {"particles": 2000}),
    ("augmented-mcl", {"particles": 2000}),
]
# What rounding moves: mm and rad of a pose, and a probability.
ROUNDING = {"histogram": (0, 1e-7), "refined": (1e-9, 1e-9), "particle": (0, 0), "augmented-mcl": (0, 0)}


@pytest.mark.parametrize(("name", "options"), CASES, ids=str)
def test_skipping_changes_no_answer(scan, name, options):
    lazy, full = (estimators.create(name, skip=skip, **options) for skip in (True, False))
    moved, changed = ROUNDING[name]
    for estimator in (lazy, full):
        estimator.fit(scan)
    for seed in range(2):
        # The last touches contradict the first, but where a letter that was hopeless has kept its old particles.
        letters = ("EI", "IL")[seed]
        drawn = [
            draw_trial(scan, label, 12 // len(letters), np.random.default_rng(seed)) for label in letters
        ]
        readings, poses = (np.concatenate([trial[k] for trial in drawn]) for k in (0, 1))
        both = (follow(estimator, readings, poses, seed) for estimator in (lazy, full))
        for ours, whole in zip(*both, strict=True):
            assert ours.label == whole.label
            assert ours.robot_in_object == pytest.approx(whole.robot_in_object, rel=0, abs=moved)
            assert ours.probabilities == pytest.approx(whole.probabilities, rel=0, abs=changed)
        if hasattr(lazy, "certificate"):
            proof = lazy.certificate()
            assert proof.lead >= 0
            assert proof.robot_in_object.tolist() == full.certificate().robot_in_object.tolist()
    skipped = lazy.work["skipped"]
    assert sum(skipped.values()) > 0
    assert not any(full.work["skipped"].values())
    if name in ("histogram", "refined"):
        made = lazy.work["likelihood_evaluations"]
        assert made + sum(skipped.values()) == full.work["likelihood_evaluations"]
