"""The best known result on every task: kept in `best_known.toml`, which is made from the bundles of a folder.

`python -m tactsim.bench.leaderboard.best_known` renews it from results/leaderboard. Bundles take long to read and
do not come with an installation; the file does both better.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import tomli_w
from pydantic import BaseModel, ConfigDict

from tactsim.bench import tasks
from tactsim.bench.leaderboard.bundle import DONE, Bundle, read_bundle
from tactsim.bench.places import RESULTS
from tactsim.bench.tasks.scored import badness, value_of
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


def best_of(bundles: Iterable[Bundle]) -> dict[str, Best]:
    """Find the best of some bundles on each task that comes with the project.

    They are compared by the task's first figure, and where that is equal by the next. A bundle without a score counts
    for nothing, nor does one on other data than the task's or on a part of them.
    """
    ranked: dict[str, list[tuple[list[float], Best]]] = {}
    known = {name: tasks.task(name) for name in tasks.names()}
    for bundle in bundles:
        task = known.get(bundle.task)
        if task is None or (bundle.task_data, bundle.status) != (task.data, DONE) or not _whole(bundle, task):
            continue
        values = [value_of(figure, bundle.trials, bundle.runs[0].objects) for figure in task.scored]
        if values[0] is not None:
            best = Best(
                figure=task.scored[0],
                value=values[0],
                method=bundle.method,
                commit=bundle.commit or "unknown",
            )
            places = [badness(figure, value) for figure, value in zip(task.scored, values, strict=True)]
            ranked.setdefault(task.name, []).append((places, best))
    return {
        name: min(found, key=lambda one: (one[0], one[1].method))[1] for name, found in sorted(ranked.items())
    }


def _whole(bundle: Bundle, task: tasks.Task) -> bool:
    """Tell whether the runs are those of the task: all seeds, trials and readings."""
    sizes = {(run.config["trials"], run.readings) for run in bundle.runs}
    return sizes == {(task.trials, task.readings)} and {run.seed for run in bundle.runs} == set(task.seeds)


def write_best(best: Mapping[str, Best]) -> None:
    """Write what `best_known` reads."""
    write_text(FILE, _HEADING + tomli_w.dumps({name: one.model_dump() for name, one in best.items()}))


def main() -> int:
    """Renew the file from the bundles of results/leaderboard; returns the exit status."""
    try:
        write_best(best_of(read_bundle(path) for path in sorted(LEADERBOARD.glob("*.zip"))))
    except InputError as error:
        print(f"best known: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
