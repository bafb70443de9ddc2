"""Equations 3 and 7 as they are corrected in docs/method.md, against plain code."""

import numpy as np
import pytest
import reference
from synthetic import make_scan, paper_poses

from tactsim import estimators
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, UNKNOWN, classify


@pytest.fixture(scope="module")
def shapes():
    return make_scan("EILT", poses=paper_poses(positions=4, angles=4))


def test_an_empty_reading_moves_the_belief_away_from_the_object(shapes):
    filter = estimators.create("histogram", split="9x9x8")
    filter.fit(shapes)
    filter.reset(np.random.default_rng(0))
    filter.update(np.zeros(36), [0.0, 0.0, 0.0])
    plane = filter.belief_over_plane().probability.sum(axis=0)
    assert plane[4, 4] < 0.1 * plane.max()  # with the pad on the object it could not be empty


def test_only_the_complement_makes_equation_7_a_distribution(shapes):
    sums = {}
    for failure in ("printed", "complement"):
        filter = estimators.create("histogram", bins=100, failure=failure)
        filter.fit(shapes)
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
