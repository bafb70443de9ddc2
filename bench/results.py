"""The files of a run, written and read back as they were. `results/README.md` has the schema."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.score import Properties
from bench.trials import Trials
from models.files import write_text
from tactsim import InputError

SCHEMA = 1
# trials.csv: one row per trial and reading, the same on every machine for the same seed.
COLUMNS = (
    "truth", "trial", "reading_number", "reading", "label", "p_truth", "p_label", "x", "y", "theta",
    "true_x", "true_y", "true_theta", "evaluations",
)  # fmt: skip
# times.csv: one row per trial and reading, in the same order; differs from run to run.
TIME_COLUMNS = ("truth", "trial", "reading_number", "update_s", "estimate_s", "propose_s")


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run: what was asked, what came out.

    config: the resolved configuration. about: versions, machine, protocol, what the estimator says of
    itself, eq. 3's agreement. summary: the metrics. times: seconds of each stage and peak memory.
    """

    config: dict[str, Any]
    about: dict[str, Any]
    objects: dict[str, Properties]
    work: dict[str, Any]
    trials: Trials
    summary: dict[str, Any]
    times: dict[str, Any]


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Config(_Strict):
    """What every reader of a run asks of its configuration; the rest may be another version's."""

    estimator: str
    options: dict[str, Any]


class _Machine(_Strict):
    processor: str
    cores: int
    system: str


class _About(_Strict):
    """What every reader of a run asks of run.json."""

    config: _Config
    protocol: str
    description: str
    letters: list[str]
    classifier_agreement: float | None
    scan: dict[str, Any]
    versions: dict[str, str]
    machine: _Machine


def save(run: Run, folder: Path) -> None:
    """Write a run's files into `folder`; the same run gives the same bytes, times.* apart."""
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
    write_text(folder / "trials.csv", _table(COLUMNS, run.trials))
    write_text(folder / "times.csv", _table(TIME_COLUMNS, run.trials))
    write_text(folder / "summary.json", to_json(run.summary))
    write_text(folder / "times.json", to_json(run.times | {"work": run.work}))


def load(path: str | Path) -> Run:
    """Read a run's folder. Raises InputError if it is no run, is not whole or has another schema."""
    folder = Path(path)
    if not (folder / "run.json").is_file():
        raise InputError(f"{folder} is not the folder of a run: it has no run.json")
    about = read_json(folder / "run.json")
    if about.pop("schema", None) != SCHEMA:
        raise InputError(f"{folder / 'run.json'}: unknown schema; this version reads schema {SCHEMA}")
    times = read_json(folder / "times.json")
    try:
        _About.model_validate(about)
        objects = {label: _properties(of) for label, of in about.pop("objects").items()}
        config = about.pop("config")
        trials = _trials(
            _read_table(folder / "trials.csv", COLUMNS), _read_table(folder / "times.csv", TIME_COLUMNS)
        )
        work = times.pop("work")
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(map(str, fault["loc"]))
        raise InputError(f"{folder} is not a whole run: run.json: {place}: {fault['msg']}") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder} is not a whole run: {type(error).__name__}: {error}") from error
    if not set(trials.truth.tolist()) <= set(objects):
        raise InputError(f"{folder} is not a whole run: run.json: objects: a letter of trials.csv is missing")
    return Run(config, about, objects, work, trials, read_json(folder / "summary.json"), times)


def _properties(of: dict[str, Any]) -> Properties:
    x, y = of["centre"]
    properties = Properties(int(of["symmetry"]), (float(x), float(y)), float(of["inertia_over_mass"]))
    if not np.isfinite([*properties.centre, properties.inertia_over_mass]).all():
        raise ValueError("an object's properties are not finite")
    return properties


def to_json(value: Any) -> str:
    """Write JSON with sorted keys, a line an entry; refuses NaN and infinity."""
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False, default=str) + "\n"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file. Raises InputError if it cannot be read or holds no object."""
    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not whole JSON: {error}") from error
    if not isinstance(value, dict):
        raise InputError(f"{path} holds no JSON object")
    return value


def _table(columns: tuple[str, ...], trials: Trials) -> str:
    readings = trials.label.shape[1]
    number = np.arange(1, readings + 1)
    x, y, theta = np.moveaxis(trials.pose, 2, 0)
    wide: Mapping[str, Any] = {"reading_number": number, "x": x, "y": y, "theta": theta} | {
        name: np.asarray(values)[:, None]
        for name, values in {
            "truth": trials.truth, "trial": trials.trial,
            "true_x": trials.true_pose[:, 0], "true_y": trials.true_pose[:, 1],
            "true_theta": trials.true_pose[:, 2],
        }.items()
    }  # fmt: skip
    lists = [
        np.broadcast_to(wide[name] if name in wide else getattr(trials, name), trials.label.shape)
        .ravel()
        .tolist()
        for name in columns
    ]
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*lists, strict=True))
    return stream.getvalue()


def _read_table(path: Path, columns: tuple[str, ...]) -> dict[str, list[str]]:
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            header, *rows = csv.reader(stream)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path} is not a whole table: {error}") from error
    if tuple(header) != columns or not rows or any(len(row) != len(columns) for row in rows):
        raise InputError(f"{path} does not have the columns {', '.join(columns)} in every row")
    return {name: list(values) for name, values in zip(columns, zip(*rows, strict=True), strict=True)}


def _trials(table: Mapping[str, list[str]], times: Mapping[str, list[str]]) -> Trials:
    readings = max(int(number) for number in table["reading_number"])
    if [int(number) for number in table["reading_number"]] != [*range(1, readings + 1)] * (
        len(table["truth"]) // readings
    ) or len(times["truth"]) != len(table["truth"]):
        raise ValueError("rows are missing")

    def wide(values: list[str], kind: type) -> Any:
        array: np.ndarray = np.array(values, dtype=kind).reshape(-1, readings)
        if kind is float and not np.isfinite(array).all():
            raise ValueError("a number is not finite")
        return array

    def once(values: list[str], kind: type) -> Any:
        return wide(values, kind)[:, 0]

    return Trials(
        truth=once(table["truth"], str),
        trial=once(table["trial"], np.int64),
        true_pose=np.stack(
            [once(table[name], float) for name in ("true_x", "true_y", "true_theta")], axis=-1
        ),
        reading=wide(table["reading"], np.int64),
        label=wide(table["label"], str),
        pose=np.stack([wide(table[name], float) for name in ("x", "y", "theta")], axis=-1),
        evaluations=wide(table["evaluations"], np.int64),
        **{name: wide(table[name], float) for name in ("p_truth", "p_label")},
        **{name: wide(times[name], float) for name in ("update_s", "estimate_s", "propose_s")},
    )
