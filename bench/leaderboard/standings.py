"""The standings of every task: the bundles of a folder, sorted by task, compared on the same trials and ranked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.experiment import silent
from tactsim.bench.leaderboard.bundle import DONE, Bundle, Record, read_bundle, read_record, record_path
from tactsim.bench.leaderboard.ranking import (
    LEVEL,
    Accuracies,
    Errors,
    compare_accuracies,
    compare_errors,
    ranks,
)
from tactsim.bench.placement import poses_unknown
from tactsim.bench.results import Run
from tactsim.bench.runs.paper import PRINTED, Printed
from tactsim.bench.runs.pooled import CURVES, READINGS, Figure, Pooled
from tactsim.bench.score import CURVES as METRICS
from tactsim.bench.score import HEADLINES, Scored, recognition_seconds
from tactsim.bench.tasks import Task, names, task
from tactsim.bench.trials import OneTrial, Progress, Trials, draw_true_pose, generator
from tactsim.core import InputError, Pad
from tactsim.core.checking import checked
from tactsim.core.pad import offsets
from tactsim.core.provenance import statements

OTHER_TRIALS = "its trials are not the task's"
TrialKey = tuple[int, str, int, int]  # seed, letter, number and readings
MOST_TRIALS = 20_000  # of a bundle: the bootstrap takes 16 kB for each
ACCURACY, ERRORS = "accuracy", ("error_all_mm", "error_mm")
_SEEN = (1, 2, 3, 5, 10, 20)  # readings after which a table shows the accuracy, and the last
_SEEN_OF_ERROR = (10, 20)


PAPER = "letters-v1"  # the task that has the paper's protocol


@dataclass(frozen=True, eq=False)
class Entrant:
    """A bundle in the standings of its task.

    label: the method, with the file's name if the method is there twice. number: of its colour and marker, the same
    for a method on all tasks. status: DONE, or why there is no score. check: what `bench verify` found; None if it was
    not asked. rank: the best and the worst that the tests
    leave; None without a score.
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

    @cached_property
    def _found(self) -> dict[str, Figure]:
        return {}

    @property
    def readings(self) -> int:
        """Count the readings of a trial."""
        return self.bundle.runs[0].readings

    @property
    def ms_per_reading(self) -> float:
        """Give the processor time of a reading, ms: of a recognition, the median over the trials, by its readings."""
        return 1e3 * recognition_seconds(self.pooled.trials, self.readings) / self.readings

    @property
    def slowest_ms(self) -> float:
        """Give the processor time, ms, that only one reading in a hundred takes longer than."""
        return 1e3 * float(np.quantile(self.pooled.trials.seconds, 0.99))

    def figure(self, name: str) -> Figure:
        """Compute a figure of a task, such as accuracy@5 or settled_95, with its interval where there is one.

        Raises InputError for a reading that the trials do not have.
        """
        if name not in self._found:  # a bootstrap each
            self._found[name] = self._computed(name)
        return self._found[name]

    def _computed(self, name: str) -> Figure:
        metric, _, at = name.partition("@")
        reading = int(at) if at else self.readings
        if not 1 <= reading <= self.readings:
            raise InputError(f"{self.path}: {name} of trials of {self.readings} readings")
        if metric in READINGS:
            return READINGS[metric](self.pooled)
        known = self.pooled.trials.known
        if metric == "error_all_mm":
            return self.pooled.mean(self.pooled.errors[:, reading - 1], of=known)
        curve = CURVES.get({ACCURACY: "right", "error_mm": "error"}.get(metric, metric))
        if curve is not None:
            return curve(self.pooled, reading - 1)
        found = (METRICS | HEADLINES)[metric].compute(Scored(self.pooled.trials, self.bundle.runs[0].objects))
        return Figure(found[reading - 1] if at else found, None, None)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two methods on the trials of a task: won and lost trials of the first, and the difference in error, mm.

    difference, low, high: the first's mean error less the second's, and its 95 % interval; None where both named no
    letter of a trial. accuracy_p, error_p: of McNemar's test and of the bootstrap, corrected for all pairs of the task.
    told_apart: whether they are, in the figure that ranks.
    """

    first: Entrant
    second: Entrant
    won: int
    lost: int
    accuracy_p: float
    difference: float | None
    low: float | None
    high: float | None
    error_p: float
    told_apart: bool


@dataclass(frozen=True, eq=False)
class Standings:
    """A task with all who entered it, on the same data.

    task, data: the task's name, and the hash of its readings. known: the task as this version of tactsim has it;
    None if its name or its data are others. readings: of a trial. scored: the figures that the task names. ranked:
    those with a score, the best first. unranked: the others. by: the figure that ranks. accuracy_by, error_by: the
    figures by which all pairs of `ranked` are compared.
    """

    task: str
    data: str
    known: Task | None
    readings: int
    scored: tuple[str, ...]
    ranked: tuple[Entrant, ...]
    unranked: tuple[Entrant, ...]
    by: str
    accuracy_by: str
    error_by: str
    accuracies: Accuracies
    errors: Errors

    @property
    def trials(self) -> int:
        """Count the trials of a method."""
        return len(self.ranked[0].bundle.ids) if self.ranked else 0

    @property
    def columns(self) -> list[str]:
        """List the figures of the table: what ranks, accuracy, error, error over bound, and what else is scored."""
        last = self.readings
        if not last:  # a task of another version, with which nobody was done
            return []
        accuracy = [f"accuracy@{at}" for at in (*(k for k in _SEEN if k < last), last)]
        error = [f"error_mm@{at}" for at in (*(k for k in _SEEN_OF_ERROR if k < last), last)]
        return list(dict.fromkeys([self.by, *accuracy, *error, f"efficiency@{last}", *self.scored]))

    @property
    def paper(self) -> tuple[Printed, ...]:
        """List what the paper reports; nothing but for the task that has its protocol."""
        return PRINTED if self.known is not None and self.task == PAPER else ()

    @property
    def pairs(self) -> list[Pair]:
        """Compare all pairs of ranked methods, those placed better first."""
        order = zip(*np.triu_indices(len(self.ranked), 1), strict=True)
        return [self._pair(int(i), int(j)) for i, j in order]

    @property
    def neighbours(self) -> list[Pair]:
        """Compare each ranked method with the next."""
        return [self._pair(i, i + 1) for i in range(len(self.ranked) - 1)]

    def _pair(self, i: int, j: int) -> Pair:
        accuracies, errors = self.accuracies, self.errors
        apart = [float(values[i, j]) for values in (errors.difference, errors.low, errors.high)]
        difference, low, high = apart if np.isfinite(apart[0]) else (None, None, None)
        p_of = accuracies.p if self.by == self.accuracy_by else errors.p
        return Pair(
            self.ranked[i], self.ranked[j], int(accuracies.wins[i, j]), int(accuracies.wins[j, i]),
            float(accuracies.p[i, j]), difference, low, high, float(errors.p[i, j]), bool(p_of[i, j] <= LEVEL),
        )  # fmt: skip


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
    """Read all bundles (*.zip) of a folder and rank them, each on its task and data.

    progress(stage, done, total) is called for the stage "bundles". Raises InputError if the folder holds no bundle.
    """
    paths = sorted(folder.glob("*.zip")) if folder.is_dir() else []
    if not paths:
        raise InputError(
            f"{folder} holds no bundle (*.zip); `bench submit TASK --estimator NAME --out BUNDLE` makes one"
        )
    bundles: dict[tuple[str, str], list[tuple[Path, Bundle]]] = {}
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
            checks[path] = read_record(path)
        except InputError as error:
            unreadable.append((record_path(path), str(error).removeprefix(f"record {record_path(path)}: ")))
        bundles.setdefault((bundle.task, bundle.task_data), []).append((path, bundle))
    progress("bundles", len(paths), len(paths))
    methods = sorted({bundle.method for alike in bundles.values() for _, bundle in alike})
    numbers = {method: number for number, method in enumerate(methods)}
    standings = [_standings(name, data, alike, numbers, checks) for (name, data), alike in bundles.items()]
    standings.sort(key=lambda of: (of.known is None, of.task, of.data))
    return Folder(tuple(standings), tuple(unreadable))


def _read(path: Path) -> Bundle:
    bundle = read_bundle(path)
    if bundle.runs:
        if len(bundle.ids) > MOST_TRIALS:
            raise InputError(
                f"bundle {path}: {len(bundle.ids):,} trials; a leaderboard takes {MOST_TRIALS:,}"
            )
        _ = bundle.pooled  # raises if its runs are not of one kind
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
    scored = [one for one in entrants if one.status == DONE]
    readings = known.readings if known else (scored[0].readings if scored else 0)
    figures = known.scored if known else (f"error_all_mm@{readings}", f"accuracy@{min(5, readings)}")
    accuracy_by = _first(figures, (ACCURACY,)) or f"accuracy@{min(5, readings)}"
    error_by = _first(figures, ERRORS) or f"error_all_mm@{readings}"
    by = _first(figures, (ACCURACY, *ERRORS)) or accuracy_by

    # What is the same by the figure that ranks is put in the order of the other one.
    order = (accuracy_by, error_by) if by == accuracy_by else (error_by, accuracy_by)
    scored.sort(key=lambda one: (*(_loss(one.figure(figure), figure) for figure in order), one.label))
    accuracies, errors = _compare(scored, accuracy_by, error_by)
    if by == accuracy_by:
        better = (accuracies.p <= LEVEL) & (accuracies.wins > accuracies.wins.T)
    else:
        better = (errors.p <= LEVEL) & (errors.difference < 0)
    places = ranks(better)
    return Standings(
        name, data, known, readings, figures,
        tuple(replace(one, rank=rank) for one, rank in zip(scored, places, strict=True)),
        tuple(sorted((one for one in entrants if one.status != DONE), key=lambda one: one.label)),
        by, accuracy_by, error_by, accuracies, errors,
    )  # fmt: skip


def _status(bundle: Bundle, check: Record | None, right: frozenset[TrialKey]) -> str:
    """Give a bundle's status: DONE only if it has the task's trials and no check spoke against it.

    A check with other code than the bundle's may not confirm it, but that does not speak against it.
    """
    if bundle.status != DONE:
        return bundle.status
    if not right or _trials(bundle) != right:
        return OTHER_TRIALS
    return DONE if check is None or check.verified or check.other_code else f"not confirmed: {check.said}"


def _known(name: str, data: str) -> Task | None:
    """Find the task that a bundle names; None if this version of tactsim has it not, or with other data."""
    if name not in names():
        return None
    found = task(name)
    return found if found.data in (None, data) else None


def _first(figures: Iterable[str], metrics: Sequence[str]) -> str | None:
    return next((one for one in figures if one.partition("@")[0] in metrics), None)


def _loss(found: Figure, figure: str) -> float:
    """Give a number that is smaller for the better; infinity where the figure is undefined."""
    if found.value is None:
        return np.inf
    return -found.value if figure.startswith(f"{ACCURACY}@") else found.value


def _pad(run: Run) -> Pad:
    """Find the pad that a run's readings were recorded or pressed with."""
    return checked(Pad, statements(run.about["scan"])["pad"] or {}, "pad")


def _trials(bundle: Bundle) -> frozenset[TrialKey]:
    """Name the trials of a bundle whose objects lie where the seed puts them."""
    found = set()
    for run in bundle.runs:
        reach, unknown = offsets(_pad(run).taxel_xy), poses_unknown(run.about["scan"])
        for letter, number, pose in zip(
            run.trials.truth.tolist(), run.trials.trial.tolist(), run.trials.true_pose[:, 0], strict=True
        ):
            rng = generator(run.seed, OneTrial(letter, number), 0)
            drawn = draw_true_pose(rng, reach, poses_unknown=unknown)
            if np.allclose(drawn, pose, rtol=0, atol=0.005):  # a bundle keeps 1/512 mm
                found.add((run.seed, letter, number, run.readings))
    return frozenset(found) if len(found) == len(bundle.ids) else frozenset()


def _trials_of_the_task(known: Task | None, bundles: Sequence[Bundle]) -> frozenset[TrialKey]:
    """Name the trials that a task asks for; of a task that is not known, those that most of its bundles have."""
    if known is not None and known.letters:
        return frozenset(
            (seed, letter, number, known.readings)
            for seed in known.seeds
            for letter in known.letters
            for number in range(known.trials)
        )
    found = Counter(_trials(one) for one in bundles if one.runs)
    return found.most_common(1)[0][0] if found else frozenset()


def _compare(scored: Sequence[Entrant], accuracy_by: str, error_by: str) -> tuple[Accuracies, Errors]:
    """Compare all pairs, with the trials of all in one order."""
    if not scored:
        empty = np.empty((0, 0))
        return Accuracies(empty.astype(np.int64), empty), Errors(empty, empty, empty, empty)
    orders = [_order(one.bundle) for one in scored]
    at_accuracy, at_error = (int(by.partition("@")[2]) - 1 for by in (accuracy_by, error_by))

    def column(values: Iterable[NDArray]) -> NDArray:
        return np.stack([of_one[order] for of_one, order in zip(values, orders, strict=True)])

    trials = [one.pooled.trials for one in scored]
    counted = [_counted(of, error_by)[:, at_error] for of in trials]
    counts = scored[0].pooled.counts[:, orders[0]]
    return (
        compare_accuracies(column(of.right[:, at_accuracy] for of in trials)),
        compare_errors(column(one.pooled.errors[:, at_error] for one in scored), column(counted), counts),
    )


def _order(bundle: Bundle) -> NDArray[np.int64]:
    ids = bundle.ids
    return np.array(sorted(range(len(ids)), key=ids.__getitem__))


def _counted(trials: Trials, error_by: str) -> NDArray[np.bool_]:
    """Mark the estimates (n, r) whose error counts: where the letter was named, or of all known letters."""
    if error_by.startswith("error_mm@"):
        return trials.named
    return trials.known[:, None] & np.ones_like(trials.right)
