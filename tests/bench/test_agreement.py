"""How often eq. 3 is right: counted on readings of which the truth is known."""

import numpy as np
import pytest

from tactsim.bench.runs.scan_quality import eq3_agreement
from tactsim.core import Scan
from tactsim.estimators import Options, create


@pytest.fixture
def scan():
    """Press I at the origin: taxels on it read 10 and 4 kPa, taxels off it 3 and 0."""
    taxel_xy = np.array([[0.0, 0.0], [0.0, 3.0], [30.0, 0.0], [30.0, 3.0]])
    return Scan(np.array([[10.0, 4.0, 3.0, 0.0]]), np.zeros((1, 3)), ["I"], ["train"], taxel_xy)


# Threshold and ratio, and the share that is right by hand.
CASES = {
    "eq. 3's own, 3 kPa is unknown": ({}, 1.0),
    "a lower ratio takes 3 kPa for contact": ({"ratio": 0.2}, 0.75),
    "a higher threshold and ratio take 4 kPa for none": ({"threshold": 5.0, "ratio": 0.5}, 0.75),
}


@pytest.mark.parametrize("case", CASES)
def test_eq3_is_judged_with_the_estimators_own_threshold_and_ratio(scan, case):
    options, share = CASES[case]
    assert eq3_agreement(scan, create("histogram", bins=100, **options).options) == share


def test_eq3_is_judged_with_its_own_limits_where_the_estimator_has_none(scan):
    assert eq3_agreement(scan, Options()) == 1.0


def test_shapes_that_are_no_letters_are_not_judged(scan):
    other = Scan(scan.readings, scan.poses, ["knob"], scan.split, scan.taxel_xy)
    assert eq3_agreement(other, Options()) is None
