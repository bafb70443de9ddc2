"""The compiled terms of classes, against the classifier of eq. 3."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactsim.estimators.likelihoods.class_terms import class_terms
from tactsim.estimators.likelihoods.classifier import UNKNOWN, classify

# Few values, so that taxels equal to each other and to a limit are common.
PRESSURES = st.sampled_from([-3.0, 0.0, 0.5, 0.6, 1.0, 2.0, 2.1, 7.0, 20.0])


@given(
    reading=arrays(float, st.integers(1, 40), elements=PRESSURES),
    threshold=st.sampled_from([-1.0, 0.0, 2.0]),
    ratio=st.sampled_from([0.0, 0.3, 1.0]),
)
@pytest.mark.parametrize("with_unknown", [True, False])
def test_terms_are_those_of_the_classifier(reading, threshold, ratio, with_unknown):
    classes = classify(reading, threshold, ratio)
    table, taxel, weight = class_terms(reading, threshold, ratio, with_unknown)
    expected = np.flatnonzero(with_unknown | (classes != UNKNOWN))
    assert taxel.tolist() == expected.tolist()
    assert table.tolist() == classes[expected].tolist()
    assert weight.tolist() == [1.0] * len(expected)


def test_readings_that_are_read_only_or_not_contiguous_are_taken():
    readings = np.arange(12.0).reshape(4, 3)
    readings.setflags(write=False)
    for reading in (readings[1], readings[:, 1]):
        table, _, _ = class_terms(reading, 2.0, 0.3, True)
        assert table.tolist() == classify(reading, 2.0, 0.3).tolist()
