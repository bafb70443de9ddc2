"""Every table of results in the documentation says beneath it how it was made, from five scans or more."""

import re

import pytest
from page_blocks import blocks
from page_tables import LEAST_SCANS
from pages import ROOT

from tactsim.bench.sweep import read, suites

PAGES = [
    "README.md",
    "docs/results.md",
    "docs/method.md",
    "docs/estimators.md",
    "docs/tasks.md",
]
ASKED = [
    (page, match["asked"], match[0])
    for page in PAGES
    for match in blocks("table").finditer((ROOT / page).read_text(encoding="utf-8"))
]
IDS = [f"{page}: {asked.split(';')[0]}" for page, asked, _ in ASKED]


def test_make_tables_fills_these_pages_and_no_other_page_has_such_tables():
    command = re.search(r"page_tables.py (.*)", (ROOT / "Makefile").read_text())[1]
    assert command.split() == PAGES
    holding = {
        path.relative_to(ROOT).as_posix()
        for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
        if "_build" not in path.parts and "<!-- table:" in path.read_text(encoding="utf-8")
    }
    assert holding == set(PAGES)


@pytest.mark.parametrize(("page", "asked", "table"), ASKED, ids=IDS)
def test_a_table_has_its_command_five_scans_and_intervals(page, asked, table):
    name = asked.split(";")[0].partition(" by ")[0].strip()
    assert name in suites()
    assert len({config.seed for config in read(name)[1]}) >= LEAST_SCANS
    origin = re.search(
        r"\*`bench sweep (\S+)`: (\d+) scans, \d+(?: or \d+)* trials for each figure; (.*)", table
    )
    if origin is None:
        assert table.count("\n") == 1, f"{page}: a table that says not how it was made"  # yet to be filled
        return
    assert origin[1] == name
    assert int(origin[2]) >= LEAST_SCANS
    bare = all(
        "," in figure for figure in asked.split(";")[1:]
    )  # several readings in a cell have no room for intervals
    assert bare or "in brackets 95 % intervals over scans and trials" in origin[3]


def test_make_tables_does_every_sweep_that_a_page_asks_for():
    done = set(re.search(r"^TABLES := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[1].split())
    assert {asked.split(";")[0].partition(" by ")[0].strip() for _, asked, _ in ASKED} <= done


def test_the_regions_that_are_counted_beneath_their_table_are_those_of_the_table():
    text = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    (table,) = (table for page, asked, table in ASKED if page == "docs/method.md" and "coverage_90@" in asked)
    rows = [
        [cell.split(" / ") for cell in row.split(" | ")[1:]]
        for row in re.findall(r"^\| (.* / .*) \|$", table, re.M)
    ]
    counted = re.search(
        r"Of the (\d+) shares of `refined` (\d+) lie between \.87 and \.93, (\d+) below and (\d+) above; "
        r"of those of `force-mosaic` (\d+), (\d+) and (\d+); of those of `graded` (\d+), (\d+) and (\d+)\.",
        " ".join(text.split()),
    )
    assert counted is not None
    total, *said = map(int, counted.groups())
    found = []
    for method in range(3):
        shares = [float(share) for row in rows for share in row[method]]
        assert len(shares) == total
        below, above = sum(share < 0.87 for share in shares), sum(share > 0.93 for share in shares)
        found += [total - below - above, below, above]
    assert said == found
