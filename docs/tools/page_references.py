"""Fill the table of a page with distances from the references: `python docs/tools/page_references.py PAGE`.

The page says between two comments after which readings it wants them, and what stands between is replaced:

    <!-- references: 1, 3, 10 -->
    <!-- end of references -->
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

from page_blocks import asked_for, fill_blocks, fill_one

from tactsim.bench.bound.references import AT, distances_of, load, means, recognisers, shown
from tactsim.bench.runs.tables import markdown_table
from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import git_commit, short_commit


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
    """Replace the table of a page by the means of estimators' distances (objects, readings of AT, 3)."""
    after = readings_asked_for(text)
    heads = [
        "estimator",
        *(f"letter @{n}" for n in after),
        *(f"{what} @{n}, mm" for what in ("pose", "belief") for n in after),
    ]
    rows = [heads]
    for name, of in found.items():
        rows.append([name, *shown(means(of)[[AT.index(n) for n in after]].T)])
    objects = len(next(iter(found.values())))
    origin = f"*`make references`: {objects} objects; commit {short_commit(git_commit())}.*"
    return fill_blocks(text, "references", lambda _: f"{markdown_table(rows)}\n{origin}\n")


def _fill_anew(text: str) -> str:
    readings_asked_for(text)  # a wrong page is reported before the work
    return fill(text, distances_of(recognisers(), load()))


def main(words: Sequence[str]) -> int:
    """Fill the page `words[0]`; returns the exit status."""
    return fill_one("references", words, _fill_anew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
