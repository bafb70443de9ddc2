"""The best known result on every task: kept in `best_known.toml`, which is made from the bundles of a folder.

`python -m tactsim.bench.leaderboard.best_known` renews it from results/leaderboard. Bundles take long to read, and
they do not come with an installation; the file is read at once, and does.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import tomli_w
from pydantic import BaseModel, ConfigDict

from tactsim.bench.console import exit_status
from tactsim.bench.leaderboard.standings import Standings, read_folder
from tactsim.bench.places import RESULTS
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import read_toml
from tactsim.core.files import write_text

FILE = Path(__file__).with_name("best_known.toml")
LEADERBOARD = RESULTS / "leaderboard"
_HEADING = (
    "# Made by `python -m tactsim.bench.leaderboard.best_known` from the bundles of results/leaderboard.\n"
)


class Best(BaseModel):
    """The best on a task: the figure that ranks there, its value, the method, and the commit of the harness."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    figure: str
    value: float
    method: str
    commit: str = "unknown"


def best_known() -> dict[str, Best]:
    """Give the best known result on each task that has one, by the task's name."""
    return {
        name: checked(Best, entry, f"{FILE.name}: {name}") for name, entry in read_toml(FILE, "file").items()
    }


def best_of(standings: Iterable[Standings]) -> dict[str, Best]:
    """Take the first of each task that comes with the project; none where nobody has a score."""
    best = {}
    for of in standings:
        if of.known is None or not of.ranked:
            continue
        first = of.ranked[0]
        value = first.figure(of.by).value
        if value is not None:
            commit = first.bundle.commit or "unknown"
            best[of.task] = Best(figure=of.by, value=value, method=first.label, commit=commit)
    return best


def write_best(best: Mapping[str, Best]) -> None:
    """Write what `best_known` reads."""
    write_text(FILE, _HEADING + tomli_w.dumps({name: best[name].model_dump() for name in sorted(best)}))


def main() -> int:
    """Renew the file from the bundles of results/leaderboard; returns the exit status."""

    def work() -> None:
        folder = read_folder(LEADERBOARD)
        if folder.unreadable:
            path, why = folder.unreadable[0]
            raise InputError(f"{path}: {why}")
        write_best(best_of(folder.standings))

    return exit_status("best known", work)


if __name__ == "__main__":
    sys.exit(main())
