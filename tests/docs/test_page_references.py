"""Distances from the references in a page of the documentation, filled by the command that `make references` calls."""

import re
from pathlib import Path

import numpy as np
import pytest
from page_blocks import blocks
from page_references import fill, main, readings_asked_for

from tactsim.bench.bound.references import AT, means, recognisers
from tactsim.core import InputError

PAGE = """Before.

<!-- references: 1, 10 -->
what stood here
<!-- end of references -->
After.
"""


def test_a_page_gets_its_distances_and_keeps_its_words():
    of = np.tile(np.arange(3.0 * len(AT)).reshape(len(AT), 3), (10, 1, 1))
    of[:, -1, 2] = np.nan
    text = fill(fill(PAGE, {"old": of}), {"one": of, "two": of + 1})  # a filled page is filled again
    lines = text.splitlines()
    assert [lines[0], lines[-1]] == ["Before.", "After."]
    assert "what stood here" not in text
    assert "old" not in text
    assert [line for line in lines if line.startswith("|")] == [
        "| estimator | letter @1 | letter @10 | pose @1, mm | pose @10, mm | belief @1, mm | belief @10, mm |",
        "|---|---|---|---|---|---|---|",
        "| one | 0.000 | 12.000 | 1.000 | 13.000 | 2.000 | - |",
        "| two | 1.000 | 13.000 | 2.000 | 14.000 | 3.000 | - |",
    ]
    assert "*`make references`: 10 objects; commit " in text


def test_means_are_over_the_objects_that_have_a_distance():
    of = np.array([[[1.0, 2.0, np.nan]], [[3.0, np.nan, np.nan]]])
    np.testing.assert_array_equal(means(of), [[2.0, 2.0, np.nan]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no table", "it lacks"),
        (PAGE + PAGE, "it lacks"),
        (PAGE.replace("end of", "and of"), "has no `<!-- end of references -->`"),
        (PAGE.replace("10", "11"), "after '11' readings, but after 1, 2, 3, 5, 10"),
    ],
)
def test_a_wrong_page_is_refused_before_the_work_and_stays(text, said, check_refused):
    with pytest.raises(InputError, match=said):
        readings_asked_for(text)
    check_refused(main, "references", text, said)


def test_the_documentation_has_a_row_for_every_estimator():
    text = (Path(__file__).parents[2] / "docs" / "bound.md").read_text(encoding="utf-8")
    (block,) = blocks("references").finditer(text)
    rows = re.findall(r"^\| ([\w-]+) \| [\d.]+ \|", block[0], re.M)
    assert rows == recognisers()
    assert re.search(r"\*`make references`: 10 objects; commit [0-9a-f]{12}\.\*", block[0])
