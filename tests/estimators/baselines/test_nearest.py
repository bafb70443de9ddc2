"""The baseline: its kernel by hand, its width, and the reading that says where."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from synthetic import started, two_taxel_scan

from tactsim.core import compose, invert


def test_probabilities_are_those_of_kernels_summed_by_hand():
    rng = np.random.default_rng(1)
    readings = rng.uniform(0, 9, (7, 2))
    labels = np.array(["B", "A", "C", "A", "B", "A", "A"])  # of unequal numbers
    estimator = started("nearest", two_taxel_scan(readings, labels), width=2.5)
    expected = dict.fromkeys("ABC", 1.0)
    for reading in rng.uniform(0, 9, (4, 2)):
        estimator.update(reading, [0, 0, 0])
        for label in expected:
            kernels = [multivariate_normal.pdf(reading, mean, 2.5**2) for mean in readings[labels == label]]
            expected[label] *= np.mean(kernels)
        total = sum(expected.values())
        estimate = estimator.estimate()
        assert estimate.probabilities == pytest.approx({label: p / total for label, p in expected.items()})
        assert estimate.label == max(expected, key=expected.get)


def test_the_width_is_the_rms_distance_to_the_nearest_other_of_the_letter():
    scan = two_taxel_scan([[0, 0], [3, 4], [0, 1], [100, 100], [100, 102]], list("AAABB"))
    # squared distances to the nearest: A 1, 18, 1; B 4, 4; of two taxels
    assert started("nearest", scan).width == pytest.approx(np.sqrt((1 + 18 + 1 + 4 + 4) / 5 / 2))
    assert started("nearest", scan, width=7.0).width == 7.0


def test_a_reading_beside_the_letter_does_not_say_where():
    scan = two_taxel_scan([[50, 20], [0, 0.2]], ["A", "A"], [[1, 2, 0.3], [9, 9, 0]])
    estimator = started("nearest", scan)
    estimator.update([50, 21], [4, 0, 0])
    before = estimator.estimate().robot_in_object
    assert before == pytest.approx(compose([1, 2, 0.3], invert([4, 0, 0])))
    estimator.update([0, 0.1], [0, 5, 0])  # nearer to its training reading, in kPa, than the first to its own
    assert estimator.estimate().robot_in_object == pytest.approx(before)
