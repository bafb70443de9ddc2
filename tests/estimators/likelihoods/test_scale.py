"""The scale of readings, the threshold that follows from it, and answers that do not depend on the unit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import draw_trial, fitted, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError, Scan
from tactsim.estimators.likelihoods.classifier import classify, lehmer_mean, threshold_of

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


@pytest.mark.parametrize(
    ("name", "options"),
    [("graded", {}), ("refined", {"threshold": "auto"}), ("force-mosaic", {"threshold": "auto"})],
)
@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_the_readings_changes_no_label(name, options, unit):
    other = Scan(unit * SCAN.readings, SCAN.poses, SCAN.labels, SCAN.split, SCAN.taxel_xy, SCAN.meta)
    small = {"bins": 500, "cells": 20, "halvings": 1, "cell": 0.8}
    made = [fitted(name, scan, **small, **options) for scan in (SCAN, other)]
    for seed, label in enumerate("ELELEL"):
        readings, poses, _ = draw_trial(SCAN, label, 4, np.random.default_rng(seed))
        for estimator in made:
            estimator.reset(np.random.default_rng(0))
        for reading, pose in zip(readings, poses, strict=True):
            made[0].update(reading, pose)
            made[1].update(unit * reading, pose)
            one, two = (estimator.estimate() for estimator in made)
            assert one.label == two.label
            assert one.probabilities[one.label] == pytest.approx(two.probabilities[one.label], abs=1e-3)


def test_a_word_that_is_no_threshold_is_refused():
    with pytest.raises(InputError, match="threshold"):
        estimators.create("refined", threshold="automatic")
