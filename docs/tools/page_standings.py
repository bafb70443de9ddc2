"""Fill the tables of a page with the standings of a folder: `python docs/tools/page_standings.py`.

`page_standings FOLDER PAGE` reads the bundles of FOLDER. The page says which task it wants a table of, between two
comments, and what stands between them is replaced:

    <!-- standings: letters-offgrid-v1 -->
    <!-- end of standings -->
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from page_blocks import exit_status, fill_blocks, fill_page

from tactsim.bench.leaderboard.ranking import rank_words
from tactsim.bench.leaderboard.standings import Entrant, Standings, read_folder
from tactsim.bench.runs.paper import Printed
from tactsim.bench.runs.pooled import cell
from tactsim.bench.runs.tables import heading, markdown_table
from tactsim.bench.tasks import task
from tactsim.core import InputError
from tactsim.core.source_digest import short_commit

_SEEN = (1, 3, 10)
MISSING = "–"


def fill(text: str, standings: Sequence[Standings]) -> str:
    """Replace the standings in a page. Raises InputError for an unknown task, or one without an end."""
    found = {of.task: of for of in standings if of.known}

    def table(asked: str) -> str:
        of = found.get(task(asked).name)
        return _table(of) if of is not None else "*No method has entered yet.*\n"

    return fill_blocks(text, "standings", table)


def _table(of: Standings) -> str:
    seen = [at for at in _SEEN if at <= of.readings]
    right = f"right after {', '.join(map(str, seen))}"
    rows = [["rank", "method", heading(of.by), right, "× bound", "ms a reading", "done again"]]
    rows += [_row(of, one, seen) for one in of.ranked]
    rows += [_paper_row(row, of, seen) for row in of.paper if row.accuracy_after(max(seen)) is not None]
    rows += [
        [MISSING, _escaped(one.label), _escaped(f"no score: {one.status}"), *[""] * 4] for one in of.unranked
    ]
    # What ranks after one reading is what is right after one.
    columns = dict.fromkeys(column for column in zip(*rows, strict=True) if set(column[1:]) - {MISSING, ""})
    return f"{markdown_table(list(zip(*columns, strict=True)))}\n{_origin(of)}\n"


def _row(of: Standings, one: Entrant, seen: Sequence[int]) -> list[str]:
    again = str(one.check.again) if one.check and one.confirmed else "unconfirmed"
    bound = _cell(one, f"efficiency@{of.readings}").partition(" ")[0]
    return [
        rank_words(one.rank), _escaped(one.label), _cell(one, of.by),
        _cell(one, f"accuracy@{','.join(map(str, seen))}"),
        bound, f"{one.ms_per_reading:.3g}", again,
    ]  # fmt: skip


def _cell(one: Entrant, figure: str) -> str:
    """Write a figure with its interval, between whose ends is a dash."""
    return MISSING if (text := cell(one.pooled, figure)) == "-" else text.replace("-", "–")


def _paper_row(row: Printed, of: Standings, seen: Sequence[int]) -> list[str]:
    def shown(at: int) -> str:
        value = row.accuracy_after(at)
        return MISSING if value is None else f"{value:.2f}"

    ranked_at = int(of.by.partition("@")[2])
    accuracies = " / ".join(map(shown, seen))
    return [MISSING, f"*{row.method}*", f"*{shown(ranked_at)}*", f"*{accuracies}*", MISSING, MISSING,
            "*read from the paper*"]  # fmt: skip


def _origin(of: Standings) -> str:
    if not of.ranked:
        return "*No method has a score.*"
    commits = sorted({short_commit(one.bundle.commit) for one in of.ranked})
    return f"*{len(of.ranked[0].bundle.runs)} scans, {of.trials} trials; commit {', '.join(commits)}.*"


def _escaped(text: str) -> str:
    """Keep the text of a bundle from being markup in a page."""
    return re.sub(r"([\\`*_{}\[\]<>()#+!|&~$-])", r"\\\1", text)


def main(words: Sequence[str]) -> int:
    """Fill the page `words[1]` from the folder `words[0]`; returns the exit status."""
    folder, page = map(Path, words)

    def work() -> None:
        found = read_folder(folder)
        for path, why in found.unreadable:
            raise InputError(f"{path}: {why}")
        fill_page(page, partial(fill, standings=found.standings))

    return exit_status("standings", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
