"""What docs/recordings.md says that its commands print: tried again with fewer trials."""

import re
from pathlib import Path

import numpy as np
import pytest
from pages import BLOCKS, ROOT, bench, commands

import tactsim

PAGE = "docs/recordings.md"


def table(first):
    """Read the rows of the page's table whose heading begins so: {estimator: right after 1, 2, 3, 5, 10 touches}."""
    rows = (ROOT / PAGE).read_text(encoding="utf-8").partition(f"| {first} |")[2].partition("\n\n")[0]
    found = re.findall(r"^\| `([\w-]+)` \| ((?:[\d.]+ \| ){5})", rows, re.M)
    return {name: [float(word) for word in cells.split(" | ")[:5]] for name, cells in found}


@pytest.mark.slow
def test_the_first_walk_finds_what_the_page_says(here):
    shown = table("estimator")
    assert set(shown) == {"histogram", "particle", "tempered", "force-mosaic", "refined"}
    for block in BLOCKS:
        if block.page == PAGE and block.file:
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.page == PAGE and block.language == "python":
            exec(compile(block.text, PAGE, "exec"), {"__name__": "page"})
        elif block.page == PAGE and block.language == "sh":
            for words in commands(block):
                arguments = bench(words)
                if arguments[0] in ("emulate", "replay") and not Path("touches.npz").exists():
                    assert here(*arguments).returncode == 0
    for name, few in (("refined", 20), ("histogram", 40)):
        run = tactsim.run(estimator=name, scan="touches.npz", letters=None, trials=few, readings=10)
        again = run.accuracy[[0, 1, 2, 4, 9]]
        # So many standard errors of both, and no less than a trial or two.
        error = np.sqrt(again * (1 - again) / (5 * few)) + 0.02
        assert (np.abs(again - shown[name]) < 4 * error).all(), (name, again, shown[name])
