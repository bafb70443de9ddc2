"""The standings in a page of the documentation, filled by the command that `make leaderboard` calls."""

import re
from pathlib import Path

import pytest
from entered import entered
from page_blocks import asked_for
from page_standings import main

from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.tasks import names, task

DOCS = Path(__file__).parents[3] / "docs"
PAGE = """Before.

<!-- standings: active-v1 -->
what stood here
<!-- end of standings -->

<!-- standings: slip-v1 -->
<!-- end of standings -->
After.
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("entered")
    for name, bundle in {
        "good": entered("good", "active-v1", skill=2.5, mm=0.1),
        "odd": entered("a|b <i> [x](y)", "active-v1", mm=2.0),
        "gone": entered("gone", "active-v1", status="out of memory"),
        "old": entered("old", "active-v1", task_data="d" * 64),
    }.items():
        write_bundle(bundle, place / f"{name}.zip")
    return place


def test_a_page_gets_its_standings_and_keeps_its_words(folder, tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    for _ in range(2):  # a filled page is filled again
        assert main([str(folder), str(page)]) == 0
        assert capsys.readouterr().err == ""
    text = page.read_text()
    lines = text.splitlines()
    assert "what stood here" not in text
    assert [lines[0], lines[-1]] == ["Before.", "After."]
    assert "No method has entered yet" in text
    rows = [line for line in lines if line.startswith("|")]
    assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1
    assert rows[2].startswith("| 1 | good | 0.")
    assert rows[3].startswith(r"| 2 | a\|b \<i\> \[x\]\(y\) | ")
    assert "no score: out of memory" in rows[4]
    assert len(rows) == 5  # not the one with other data
    assert (
        "*`bench submit active-v1`: 5 scans, 250 trials for each figure; in brackets 95 % intervals" in text
    )


def test_the_documentation_has_a_table_for_every_task_that_anybody_can_press():
    text = (DOCS / "leaderboard.md").read_text(encoding="utf-8")
    pressed = {name for name in names() if task(name).pressed}  # others: docs/recordings.md
    assert set(asked_for(text, "standings")) == pressed - {"smoke-v1"}  # on which nobody is ranked
