"""Kinds of run: what differs between letters in the plane and, say, solids in space, and nothing else knows of either.

A kind is found by its name as an estimator is: those that come along, and those of installed packages, which name a
class like `Kind` as an entry point `tactsim.kinds`. The task that is called as a kind asks for a run of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self

import numpy as np

from tactsim.core.plug_ins import Registry
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan

if TYPE_CHECKING:
    from pydantic import BaseModel

    from tactsim.bench.report import Pages
    from tactsim.bench.results import Run
    from tactsim.bench.runs.figures import Picture
    from tactsim.bench.score import Metric, Scored
    from tactsim.bench.trials import Explore, OneTrial, Progress, TrialPlan, Trials
    from tactsim.estimators import Estimator

PLANE = "plane"
# What a task leaves to the method; all other fields of a run are the task's.
OF_THE_METHOD = ("estimator", "bins", "particles", "set", "bound")


class Config(Protocol):
    """What the harness asks of the configuration of a run of any kind, a pydantic model. kind: the kind's name."""

    kind: ClassVar[str]

    @property
    def estimator(self) -> str:
        """Name the estimator."""

    @property
    def trials(self) -> int | Literal["all"]:
        """Give the number of trials, of each object or of all; or all that the readings make."""

    @property
    def seed(self) -> int:
        """Give the seed of the trials."""

    @property
    def task(self) -> str | None:
        """Name the task, which may be the kind."""

    @property
    def shapes(self) -> tuple[Path, ...]:
        """Give the files of the user's own shapes."""

    @property
    def explore(self) -> Explore:
        """Say in which order touches are taken."""

    @property
    def options(self) -> dict[str, Any]:
        """Give the estimator's options."""

    @property
    def readings(self) -> int:
        """Give the number of readings of a trial."""

    @property
    def source(self) -> str:
        """Name the readings: runs with the same source share them."""

    @property
    def digest(self) -> str:
        """Hash what the run is asked to do."""

    def model_dump(self, *, mode: str) -> dict[str, Any]:
        """Give the fields as plain values."""

    def model_copy(self, *, update: dict[str, Any]) -> Self:
        """Give a copy with other values."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """The readings of a run, which letters are tried, and what it took to get them.

    objects: what the error needs of each, which does not depend on how much of the readings is trained on.
    """

    scan: Scan
    letters: tuple[str, ...]
    work: dict[str, Any]
    seconds: float
    objects: Mapping[str, Any]


class Kind:
    """One kind of run. What is not abstract here is what most kinds want.

    name: also of its task, of its scans, configurations, trials and estimators. thing, touch, things, touches: what is
    recognised, and by what. config: the model whose fields are the options of a run. scan_options: that of how objects
    are touched. pose: names of a pose's numbers. trials: what holds the raw result; fields that it has beside those of
    `Trials` are filled from `Touch.more`. metrics: beside those of every run. about: the model of run.json. schema: of
    run.json. columns: of trials.csv. poses: how the names of its poses begin, and which field of `trials` holds them.
    asked: fields of the configuration that JSON shows beside the estimator, trials, seed and order of touches.
    of_method: those that two runs of the same trials may differ in. errors: figures that are compared over the trials
    in which both runs name the object, with their values (n, r). own_touches: whether touches are of each trial alone,
    so that runs with other touches of the same hidden objects may be compared.
    """

    name: ClassVar[str]
    thing: ClassVar[str] = "object"
    touch: ClassVar[str] = "touch"
    touches: ClassVar[str] = "touches"
    config: ClassVar[type[BaseModel]]
    scan_options: ClassVar[type[BaseModel]]
    pose: ClassVar[tuple[str, ...]]
    trials: ClassVar[type[Trials]]
    metrics: ClassVar[Mapping[str, Metric]] = {}
    about: ClassVar[type[BaseModel]]
    schema: ClassVar[int] = 1
    columns: ClassVar[tuple[str, ...]]
    poses: ClassVar[Mapping[str, str]] = {"": "pose", "true_": "true_pose"}
    asked: ClassVar[tuple[str, ...]]
    of_method: ClassVar[tuple[str, ...]] = OF_THE_METHOD
    errors: ClassVar[Mapping[str, Callable[[Scored], FloatArray]]]
    own_touches: ClassVar[bool] = False

    @property
    def number(self) -> str:
        """Name the column that counts the readings of a trial."""
        return f"{self.touch}_number"

    @property
    def time_columns(self) -> tuple[str, ...]:
        """Name those of times.csv, of the same rows in the same order; the times differ whenever a run is repeated."""
        return ("truth", "trial", self.number, "update_s", "estimate_s", "propose_s")

    def configured(self, **words: Any) -> Config:
        """Build a run's configuration. Raises InputError with one line, also for a wrong option of the scan."""
        raise NotImplementedError

    def scanned(
        self, words: Mapping[str, Any], *, jobs: int, cache: bool, progress: Progress
    ) -> tuple[Scan, dict[str, Any]]:
        """Touch the objects that the words of `bench scan` say; returns the scan and counts of work."""
        raise NotImplementedError

    def check(self, config: Any) -> None:
        """Raise InputError for what can be told to be wrong before readings are made."""

    def gather(
        self, config: Any, *, scan: Scan | None, jobs: int, cache: bool, progress: Progress
    ) -> Gathered:
        """Get the readings of a run; scan: those that were given in Python. See `experiment.gather`."""
        raise NotImplementedError

    def check_gathered(self, config: Any, gathered: Gathered) -> None:
        """Raise InputError if there are too few readings for the trials."""

    def tasks(self, config: Any, gathered: Gathered) -> list[OneTrial]:
        """List the trials of a run, letter after letter."""
        raise NotImplementedError

    def plan(
        self, config: Any, scan: Scan, given: Estimator | None, objects: Mapping[str, Any] | None
    ) -> TrialPlan:
        """Put together what a worker needs to do the trials on these readings. objects: of `Gathered`."""
        raise NotImplementedError

    def hide(self, scan: Scan, rng: np.random.Generator) -> FloatArray:
        """Draw robot_in_object where a trial hides its object."""
        raise NotImplementedError

    def said(
        self, config: Any, gathered: Gathered, trials: Trials, estimator: Estimator
    ) -> tuple[dict[str, Any], FloatArray | None]:
        """Give what a run says of itself beside the rest, with its `protocol`, and its trials' bounds (n, r) mm."""
        raise NotImplementedError

    def maps(self, estimator: Estimator) -> Mapping[str, Any]:
        """Give what an estimator has learned of each object, for pictures."""
        return {}

    def shape_files(self, config: Any) -> tuple[Path, ...]:
        """Give the files of the user's own shapes that the folder of a run keeps."""
        return ()

    def cautions(self, run: Run) -> list[str]:
        """List what a reader should know before trusting the figures, a line each."""
        return []

    def as_json(self, run: Run) -> dict[str, Any]:
        """Give what `bench run --json` prints of such a run beside the rest."""
        return {"objects": run.letters}

    def stated(self, run: Run, about: dict[str, Any]) -> dict[str, Any]:
        """Complete what run.json says: add its objects."""
        raise NotImplementedError

    def objects_of(self, about: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Take the objects out of what run.json says, where `stated` put them, or read them from the run's folder."""
        raise NotImplementedError

    def save_objects(self, objects: Mapping[str, Any], folder: Path) -> None:
        """Write what run.json does not hold of the objects into a run's folder."""

    def plot(self, run: Run, ax: Any = None) -> Any:
        """Draw the curves of a run over its touches; see `Run.plot`."""
        raise NotImplementedError

    def plot_maps(self, maps: Mapping[str, Any]) -> Picture:
        """Draw what was learned of the objects."""
        raise NotImplementedError

    def page(self, of: Pages) -> tuple[list[Path], list[str]]:
        """Write the page of runs, and what stands beside it; returns what `report.write.write_pages` does."""
        raise NotImplementedError

    def table(self, run: Run, verbose: bool) -> list[str]:
        """Name the figures that the terminal shows of a run's readings beside what is right."""
        return ["error_mm"]

    def details(self, run: Run) -> list[str]:
        """Say in a few lines, of `bench run --verbose`, what such a run has to say beside the rest."""
        return []

    def nexts(self, run: Run) -> list[str]:
        """Suggest what to try next, a line each."""
        return []


def _fault(chosen: Any) -> str | None:
    return None if isinstance(chosen, type) and issubclass(chosen, Kind) else "is no subclass of kinds.Kind"


_KINDS = Registry(
    "kind of run",
    "tactsim.kinds",
    {
        PLANE: ("tactsim.bench.plane:Plane", "letters in the plane"),
        "solids": ("tactsim.solids.kind:Solids", "objects in space"),
    },
    _fault,
)
names = _KINDS.names


def load(name: str) -> Kind:
    """Give the kind of that name. Raises InputError if there is none."""
    found: Kind = _KINDS.load(name)()
    return found


def of_task(task: Any) -> Kind:
    """Give the kind that a task is called as: that of letters in the plane for all other tasks, and for None."""
    return load(task if task is not None and task in names() else PLANE)
