"""Write the files of a run, and read them back unchanged. `results/README.md` has the schema."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from tactsim.bench.config import EACH
from tactsim.bench.placement_error import Properties
from tactsim.bench.run import Run
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import read_json, read_text
from tactsim.core.errors import short
from tactsim.core.files import new_folder, write_bytes, write_text
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.core.scan import is_label

if TYPE_CHECKING:
    from tactsim.bench.figures import Picture

SCHEMA = 3
_LARGEST_TABLE = 1 << 30  # bytes
# trials.csv: one row per trial and reading, the same on every machine for the same seed.
COLUMNS = (
    "truth", "trial", "reading_number", "reading", "label", "p_truth", "p_label", "x", "y", "theta",
    "true_x", "true_y", "true_theta", "credibility", "radius_90", "evaluations",
)  # fmt: skip
# times.csv: one row per trial and reading, in the same order; the times differ whenever a run is repeated.
TIME_COLUMNS = ("truth", "trial", "reading_number", "update_s", "estimate_s", "propose_s")

# bounds.csv: one row per trial and reading, in the same order; only where the bound is known.
BOUND_COLUMNS = ("truth", "trial", "reading_number", "bound_mm")


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Config(_Strict):
    """The fields of a run's configuration that every reader needs; others may come from another version."""

    estimator: str
    seed: int
    hold_out: list[str]
    scan: str | None
    train_scan: str | None
    given: str | None
    letters: list[str] | None
    trials: int
    readings: int
    explore: str


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


class _About(_Strict):
    """The fields of run.json that every reader needs."""

    config: _Config
    objects: dict[str, Any]
    protocol: str
    description: str
    options: dict[str, Any]
    settings: dict[str, Any]
    budget: _Budget | None
    letters: list[str]
    classifier_agreement: float | None
    scan: _Scan
    source: str
    commit: str | None
    versions: dict[str, str]
    machine: _Machine
    slip: str = ""


class _Times(_Strict):
    """The fields of times.json that every reader needs."""

    seconds: dict[str, float]
    work: dict[str, Any]
    peak_memory_mb: float


def save(run: Run, folder: Path) -> None:
    """Write a run's files into `folder`; except for times.*, the same run gives the same bytes."""
    write_text(
        folder / "run.json",
        to_json(
            {
                "schema": SCHEMA,
                "config": run.config,
                "objects": {label: asdict(of) for label, of in run.objects.items()},
                **run.about,
            }
        ),
    )
    table = columns(run.trials)
    write_text(folder / "trials.csv", write_table(COLUMNS, table))
    write_text(folder / "times.csv", write_table(TIME_COLUMNS, table))
    if run.bounds is not None:
        table = columns(run.trials) | {"bound_mm": run.bounds.ravel()}
        write_text(folder / "bounds.csv", write_table(BOUND_COLUMNS, table))
    write_text(folder / "summary.json", to_json(run.summary))
    write_text(folder / "times.json", to_json(run.times | {"work": run.work}))


def save_with_pictures(run: Run, folder: Path) -> Path:
    """Write a run's folder, pictures included, whole or not at all, and return its path.

    Raises InputError if the folder holds something or cannot be written.
    """
    with new_folder(folder) as inside:
        save(run, inside)
        for name, draw in pictures(run).items():
            write_bytes(inside / name, draw().png())
    return folder


def pictures(run: Run) -> dict[str, Callable[[], Picture]]:
    """Name the pictures of a run's folder, each with the function that draws it."""
    maps = {"maps.png": run.plot_maps} if run.maps else {}
    return {"readings.png": run.plot} | maps


def load(path: str | Path) -> Run:
    """Read a run's folder. Raises InputError if it is not a run, is not whole or has another schema."""
    folder = Path(path)
    if not (folder / "run.json").is_file():
        raise InputError(f"{folder} is not the folder of a run: it has no run.json")
    about = read_json(folder / "run.json", "file of a run")
    if "symmetries" in about:
        raise InputError(
            f"{folder} is a run with objects in space; give runs of one kind, to report or compare"
        )
    if about.pop("schema", None) != SCHEMA:
        raise InputError(f"{folder / 'run.json'}: unknown schema; this version reads schema {SCHEMA}")
    try:
        checked(_About, about, "run.json")
        times = read_json(folder / "times.json", "file of a run")
        checked(_Times, times, "times.json")
        objects = {
            label: Properties.stated(of, f"run.json: objects.{label}")
            for label, of in about.pop("objects").items()
        }
        trials = _trials(
            read_table(folder / "trials.csv", COLUMNS),
            read_table(folder / "times.csv", TIME_COLUMNS),
            about["config"]["hold_out"],
        )
        bounds = None
        if (folder / "bounds.csv").is_file():
            bounds = _bounds(read_table(folder / "bounds.csv", BOUND_COLUMNS), trials)
        if not set(trials.truth.tolist()) <= set(objects):
            raise InputError("run.json: objects: a letter of trials.csv is missing")
    except InputError as error:
        raise InputError(f"{folder} is not a whole run: {error}") from error
    return Run(about.pop("config"), about, objects, times.pop("work"), trials, times, bounds=bounds)


def to_json(value: Any) -> str:
    """Write JSON with sorted keys, one entry a line. Raises ValueError for NaN and infinity."""
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False, default=str) + "\n"


def columns(trials: Trials) -> dict[str, NDArray[Any]]:
    """Give the columns of trials.csv and times.csv, one row a trial and reading."""
    readings = trials.label.shape[1]
    x, y, theta = np.moveaxis(trials.pose, 2, 0)
    true_x, true_y, true_theta = np.moveaxis(trials.true_pose, 2, 0)
    values: dict[str, NDArray[Any]] = {
        "truth": trials.truth[:, None], "trial": trials.trial[:, None],
        "reading_number": np.arange(1, readings + 1), "x": x, "y": y, "theta": theta,
        "true_x": true_x, "true_y": true_y, "true_theta": true_theta,
    }  # fmt: skip
    names = dict.fromkeys((*COLUMNS, *TIME_COLUMNS))
    return {
        name: np.broadcast_to(
            values[name] if name in values else getattr(trials, name), trials.label.shape
        ).ravel()
        for name in names
    }


def write_table(names: tuple[str, ...], table: Mapping[str, NDArray[Any]]) -> str:
    """Write columns as CSV, each value so that it is read back to the bit."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(table[name].tolist() for name in names), strict=True))
    return stream.getvalue()


def read_table(path: Path, columns: tuple[str, ...]) -> dict[str, list[str]]:
    """Read the columns of a CSV table, as text. Raises InputError if it is not whole or has other columns."""
    try:
        lines = list(csv.reader(io.StringIO(read_text(path, "table of a run", _LARGEST_TABLE), newline="")))
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path} is not a whole table: {error}") from error
    header, rows = lines[:1], lines[1:]
    if header != [list(columns)] or not rows or any(len(row) != len(columns) for row in rows):
        raise InputError(f"{path} does not have the columns {', '.join(columns)} in every row")
    return {name: list(values) for name, values in zip(columns, zip(*rows, strict=True), strict=True)}


def _trials(
    table: Mapping[str, list[str]], times: Mapping[str, list[str]], hold_out: Sequence[str]
) -> Trials:
    number = _integers(table, "reading_number")
    readings = int(number.max())
    trials, left = divmod(len(number), max(readings, 1))
    if left or not np.array_equal(number, np.tile(np.arange(1, readings + 1), trials)):
        raise InputError("trials.csv: rows are missing")
    if any(times[name] != table[name] for name in ("truth", "trial", "reading_number")):
        raise InputError("times.csv does not have the rows of trials.csv")

    def floats(of: Mapping[str, list[str]], name: str) -> FloatArray:
        return _floats(of, name).reshape(trials, readings)

    truth = _labels(table, "truth")[::readings]
    return Trials(
        truth=truth,
        known=~(np.isin(truth, list(hold_out)) | (list(hold_out) == [EACH])),
        trial=_integers(table, "trial")[::readings],
        true_pose=np.stack([floats(table, name) for name in ("true_x", "true_y", "true_theta")], axis=-1),
        reading=_integers(table, "reading").reshape(trials, readings),
        label=_labels(table, "label").reshape(trials, readings),
        pose=np.stack([floats(table, name) for name in ("x", "y", "theta")], axis=-1),
        evaluations=_integers(table, "evaluations").reshape(trials, readings),
        **{name: floats(table, name) for name in ("p_truth", "p_label")},
        **{
            name: _floats(table, name, unknown=True).reshape(trials, readings)
            for name in ("credibility", "radius_90")
        },
        **{name: floats(times, name) for name in ("update_s", "estimate_s", "propose_s")},
    )


def _bounds(table: Mapping[str, list[str]], trials: Trials) -> FloatArray:
    of_trials = columns(trials)
    if any(table[name] != [str(value) for value in of_trials[name].tolist()] for name in BOUND_COLUMNS[:-1]):
        raise InputError("bounds.csv does not have the rows of trials.csv")
    bounds = _floats(table, "bound_mm").reshape(trials.label.shape)
    if (bounds <= 0).any():
        raise InputError("bounds.csv: a bound is not above 0")
    return bounds


def _integers(table: Mapping[str, list[str]], name: str) -> NDArray[np.int64]:
    try:
        return np.array(table[name], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"the column {name} holds what is no whole number of 64 bits") from error


def _floats(table: Mapping[str, list[str]], name: str, unknown: bool = False) -> FloatArray:
    """Read a column of finite numbers; with `unknown`, an entry may be "nan"."""
    try:
        values = np.array(table[name], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"the column {name} holds what is no number") from error
    finite(np.where(np.isnan(values), 0, values) if unknown else values, f"the column {name}")
    return values


def _labels(table: Mapping[str, list[str]], name: str) -> NDArray[np.str_]:
    for label in dict.fromkeys(table[name]):
        if not is_label(label):
            raise InputError(f"{name}: {short(label)} is empty, too long or not printable")
    return np.array(table[name])
