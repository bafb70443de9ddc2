"""Distances from the references in a page of the documentation, filled by the command that `make references` calls."""

import re
from pathlib import Path

import numpy as np
from page_blocks import blocks
from reference_posteriors import means, recognisers


def test_means_are_over_the_objects_that_have_a_distance():
    of = np.array([[[1.0, 2.0, np.nan]], [[3.0, np.nan, np.nan]]])
    np.testing.assert_array_equal(means(of), [[2.0, 2.0, np.nan]])


def test_the_documentation_has_a_row_for_every_estimator():
    text = (Path(__file__).parents[2] / "docs" / "bound.md").read_text(encoding="utf-8")
    (block,) = blocks("references").finditer(text)
    rows = re.findall(r"^\| ([\w-]+) \| [\d.]+ \|", block[0], re.M)
    assert rows == recognisers()
    assert re.search(r"\*`make references`: 10 objects; commit [0-9a-f]{12}\.\*", block[0])
