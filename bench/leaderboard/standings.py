"""The standings of every task: the bundles of a folder, sorted by task, and ranked on the same trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from tactsim.bench.experiment import silent
from tactsim.bench.intervals import Figure
from tactsim.bench.leaderboard import bundle as bundles
from tactsim.bench.leaderboard.bundle import DONE, SUFFIX, Bundle, Record, record_path
from tactsim.bench.leaderboard.ranking import Ranking, ranked
from tactsim.bench.results import Run
from tactsim.bench.runs.paper import PRINTED, Printed
from tactsim.bench.runs.pooled import Pooled, cell, figure_of
from tactsim.bench.score import recognition_seconds
from tactsim.bench.tasks import Task, names, task
from tactsim.bench.trials import OneTrial, Progress, draw_true_pose, generator
from tactsim.core import InputError, Pad
from tactsim.core.checking import checked
from tactsim.core.making import statements
from tactsim.core.pad import offsets
from tactsim.core.provenance import poses_unknown

OTHER_TRIALS = "its trials are not the task's"
TrialKey = tuple[int, str, int, int]  # seed, letter, number and readings
MOST_TRIALS = 20_000  # of a bundle: the bootstrap takes 16 kB for each
PAPER = "letters-v1"  # the task that has the paper's protocol
_SEEN = (1, 2, 3, 5, 10)  # readings after which a table shows the accuracy, and the last
_SEEN_OF_ERROR = 10


@dataclass(frozen=True, eq=False)
class Entrant:
    """A bundle in the standings of its task.

    label: the method, with the file's name if the method is there twice. number: of its colour and marker, the same for
    a method on all tasks. status: DONE, or why there is no score. check: what `bench verify` found; None if it was not
    asked. rank: the best and the worst that the tests leave; None without a score or the figure that ranks.
    """

    path: Path
    bundle: Bundle
    label: str
    number: int
    status: str
    check: Record | None = None
    rank: tuple[int, int] | None = None

    @property
    def confirmed(self) -> bool:
        """Tell whether trials were done again, and were as the bundle says."""
        return self.check is not None and self.check.verified

    @property
    def pooled(self) -> Pooled:
        """Pool the runs of all seeds."""
        return self.bundle.pooled

    @property
    def ms_per_reading(self) -> float:
        """Give the processor time of a reading, ms: of a recognition, the median over the trials, by its readings."""
        return 1e3 * recognition_seconds(self.pooled.trials, self.pooled.readings) / self.pooled.readings

    def figure(self, name: str) -> Figure:
        """Compute a figure of a task, such as accuracy@5 or settled_95, with its interval where there is one.

        Raises InputError for an unknown one, and for a reading that the trials do not have.
        """
        return figure_of(self.pooled, name)


@dataclass(frozen=True, eq=False)
class Standings:
    """A task with all who entered it, on the same data.

    task, data: the task's name, and the hash of its readings. known: the task as this version of tactsim has it; None
    if its name or its data are others. readings: of a trial. scored: the figures that the task names. ranked: those
    with a score, the best first. unranked: the others. ranking: how all pairs of `ranked` compare; None without any.
    """

    task: str
    data: str
    known: Task | None
    readings: int
    scored: tuple[str, ...]
    ranked: tuple[Entrant, ...]
    unranked: tuple[Entrant, ...]
    ranking: Ranking | None

    @property
    def by(self) -> str:
        """Name the figure that ranks."""
        return ranking_figures(self.scored, self.readings)[0]

    @property
    def trials(self) -> int:
        """Count the trials of a method."""
        return len(self.ranked[0].pooled.ids) if self.ranked else 0

    @property
    def columns(self) -> list[str]:
        """List the figures of the table that any method has: what ranks, accuracy, error, what is scored."""
        last = self.readings
        if not last:  # a task of another version, with which nobody was done
            return []
        accuracy = [f"accuracy@{at}" for at in (*(k for k in _SEEN if k < last), last)]
        error = [f"error_mm@{at}" for at in sorted({min(_SEEN_OF_ERROR, last), last})]
        figures = dict.fromkeys([self.by, *accuracy, *error, f"efficiency@{last}", *self.scored])
        return [name for name in figures if any(cell(one.pooled, name) != "-" for one in self.ranked)]

    @property
    def paper(self) -> tuple[Printed, ...]:
        """List what the paper reports; nothing but for the task that has its protocol."""
        return PRINTED if self.known is not None and self.task == PAPER else ()


def ranking_figures(scored: Iterable[str], readings: int) -> tuple[str, str]:
    """Choose the figure that ranks on a task, the first accuracy or error that it names, and the other one."""
    usual = (f"accuracy@{min(5, readings)}", f"error_all_mm@{readings}")
    known = [
        figure
        for figure in (*scored, *usual)
        if figure.startswith(("accuracy@", "error_mm@", "error_all_mm@"))
    ]
    by = known[0]
    return by, next(one for one in known if one.startswith("accuracy@") != by.startswith("accuracy@"))


@dataclass(frozen=True, eq=False)
class Folder:
    """What a folder of bundles holds: the standings, tasks of this version first, and why files could not be read."""

    standings: tuple[Standings, ...]
    unreadable: tuple[tuple[Path, str], ...]

    @property
    def entrants(self) -> tuple[Entrant, ...]:
        """List all bundles that could be read."""
        return tuple(one for of in self.standings for one in (*of.ranked, *of.unranked))


def read_folder(folder: Path, *, progress: Progress = silent) -> Folder:
    """Read all bundles (*.tar.xz) of a folder and rank them, each on its task and data.

    progress(stage, done, total) is called for the stage "bundles". Raises InputError if the folder holds no bundle.
    """
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    paths = [path for path in there if path.name.endswith((SUFFIX, ".zip"))]
    if not paths:
        raise InputError(
            f"{folder} holds no bundle (*{SUFFIX}); `bench submit TASK --estimator NAME --out BUNDLE` makes one"
        )
    found: dict[tuple[str, str], list[tuple[Path, Bundle]]] = {}
    checks: dict[Path, Record | None] = {}
    unreadable = []
    for number, path in enumerate(paths):
        progress("bundles", number, len(paths))
        try:
            bundle = _read(path)
        except InputError as error:
            unreadable.append((path, str(error).removeprefix(f"bundle {path}: ")))
            continue
        try:
            checks[path] = bundles.read_record(path)
        except InputError as error:
            unreadable.append((record_path(path), str(error).removeprefix(f"record {record_path(path)}: ")))
        found.setdefault((bundle.task, bundle.task_data), []).append((path, bundle))
    progress("bundles", len(paths), len(paths))
    methods = sorted({bundle.method for alike in found.values() for _, bundle in alike})
    numbers = {method: number for number, method in enumerate(methods)}
    standings = [_standings(name, data, alike, numbers, checks) for (name, data), alike in found.items()]
    standings.sort(key=lambda of: (of.known is None, of.task, of.data))
    return Folder(tuple(standings), tuple(unreadable))


def _read(path: Path) -> Bundle:
    bundle = bundles.read_bundle(path)
    if bundle.runs:
        count = len(bundle.pooled.ids)  # raises if its runs are not of one kind
        if count > MOST_TRIALS:
            raise InputError(f"bundle {path}: {count:,} trials; a leaderboard takes {MOST_TRIALS:,}")
        for run in bundle.runs:
            _pad(run)  # raises if what it states is none
    return bundle


def _standings(
    name: str,
    data: str,
    bundles: Sequence[tuple[Path, Bundle]],
    numbers: Mapping[str, int],
    checks: Mapping[Path, Record | None],
) -> Standings:
    known = _known(name, data)
    counts = Counter(bundle.method for _, bundle in bundles)
    right = _trials_of_the_task(known, [bundle for _, bundle in bundles])
    entrants = []
    for path, bundle in bundles:
        label = bundle.method if counts[bundle.method] == 1 else f"{bundle.method} ({path.name})"
        check = checks.get(path)
        status = _status(bundle, check, right)
        entrants.append(Entrant(path, bundle, label, numbers[bundle.method], status, check))
    scored = {one.label: one for one in entrants if one.status == DONE}
    readings = known.readings if known else next((one.pooled.readings for one in scored.values()), 0)
    figures = known.scored if known else (f"error_all_mm@{readings}", f"accuracy@{min(5, readings)}")
    ranking = None
    placed: tuple[Entrant, ...] = ()
    if scored:
        # Called as its author calls the method.
        pools = [replace(one.pooled, method=label, budget=None, mark="") for label, one in scored.items()]
        ranking = ranked(pools, *ranking_figures(figures, readings))
        ranks = zip(ranking.pools, ranking.ranks, strict=True)
        placed = tuple(replace(scored[pool.method], rank=rank) for pool, rank in ranks)
    others = sorted((one for one in entrants if one.status != DONE), key=lambda one: one.label)
    return Standings(name, data, known, readings, figures, placed, tuple(others), ranking)


def _status(bundle: Bundle, check: Record | None, right: frozenset[TrialKey]) -> str:
    """Give a bundle's status: DONE only if it has the task's trials and no check spoke against it."""
    if bundle.status != DONE:
        return bundle.status
    if not right or _trials(bundle) != right:
        return OTHER_TRIALS
    return DONE if check is None or check.verified else f"not confirmed: {check.said}"


def _known(name: str, data: str) -> Task | None:
    """Find the task that a bundle names; None if this version of tactsim has it not, or with other data."""
    if name not in names():
        return None
    found = task(name)
    return found if found.data in (None, data) else None


def _pad(run: Run) -> Pad:
    """Find the pad that a run's readings were recorded or pressed with."""
    return checked(Pad, statements(run.about["scan"])["pad"] or {}, "pad")


def _trials(bundle: Bundle) -> frozenset[TrialKey]:
    """Name the trials of a bundle whose objects lie where the seed puts them."""
    found = set()
    for run in bundle.runs:
        reach, unknown = offsets(_pad(run).taxel_xy), poses_unknown(run.about["scan"])
        for of_trial, pose in zip(run.trials.ids, run.trials.true_pose[:, 0], strict=True):
            drawn = draw_true_pose(generator(run.seed, OneTrial(*of_trial), 0), reach, poses_unknown=unknown)
            if np.allclose(drawn, pose, rtol=0, atol=0.005):  # a bundle keeps 1/512 mm
                found.add((run.seed, *of_trial, run.readings))
    return frozenset(found) if len(found) == len(bundle.pooled.ids) else frozenset()


def _trials_of_the_task(known: Task | None, bundles: Sequence[Bundle]) -> frozenset[TrialKey]:
    """Name the trials that a task asks for; of a task that is not known, those that most of its bundles have."""
    if known is not None and known.letters:
        asked = product(known.seeds, known.letters, range(known.trials), [known.readings])
        return frozenset(asked)
    found = Counter(_trials(one) for one in bundles if one.runs)
    return found.most_common(1)[0][0] if found else frozenset()
