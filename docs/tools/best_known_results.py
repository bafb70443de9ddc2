"""Write `bench/leaderboard/best_known.toml`, for `bench tasks`: `best_known_results.py FOLDER` reads its bundles."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import tomli_w
from page_blocks import exit_status

from tactsim.bench import leaderboard as best_known
from tactsim.bench.config import RunConfig
from tactsim.bench.leaderboard import Best
from tactsim.bench.leaderboard.standings import Standings, read_folder
from tactsim.core import InputError
from tactsim.core.files import write_text

_DEFAULT = RunConfig.model_fields["estimator"].default
_HEADING = "# Made by docs/tools/best_known_results.py from the bundles of results/leaderboard.\n"


def best_of(standings: Iterable[Standings]) -> dict[str, Best]:
    """Take the first of each task that comes with the project; none where nobody has a score."""
    best = {}
    for of in standings:
        if of.known is None or not of.ranked:
            continue
        first = of.ranked[0]
        value = first.figure(of.by).value
        default = next((row.figure(of.by).value for row in of.ranked if row.label == _DEFAULT), None)
        if value is not None:
            commit = first.bundle.commit or "unknown"
            made_of = {"estimator": first.bundle.estimator, "options": dict(first.bundle.options)}
            best[of.task] = Best(
                figure=of.by, value=value, method=first.label, commit=commit, default=default, **made_of
            )
    return best


def main(words: Sequence[str]) -> int:
    """Make the file from the folder `words[0]`; returns the exit status."""
    (folder,) = map(Path, words)

    def work() -> None:
        found = read_folder(folder)
        for path, why in found.unreadable:
            raise InputError(f"{path}: {why}")
        best = best_of(found.standings)
        table = tomli_w.dumps({name: best[name].model_dump(exclude_none=True) for name in sorted(best)})
        write_text(best_known.FILE, _HEADING + table)

    return exit_status("best known", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
