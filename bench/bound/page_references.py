"""Fill the table of a page with distances from the references: `python -m tactsim.bench.bound.page_references PAGE`.

The page says between two comments after which readings it wants them, and what stands between is replaced:

    <!-- references: 1, 3, 10 -->
    <!-- end of references -->
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tactsim.bench.bound.references import AT, distances_of, load, means, recognisers
from tactsim.bench.page_blocks import asked_for, fill_blocks, fill_page, markdown_table
from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import git_commit


def readings_asked_for(text: str) -> list[int]:
    """Find after which readings a page wants distances.

    Raises InputError if it has not one table with an end, or names a number of readings that there is no reference of.
    """
    found = asked_for(text, "references")
    if len(found) != 1:
        raise InputError("it lacks `<!-- references: 1, 3 -->`, or has several")
    words = [word.strip() for word in found[0].split(",")]
    for word in words:
        if word not in map(str, AT):
            raise InputError(
                f"there is no reference after {word!r} readings, but after {', '.join(map(str, AT))}"
            )
    return [int(word) for word in words]


def fill(text: str, found: Mapping[str, FloatArray]) -> str:
    """Replace the table of a page by mean distances (readings of AT, 3) of estimators."""
    after = readings_asked_for(text)
    heads = [
        "estimator",
        *(f"letter @{n}" for n in after),
        *(f"{what} @{n}, mm" for what in ("pose", "belief") for n in after),
    ]
    rows = [heads]
    for name, mean in found.items():
        of = mean[[AT.index(n) for n in after]]
        rows.append([name, *("-" if np.isnan(value) else f"{value:.3f}" for value in of.T.ravel())])
    commit = (git_commit() or "unknown")[:12]
    origin = f"*`make references`: {len(load().truth)} objects; commit {commit}.*"
    return fill_blocks(text, "references", lambda _: f"{markdown_table(rows)}\n{origin}\n")


def _fill_anew(text: str) -> str:
    readings_asked_for(text)  # a wrong page is reported before the work
    return fill(text, {name: means(of) for name, of in distances_of(recognisers(), load()).items()})


def main(words: Sequence[str]) -> int:
    """Fill the page `words[0]`; returns the exit status."""
    try:
        if len(words) != 1:
            raise InputError("give one page")
        fill_page(Path(words[0]), _fill_anew)
    except InputError as error:
        print(f"references: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
