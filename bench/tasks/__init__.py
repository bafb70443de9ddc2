"""Frozen tasks: what is asked of a method, so that results of different people can stand beside each other.

Lives here: the tasks, a file `NAME.toml` each, and what reads them, hashes the data that they give and says who is
best. Does not live here: how a run is done, which is the same with and without a task.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from tactsim.bench.config import RECORDING, RunConfig, merged, nested, run_config, whole_number
from tactsim.bench.kinds import OF_THE_METHOD
from tactsim.bench.score import CURVES, HEADLINES
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import parse_toml, read_toml
from tactsim.core.errors import short, unknown
from tactsim.estimators import create

__all__ = ["Task", "names", "task"]

# Fields of a run that have a place of their own in a task's file, or are none of its.
_NOT_WORDS = (*OF_THE_METHOD, "task", "seed", "trials", "readings", "given")
_PATHS = ("scan", "train_scan", "presses", "shapes", "world", "pad")
_OF_WHOLE_TRIALS = tuple(name for name, metric in HEADLINES.items() if not metric.table)
_RANKING = ("accuracy", "error_mm", "error_all_mm")
_LEAST_SEEDS = 5  # trials of one scan share its maps: a figure of a single scan says nothing of the next
Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Task(BaseModel):
    """What is asked of a method: the same readings, objects and trials for everybody.

    A task that has been published does not change any more: another one gets another name, `letters-v2` after
    `letters-v1`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(description="its file's name; the version is the end of it")
    line: str = Field(min_length=1, max_length=200, description="what is asked, in one sentence")
    words: dict[str, Any] = Field(description="options of `bench run`, with underscores")
    seeds: tuple[Annotated[int, Field(ge=0, lt=2**63)], ...] = Field(
        min_length=_LEAST_SEEDS, description="one run a seed"
    )
    development: tuple[Annotated[int, Field(ge=0, lt=2**63)], ...] = Field(
        (),
        exclude_if=lambda seeds: not seeds,
        description="other seeds, to develop a method and choose its options on; a run of one is no result",
    )
    trials: int = Field(ge=1, le=1_000_000, description="trials for each letter and seed")
    readings: int = Field(ge=1, description="readings a trial")
    scored: tuple[str, ...] = Field(
        min_length=1, description="figures, METRIC@READING or METRIC; the first ranks, an accuracy or error"
    )
    hashes: tuple[Hash, ...] = Field(
        (),
        description="SHA-256 of the data of each seed, in their order; `bench tasks FILE --check` prints them",
    )

    @field_validator("seeds")
    @classmethod
    def _each_seed_once(cls, seeds: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(seeds)) < len(seeds):
            raise ValueError("a seed is named twice")
        return seeds

    @model_validator(mode="after")
    def _development_is_apart(self) -> Task:
        if both := sorted(set(self.seeds) & set(self.development)):
            raise ValueError(f"seed {both[0]} is among seeds and development; results are of other data")
        return self

    @property
    def data(self) -> str | None:
        """Name the data of all seeds by one hash (SHA-256, hex); None if the task does not state it."""
        return hashlib.sha256(" ".join(self.hashes).encode()).hexdigest() if self.hashes else None

    @property
    def pressed(self) -> bool:
        """Tell whether its readings are pressed, and do not come from a recording or a file."""
        return self._config({}).pressed

    @property
    def letters(self) -> tuple[str, ...]:
        """List what is tried, held out or not: letters and shapes; () if a file of readings says which."""
        config = self._config({})
        if not config.pressed:
            return config.letters or ()
        options = config.scan_options
        return (*options.letters, *(Path(shape).stem for shape in options.shapes))

    @property
    def held_out(self) -> tuple[str, ...]:
        """List the letters that are tried but not trained on; ("each",) if each is in its own trials."""
        return self._config({}).hold_out

    @property
    def chosen(self) -> bool:
        """Tell whether the method chooses where to touch."""
        return self.words.get("explore") == "information"

    def configs(self, estimator: str, options: Mapping[str, Any] | None = None) -> list[RunConfig]:
        """Give the runs of a method on this task, one a seed.

        estimator: a registered name. options: of the estimator, as `set` of a run.
        Raises InputError for an unknown estimator or option.
        """
        words: dict[str, Any] = {"estimator": estimator, "set": dict(options or {})}
        create(estimator, **words["set"])
        return [run_config(**words, task=self.name, seed=seed) for seed in self.seeds]

    def completed(self, words: Mapping[str, Any]) -> dict[str, Any]:
        """Complete the options of one run by those of this task; `words` may leave out all that the task says.

        The first seed is the default. Fewer trials or readings than the task's, and a seed for development, make a
        look at it, which is not one of the task's runs: its `task` is None. Where touches may be chosen they may also
        be taken blindly, as they are by an estimator that proposes none.

        Raises InputError for an option that contradicts the task.
        """
        asked = {name: value for name, value in words.items() if name != "task"}
        asked |= {name: nested(asked[name]) for name in ("scan_set", "slip") if name in asked}
        for name in ("scan", "train_scan", "presses", "given"):  # before what goes with readings of one's own
            if asked.get(name) is not None and name not in self.words:
                raise InputError(
                    f"{name}: task {self.name} has readings of its own; leave out {name} or the task"
                )
        said = checked(RunConfig, merged({**self._words, "seed": self.seeds[0]}, asked), "run")
        if said.seed not in (*self.seeds, *self.development):
            seeds = ", ".join(map(str, self.seeds))
            if self.development:
                seeds += f" and, for development, {', '.join(map(str, self.development))}"
            raise InputError(f"seed {said.seed}: task {self.name} has the seeds {seeds}; name one of them")
        chosen = {name: value for name, value in asked.items() if name in OF_THE_METHOD}
        chosen |= {"seed": said.seed, "task": words["task"] if said.seed in self.seeds else None}
        wanted = self._config(chosen)
        for name in asked:
            value, right = getattr(said, name), getattr(wanted, name)
            if name in ("trials", "readings") and value < right:
                chosen |= {name: value, "task": None}
            elif name == "explore" and (right, value) == ("information", "blind"):
                chosen[name] = value
            elif value != right and not (name == "letters" and value == self.letters):
                own, says = map(_typed, (value, self.letters if name == "letters" else right))
                raise InputError(f"{name} {own}: task {self.name} says {says}; leave out {name} or the task")
        # Who says whether touches are chosen need not have the estimator made here: a plug-in of somebody else's.
        unsaid = wanted.explore == "information" and "explore" not in asked
        if unsaid and not create(said.estimator, **said.options).proposes:
            chosen["explore"] = "blind"
        return self._words | chosen

    @property
    def _words(self) -> dict[str, Any]:
        return {**self.words, "trials": self.trials, "readings": self.readings}

    def _config(self, words: Mapping[str, Any]) -> RunConfig:
        return checked(RunConfig, {**self._words, **words}, f"task {self.name}: words")


def names() -> tuple[str, ...]:
    """List the tasks that come with the project."""
    there = (one.name for one in (files("tactsim.bench") / "tasks").iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in there if name.endswith(".toml")))


def task(name: str) -> Task:
    """Read a task, by its name or from a TOML file of one's own.

    A file's paths (scan, train_scan, presses, shapes, a world's or pad's file) are relative to the file.
    Raises InputError for an unknown name, a file that cannot be read, and for what is no whole task.
    """
    if not isinstance(name, str | Path):
        raise unknown("task", name, [*names(), "FILE.toml"])
    if name in names():
        table = parse_toml((files("tactsim.bench") / "tasks" / f"{name}.toml").read_bytes(), f"task {name}")
        return _checked(table, name)
    if name == "solids":
        raise InputError(
            "task 'solids' is of objects in space, which the command line runs: bench run --task solids"
        )
    path = Path(name)
    if path.suffix != ".toml":
        raise unknown("task", name, [*names(), "solids", "FILE.toml"])
    table = read_toml(path, "task")
    if isinstance(table.get("words"), dict):
        table["words"] = _beside(table["words"], path.parent)
    return _checked(table, name)


def _checked(table: dict[str, Any], name: str) -> Task:
    if "name" in table:
        raise InputError(f"task {name}: its file's name is its name; leave out name")
    made = checked(Task, {**table, "name": name}, f"task {name}")
    strange = [word for word in made.words if word in _NOT_WORDS or word not in RunConfig.model_fields]
    if strange:
        known = set(RunConfig.model_fields) - set(_NOT_WORDS)
        raise unknown(f"option in [words] of task {name}", strange[0], known)
    if made.hashes and len(made.hashes) != len(made.seeds):
        raise InputError(
            f"task {name}: {len(made.hashes)} hashes for {len(made.seeds)} seeds; give one a seed"
        )
    for figure in made.scored:
        _check_figure(figure, made)
    if made.scored[0].partition("@")[0] not in _RANKING:
        raise InputError(
            f"task {name}: scored: {made.scored[0]} cannot rank, as methods are compared trial by trial; begin with "
            f"one of {', '.join(_RANKING)}"
        )
    try:
        run_config(**made.words, trials=made.trials, readings=made.readings)
    except InputError as error:
        raise InputError(f"task {name}: words: {error}") from error
    return made


def _check_figure(figure: str, of: Task) -> None:
    """Check that the trials have a figure: METRIC@READING of a curve, or METRIC of whole trials."""
    metric, at, reading = figure.partition("@")
    if metric not in CURVES and metric not in _OF_WHOLE_TRIALS:
        raise unknown(f"figure in scored of task {of.name}", metric, [*CURVES, *_OF_WHOLE_TRIALS])
    if metric in CURVES and not 1 <= (whole_number(reading) or 0) <= of.readings:
        raise InputError(
            f"task {of.name}: scored: {short(figure)} says no reading from 1 to {of.readings}; write "
            f"{metric}@{of.readings}"
        )
    if metric in _OF_WHOLE_TRIALS and at:
        raise InputError(f"task {of.name}: scored: {short(figure)} is of whole trials; write {metric}")


def _beside(words: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Make the paths of a task's words relative to its file's folder."""

    def placed(name: str, value: Any) -> Any:
        if isinstance(value, list):
            return [placed(name, one) for one in value]
        is_path = isinstance(value, str) and (name not in ("world", "pad") or value.endswith(".toml"))
        is_path = is_path and not value.startswith(RECORDING)
        return str(folder / value) if is_path else value

    return {name: placed(name, value) if name in _PATHS else value for name, value in words.items()}


def _typed(value: Any) -> str:
    """Write a value as one types it: a list with commas."""
    return ",".join(map(str, value)) if isinstance(value, tuple) else short(value)
