"""Equations 3 and 7 as they are corrected in docs/method.md, against plain code, and the threshold in any unit."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import fitted_anew, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.likelihoods.classifier import (
    CONTACT,
    NO_CONTACT,
    UNKNOWN,
    classify,
    lehmer_mean,
    threshold_of,
)


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
