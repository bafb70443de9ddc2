"""The bag of features: its words and shares by hand, and what it does not look at."""

import numpy as np
import pytest
from synthetic import started, two_taxel_scan

GROUPS = np.array([[0, 0], [50, 0], [50, 60]])


def clustered():
    """Readings around three centres; A has given 6, 3 and 1 of them, B 1, 1 and 3."""
    rng = np.random.default_rng(3)
    which = np.repeat([0, 1, 2, 0, 1, 2], [6, 3, 1, 1, 1, 3])
    labels = np.repeat(["A", "B"], [10, 5])
    return two_taxel_scan(GROUPS[which] + rng.normal(0, 0.5, (15, 2)), labels), which, labels


def test_the_words_are_the_means_of_what_is_alike():
    scan, which, _ = clustered()
    words = started("bag-of-features", scan, words=3).words
    expected = np.array([scan.readings[which == group].mean(axis=0) for group in range(3)])
    order = np.lexsort(words.T[::-1])
    assert words[order] == pytest.approx(expected)


def test_probabilities_are_products_of_shares_counted_by_hand():
    estimator = started("bag-of-features", clustered()[0], words=3)
    shares = {"A": (np.array([6, 3, 1]) + 0.5) / 11.5, "B": (np.array([1, 1, 3]) + 0.5) / 6.5}
    product = dict.fromkeys("AB", 1.0)
    for group in (2, 0, 2, 1):
        estimator.update(GROUPS[group] + 1.0, [3, 4, 5])
        product = {label: p * shares[label][group] for label, p in product.items()}
        total = sum(product.values())
        said = estimator.estimate()
        assert said.probabilities == pytest.approx({label: p / total for label, p in product.items()})
        assert said.label == max(product, key=product.get)
