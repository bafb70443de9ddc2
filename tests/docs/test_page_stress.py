"""The outcomes of stress cases in a page of the documentation, filled by the command that `make stress` calls."""

import re
from pathlib import Path

import pytest
from page_blocks import blocks
from page_stress import check, fill, main

from tactsim.bench.stress import TOPICS, cases, run_case
from tactsim.bench.stress.case import case
from tactsim.core import InputError

PAGE = """Before.

<!-- stress: all cases -->
what stood here
<!-- end of stress -->
After.
"""


def outcome(worst, at_least=False):
    made = case("topic.name", varied="it", deviation="off", limit=1.0, because="so", at_least=at_least)
    return run_case(made(lambda seen: seen.see(worst, "the third")))


def test_a_page_gets_its_outcomes_and_keeps_its_words():
    text = fill(fill(PAGE, [outcome(0.125)]), [outcome(0.5), outcome(1.75, at_least=True)])  # filled again
    lines = text.splitlines()
    assert [lines[0], lines[-1]] == ["Before.", "After."]
    assert "what stood here" not in text
    assert [line for line in lines if line.startswith("|")] == [
        "| case | worst | limit |",
        "|---|---|---|",
        "| `topic.name` | 0.5 | ≤ 1 |",
        "| `topic.name` | 1.8 | ≥ 1 |",
    ]
    assert "*`make stress`: 2 cases in 0 minutes, none failed; Python 3." in text


def test_a_case_that_fails_is_named_and_fills_nothing():
    with pytest.raises(InputError, match=r"the case topic\.name fails at the third"):
        fill(PAGE, [outcome(0.5), outcome(1.5)])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no table", "it lacks"),
        (PAGE + PAGE, "it lacks"),
        (PAGE.replace("all cases", "quick"), "it lacks"),
        (PAGE.replace("end of", "and of"), "has no `<!-- end of stress -->`"),
    ],
)
def test_a_wrong_page_is_refused_before_the_work_and_stays(text, said, check_refused):
    with pytest.raises(InputError, match=said):
        check(text)
    check_refused(main, "stress", text, said)


def test_the_documentation_shows_a_run_of_every_case():
    text = (Path(__file__).parents[2] / "docs" / "stress.md").read_text(encoding="utf-8")
    topics = text.split("| topic |")[1].split("\n\n")[0]
    assert re.findall(r"^\| (\w+) \|", topics, re.M) == list(TOPICS)
    (block,) = blocks("stress").finditer(text)
    table = [line for line in block[0].splitlines() if line.startswith("|")][2:]
    shown, every = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in table], cases()
    assert [(row[0], row[2]) for row in shown] == [
        (f"`{one.name}`", f"{'≥' if one.at_least else '≤'} {one.limit:g}") for one in every
    ]
    assert re.search(
        rf"^\*`make stress`: {len(every)} cases in .*, none failed; .*; commit [0-9a-f]{{12}}\.\*$",
        block[0],
        re.M,
    )
    for row, one in zip(shown, every, strict=True):
        assert float(row[1]) >= one.limit if one.at_least else float(row[1]) <= one.limit
