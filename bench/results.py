"""`Run`, a finished run, how it shows itself, and its folder, of which `results/README.md` has the schema."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from tactsim.bench import columns, kinds
from tactsim.bench.config import flat
from tactsim.bench.kinds import PLANE, Kind
from tactsim.bench.score import Scored, figures, summarise
from tactsim.bench.trials import TrialPlan, TrialRules, Trials
from tactsim.core.checking import checked
from tactsim.core.errors import counted
from tactsim.core.files import new_folder, read_bytes, write_bytes, write_text
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE
from tactsim.press import WORLDS

if TYPE_CHECKING:
    from tactsim.bench.runs.figures import Picture


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run: what was asked, what came out, and how good it is.

    Every metric of `bench list metrics` is an attribute; curves are arrays over the reading count: `accuracy[4]` is the
    accuracy after five readings.

    config: the configuration. about: versions, machine, protocol, the estimator's description and options, eq.
    3's agreement. objects: what the error metric needs of each, such as a letter's `Properties`. work: counts of
    what was done and skipped. trials: the raw result, an array a column. times: seconds of each stage and peak memory.
    plan: what is needed to do trials again. maps: what was learned of each object, such as its occupancy map. A
    loaded run has neither plan nor maps. bounds: (n, r) mm, the Cramer-Rao bound of each trial after each reading
    (`tactsim.bench.cramer_rao`); None if it is not known. shape_files: of shapes of the user's own, in the plane; of a
    loaded run those that its folder keeps.
    """

    config: dict[str, Any]
    about: dict[str, Any]
    objects: dict[str, Any]
    work: dict[str, Any]
    trials: Trials
    times: dict[str, Any]
    plan: TrialPlan | None = None
    maps: Mapping[str, Any] = field(default_factory=dict)
    bounds: FloatArray | None = None
    shape_files: tuple[Path, ...] = ()

    if not TYPE_CHECKING:  # which would let it stand for any name that was mistyped

        def __getattr__(self, name: str) -> Any:
            """Give a metric of `bench list metrics`: a curve (readings,), NaN where undefined, or of whole trials."""
            if name.startswith("_") or name == "trials" or name not in figures(self.trials.kind):
                raise AttributeError(f"a run has no {name}")
            value = self.summary.get(name)
            if name not in self.summary:
                value = figures(self.trials.kind)[name].compute(self.scored)
            return np.array(value, dtype=float) if isinstance(value, list) else value

    @cached_property
    def scored(self) -> Scored:
        """The trials with what figures need of them."""
        return Scored(self.trials, self.objects, self.bounds)

    @property
    def bound_mm(self) -> FloatArray:
        """Mean Cramer-Rao bound of the trials, (readings,) mm; NaN where it is the prior's or not known."""
        return np.array(self.against_bound["bound_mm"], dtype=float)

    @property
    def efficiency(self) -> FloatArray:
        """Mean error over mean bound of the same trials, (readings,); NaN where the bound is."""
        return np.array(self.against_bound["efficiency"], dtype=float)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Every metric by name, computed from the trials: lists over the reading count, and headlines."""
        return summarise(self.scored)

    @cached_property
    def against_bound(self) -> dict[str, Any]:
        """The bound of the error, and error over bound, by reading: `bound_mm`, `determined`, `efficiency`."""
        if self.bounds is None:
            return dict.fromkeys(("bound_mm", "determined", "efficiency"), [None] * self.readings)
        from tactsim.bench.cramer_rao import bound_curves  # a run without bounds does without their room

        return bound_curves(self.bounds, self.scored)

    @property
    def badly_explained(self) -> str | None:
        """Say it if many of the readings were explained worse than those of training; None if few were."""
        share = self.work.get("badly_explained", 0) / self.trials.taken.sum()
        return f"{share:.0%} of the readings are {BADLY_EXPLAINED}" if share > _OFTEN else None

    @property
    def refusing(self) -> str | None:
        """Say it if many trials of known letters end in "none"; None if few do."""
        share = self.summary["refused_known"][-1] or 0.0
        if share <= _MUCH_REFUSED:
            return None
        return (
            f"{share:.0%} of the trials of a known {self.thing} end in {NONE!r}: readings differ from those of "
            "training, say in their load; take training presses of every load, or do without `unknown`"
        )

    @property
    def ended(self) -> str | None:
        """Say after how many touches trials ended, and how often they were right then; None if all took all."""
        stop_at, touches = self.config.get("stop_at"), self.summary["touches"]
        if stop_at is None and touches == self.readings:
            return None
        rule = "" if stop_at is None else f" when the most probable {self.thing} had p of {stop_at:g} or more"
        return (
            f"a trial ended{rule}: after {touches:.1f} touches on average, {self.summary['accuracy'][-1]:.2f} right "
            "then; later figures repeat its last answer"
        )

    @property
    def cautions(self) -> list[str]:
        """List what a reader should know before trusting the figures, a line each."""
        alone = self.about.get("alone")
        said = alone and f"nothing to tell apart: {alone} is the only {self.thing} that is known"
        lines = [line for line in (said, self.ended, self.badly_explained, self.refusing) if line]
        return lines + self.kind.cautions(self)

    @property
    def estimator(self) -> str:
        """The estimator's name."""
        return self.config["estimator"]

    @property
    def described(self) -> str:
        """The estimator's name, and in brackets how it was set up if it says so."""
        how = self.about["description"]
        return f"{self.estimator} ({how})" if how else self.estimator

    @property
    def options(self) -> dict[str, Any]:
        """All options of the estimator, those that were not given included."""
        return self.about["options"]

    @property
    def letters(self) -> list[str]:
        """The letters that were tried."""
        return self.about["letters"]

    @property
    def readings(self) -> int:
        """The number of readings of a trial."""
        return self.trials.label.shape[1]

    @property
    def kind(self) -> Kind:
        """The kind of run: letters in the plane, or another one."""
        return kinds.load(self.trials.kind)

    @property
    def thing(self) -> str:
        """What is recognised: a letter where all are, else an object."""
        return self.kind.thing if all(len(label) == 1 for label in self.letters) else "object"

    @property
    def on_demand(self) -> bool:
        """Whether each touch of a trial was pressed when it was chosen."""
        if self.kind.own_touches:
            return True
        given = any(self.config.get(name) is not None for name in ("scan", "given", "presses"))
        return self.config["explore"] != "random" and not given

    @property
    def seed(self) -> int:
        """The seed of the trials."""
        return self.config["seed"]

    @property
    def task(self) -> str | None:
        """The frozen task whose run this is (`tactsim.bench.tasks`); None if it is none's."""
        return self.config.get("task")

    @property
    def protocol(self) -> str:
        """The name of the protocol; only runs of one protocol may be compared."""
        return self.about["protocol"]

    @property
    def versions(self) -> dict[str, str]:
        """The versions of Python and of the libraries that the result depends on."""
        return self.about["versions"]

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds of each stage by the clock, and of an update, an estimate and a choice by the processor."""
        return self.times["seconds"]

    def as_json(self) -> dict[str, Any]:
        """Put the run into one flat object, as `bench run --json` prints it."""
        rules = (rule.name for rule in fields(TrialRules) if rule.name in self.config)
        asked = ("estimator", "trials", *rules, *self.kind.asked)
        found = ("options", "description", "protocol", "versions", "machine")
        return {
            **self.summary,
            **self.kind.as_json(self),
            "task": self.task,
            **{name: self.config[name] for name in asked},
            **{name: self.about[name] for name in found},
            "seconds": self.times["seconds"],
            "peak_memory_mb": self.times["peak_memory_mb"],
            "work": self.work,
        }

    def columns(self) -> dict[str, NDArray[Any]]:
        """Give the trials as columns, one row a trial and reading, as trials.csv and times.csv name them."""
        return columns.columns(self.trials)

    def table(self) -> Any:
        """Give the columns and the placement error, `error_mm`, as a pandas DataFrame; without pandas, as arrays."""
        table = self.columns() | {"error_mm": self.scored.error.ravel()}
        try:
            from pandas import DataFrame
        except ImportError:
            return table
        return DataFrame(table)

    def plot(self, ax: Any = None) -> Any:
        """Draw accuracy and placement error, with intervals, against readings seen (the paper's figure 7).

        ax: matplotlib Axes to draw on, one for the accuracy or two for accuracy and error; it is returned. By default
        a figure is made and returned. Raises InputError for other axes, and for axes of a run that is not in the plane.
        """
        return self.kind.plot(self, ax)

    def plot_maps(self) -> Picture:
        """Draw the learned occupancy maps (the paper's figure 4), or the like. Raises InputError without any."""
        return self.kind.plot_maps(self.maps)

    def plot_shapes(self) -> Picture:
        """Draw the outlines of the user's own shapes as they were read. Raises InputError if there are none."""
        from tactsim.bench.report.picture import outlines_figure
        from tactsim.models import shape

        return outlines_figure([shape(path) for path in self.shape_files])

    def save(self, folder: str | Path) -> Path:
        """Write the run's files and pictures to a new folder, whole or not at all, and return its path.

        Raises InputError if the folder holds something or cannot be written.
        """
        with new_folder(folder) as inside:
            save(self, inside)
            for name, draw in picture_names(self).items():
                write_bytes(inside / name, draw().png())
        return Path(folder)

    @classmethod
    def load(cls, folder: str | Path) -> Run:
        """Read a run's folder. Raises InputError if it is not a run, is not whole or has another schema."""
        from tactsim.bench.runs.saved import load

        return load(folder)

    def report(self, path: str | Path) -> Path:
        """Write one HTML page about this run, and its curves as CSV beside it; returns the page's path.

        Raises InputError if it is not called so, cannot be written or would replace what is no report.
        """
        from tactsim.bench.report.write import write_pages

        write_pages([(Path(self.estimator), self)], Path(path))
        return Path(path)

    def __repr__(self) -> str:
        """Say in one line what was tried and how it ended."""
        return f"<Run of {self.asked}: {self.outcome}>"

    @property
    def asked(self) -> str:
        """What was tried, in a line."""
        return (
            f"{self.described}, {counted(len(self.trials.truth), 'trial')} of "
            f"{counted(self.readings, self.kind.touch)} over {' '.join(self.letters)}, {self.protocol}"
        )

    @property
    def outcome(self) -> str:
        """How it ended, in a line."""
        names = ("accuracy", "accuracy_low", "accuracy_high", "error_mm")
        accuracy, low, high, error = (self.summary[name][-1] for name in names)
        of_error = "" if error is None else f", error {error:.2f} mm"
        settled, touch = self.summary["all_right_from"], self.kind.touch
        ended = f"every trial right from {touch} {settled}" if settled else "some trials still wrong"
        shown = f"accuracy {accuracy:.3f} [{low:.3f}, {high:.3f}]{of_error}"
        return f"{shown} after {counted(self.readings, touch)}; {ended}"

    def _repr_html_(self) -> str:
        """Show the run in a notebook: what was tried, a small table and the curves."""
        from tactsim.bench.runs.tables import in_notebook

        return in_notebook(self)


BADLY_EXPLAINED = (
    "explained worse than the training's: other places, lighter presses, another pad, an unknown object?"
)
_MUCH_REFUSED = 0.2  # of the trials of known letters
_OFTEN = 0.25  # a share of the readings that neither chance nor a rough world reaches
PACKED = "trials.npz"  # what a bundle keeps in place of the tables of a run's folder
SHAPES = "shapes"  # a run's folder of the files of the user's own shapes
# bounds.csv: one row per trial and reading, in the same order; only where the bound is known.
BOUND_COLUMNS = ("truth", "trial", "reading_number", "bound_mm")


def task_name(run: Run, *, with_seed: bool = True) -> str:
    """Say in which motion, letters, readings and seed a run differs from the defaults; "defaults" if in none.

    Runs with one protocol and one task name saw the same readings; without the seed, readings of the same kind.
    """
    config = run.config
    files = ("scan", "train_scan", "train_presses", "presses")
    other = {name: config[name] for name in files if config.get(name)}
    if config.get("given"):
        other["readings"] = config["given"][:12]
    elif not (config.get("scan") or config.get("presses")):
        kind, of_scan = run.kind.scan_options, run.about["scan"].get("options", {})
        stated = checked(kind, of_scan, "the options of the run's scan")
        mine, standard = (flat(options.model_dump(mode="json")) for options in (stated, kind()))
        # test_poses is part of the protocol.
        other |= {k: v for k, v in mine.items() if k != "test_poses" and v != standard.get(k)}
        own = next((name for name in ("shapes", "meshes") if other.get(name)), None)
        if own is not None:  # of the user's own; that there is nothing beside them goes without saying
            other[own] = _in_folder(other[own])
            other = {k: v for k, v in other.items() if k not in ("letters", "objects") or v}
        if other.get("seed") == config["seed"]:
            del other["seed"]
    elif config.get("letters"):
        other["letters"] = config["letters"]
    words = [run.about["slip"]] if run.about.get("slip") else []
    for world, values in WORLDS.items():
        settings = flat(values)
        if settings and settings.items() <= other.items():
            words.append(world)
            other = {name: value for name, value in other.items() if name not in settings}
    if "seed" in other:
        words.append(f"scan's seed {other.pop('seed')}")
    if config["seed"] != 0 and with_seed:
        words.append(f"seed {config['seed']}")
    return ", ".join([*words, *(f"{name} {_word(value)}" for name, value in other.items())]) or "defaults"


def _in_folder(paths: Sequence[str]) -> str:
    """Name files, their folder once if they share it: examples/relief: cone.stl, dome.stl."""
    places = list(map(PurePosixPath, paths))
    if len({place.parent for place in places}) > 1 or len(places) == 1:
        return " ".join(paths)
    return f"{places[0].parent}: {', '.join(place.name for place in places)}"


def _word(value: Any) -> str:
    if not isinstance(value, list):
        return str(value)
    words = list(map(str, value))
    return _ranges(words) if all(len(word) == 1 for word in words) else " ".join(words)


def _ranges(letters: Sequence[str]) -> str:
    """Write letters as one types them: AEIOU, A-Z0-9."""
    parts: list[list[str]] = []
    for letter in letters:
        if parts and ord(letter) == ord(parts[-1][-1]) + 1:
            parts[-1].append(letter)
        else:
            parts.append([letter])
    return "".join(f"{part[0]}-{part[-1]}" if len(part) > 2 else "".join(part) for part in parts)


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class AnyConfig(_Strict):
    """The fields of a run's configuration that every reader needs; others may come from another version."""

    estimator: str
    seed: int
    scan: str | None
    trials: int | Literal["all"]
    explore: str
    hold_out: list[str] = []
    shapes: list[str] = []


class _Budget(_Strict):
    option: str
    value: int | str


class _Machine(_Strict):
    processor: str
    cores: int
    system: str


class _Scan(_Strict):
    """What the readings say of themselves, as far as every reader needs it."""

    options: dict[str, Any] = {}


class AnyAbout(_Strict):
    """The fields of run.json that every reader needs."""

    protocol: str
    description: str
    config: AnyConfig
    options: dict[str, Any]
    settings: dict[str, Any]
    budget: _Budget | None
    scan: _Scan
    commit: str | None
    versions: dict[str, str]
    machine: _Machine


def save(run: Run, folder: Path) -> None:
    """Write a run's files into `folder`; except for times.*, the same run gives the same bytes."""
    about, times = documents(run)
    write_text(folder / "run.json", to_json(about))
    kind = run.kind
    kind.save_objects(run.objects, folder)
    table = run.columns()
    write_text(folder / "trials.csv", columns.write_csv(kind.columns, table))
    write_text(folder / "times.csv", columns.write_csv(kind.time_columns, table))
    if run.bounds is not None:
        bounds = table | {"bound_mm": run.bounds.ravel()}
        write_text(folder / "bounds.csv", columns.write_csv(BOUND_COLUMNS, bounds))
    for path in run.shape_files:
        from tactsim.models.shapes import LARGEST_FILE

        (folder / SHAPES).mkdir(exist_ok=True)
        write_bytes(folder / SHAPES / path.name, read_bytes(path, LARGEST_FILE))
    write_text(folder / "summary.json", to_json(run.summary))
    write_text(folder / "times.json", to_json(times))


def documents(run: Run) -> tuple[dict[str, Any], dict[str, Any]]:
    """Give what run.json and times.json say of a run."""
    about = run.kind.stated(run, {"config": run.config, **run.about, "schema": run.kind.schema})
    if run.kind.name != PLANE:
        about["task"] = run.kind.name
    return about, run.times | {"work": run.work}


def picture_names(run: Run) -> dict[str, Callable[[], Picture]]:
    """Name the pictures of a run's folder, each with what draws it."""
    pictures: dict[str, Callable[[], Picture]] = {f"{run.kind.touches}.png": run.plot}
    if run.maps:
        pictures["maps.png"] = run.plot_maps
    if run.shape_files:
        pictures["shapes.png"] = run.plot_shapes
    return pictures


def to_json(value: Any) -> str:
    """Write JSON with sorted keys, one entry a line. Raises ValueError for NaN and infinity."""
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False, default=str) + "\n"
