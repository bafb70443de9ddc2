"""The outcomes of stress cases in a page of the documentation, filled by the command that `make stress` calls."""

import re
from pathlib import Path

from page_blocks import blocks

from tactsim.bench.stress import TOPICS, cases


def test_the_documentation_shows_a_run_of_every_case():
    text = (Path(__file__).parents[2] / "docs" / "stress.md").read_text(encoding="utf-8")
    topics = text.split("| topic |")[1].split("\n\n")[0]
    assert re.findall(r"^\| (\w+) \|", topics, re.M) == list(TOPICS)
    (block,) = blocks("stress").finditer(text)
    table = [line for line in block[0].splitlines() if line.startswith("|")][2:]
    shown, every = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in table], cases()
    assert [(row[0], row[2]) for row in shown] == [(f"`{one.name}`", f"≤ {one.limit:g}") for one in every]
    assert re.search(
        rf"^\*`make stress`: {len(every)} cases in .*, none failed; .*; commit [0-9a-f]{{12}}\.\*$",
        block[0],
        re.M,
    )
    for row, one in zip(shown, every, strict=True):
        assert float(row[1]) <= one.limit
