"""The bag of features: its words and shares by hand, and what it does not look at."""

import numpy as np
import pytest

from tactsim import estimators
from tactsim.core import Scan


def scan_of(readings, labels):
    """A scan of training readings (n, 2) kPa."""
    readings = np.asarray(readings, float)
    return Scan(
        readings, np.zeros((len(readings), 3)), np.array(labels), np.full(len(readings), "train"),
        np.array([[0.0, 0.0], [1.0, 0.0]]),
    )  # fmt: skip


def started(scan, **options):
    estimator = estimators.create("bag-of-features", **options)
    estimator.fit(scan)
    estimator.reset(np.random.default_rng(0))
    return estimator


GROUPS = np.array([[0, 0], [50, 0], [50, 60]])


def clustered():
    """Readings around three centres; A has given 6, 3 and 1 of them, B 1, 1 and 3."""
    rng = np.random.default_rng(3)
    which = np.repeat([0, 1, 2, 0, 1, 2], [6, 3, 1, 1, 1, 3])
    labels = np.repeat(["A", "B"], [10, 5])
    return scan_of(GROUPS[which] + rng.normal(0, 0.5, (15, 2)), labels), which, labels


def test_the_words_are_the_means_of_what_is_alike():
    scan, which, _ = clustered()
    words = started(scan, words=3).words
    expected = np.array([scan.readings[which == group].mean(axis=0) for group in range(3)])
    order = np.lexsort(words.T[::-1])
    assert words[order] == pytest.approx(expected)


def test_probabilities_are_products_of_shares_counted_by_hand():
    estimator = started(clustered()[0], words=3)
    shares = {"A": (np.array([6, 3, 1]) + 0.5) / 11.5, "B": (np.array([1, 1, 3]) + 0.5) / 6.5}
    product = dict.fromkeys("AB", 1.0)
    for group in (2, 0, 2, 1):
        estimator.update(GROUPS[group] + 1.0, [3, 4, 5])
        product = {label: p * shares[label][group] for label, p in product.items()}
        total = sum(product.values())
        said = estimator.estimate()
        assert said.probabilities == pytest.approx({label: p / total for label, p in product.items()})
        assert said.label == max(product, key=product.get)


def test_poses_are_not_looked_at_and_the_place_is_the_middle_of_the_prior():
    answers = []
    for pose in ([0, 0, 0], [7, -3, 1]):
        estimator = started(clustered()[0], words=3)
        estimator.update(GROUPS[1], pose)
        answers.append(estimator.estimate())
    assert answers[0].probabilities == answers[1].probabilities
    for answer in answers:
        assert answer.robot_in_object.tolist() == [0, 0, 0]


@pytest.mark.parametrize("words", [1, 4, 1000])
def test_there_are_never_more_words_than_asked_for_or_than_different_readings(words):
    scan, _, _ = clustered()
    doubled = scan_of(np.tile(scan.readings, (2, 1)), np.tile(scan.labels, 2))
    assert 1 <= len(started(doubled, words=words).words) <= min(words, 15)
    if words == 1:  # one kind of reading says nothing
        estimator = started(doubled, words=1)
        estimator.update([1, 2], [0, 0, 0])
        assert estimator.estimate().probabilities == pytest.approx({"A": 0.5, "B": 0.5}, abs=1e-9)
