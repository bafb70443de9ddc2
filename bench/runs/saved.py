"""Read the folder of a finished run, and what a bundle keeps of it: `results/README.md` has the schema."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from tactsim.bench import kinds
from tactsim.bench.columns import Table, column
from tactsim.bench.config import EACH
from tactsim.bench.kinds import Kind
from tactsim.bench.results import BOUND_COLUMNS, PACKED, SHAPES, Run
from tactsim.bench.trials import NOT_TAKEN, Trials, sure_enough
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import read_json, read_text
from tactsim.core.errors import short
from tactsim.core.finite import finite
from tactsim.core.npz import read_npz
from tactsim.core.poses import POSE, FloatArray
from tactsim.core.scan import is_label

LATER = ("nees", "touch_index")  # columns that runs of earlier versions may lack
_RENAMED = {"reading": "touch_index"}  # as runs of version 0.1 call them
_LARGEST_TABLE = 1 << 30  # bytes


class _Times(BaseModel):
    """The fields of times.json that every reader needs."""

    model_config = ConfigDict(strict=True)

    seconds: dict[str, float]
    work: dict[str, Any]
    peak_memory_mb: float


def load(path: str | Path) -> Run:
    """Read a run's folder. Raises InputError if it is not a run, is not whole or has another schema."""
    folder = Path(path)
    if not (folder / "run.json").is_file():
        why = "it has no run.json" if folder.is_dir() else "there is no such folder"
        if (folder / "sweep.json").is_file():
            why = f"it is a sweep's, and `bench runs {folder}` lists its runs"
        raise InputError(f"{folder} is not the folder of a run: {why}")
    about = read_json(folder / "run.json", "file of a run")
    kind = kinds.of_task(about.get("task"))
    if about.pop("schema", None) != kind.schema:
        raise InputError(f"{folder / 'run.json'}: unknown schema; this version reads schema {kind.schema}")
    try:
        config = checked(kind.about, about, "run.json").config  # type: ignore[attr-defined]
        if (folder / PACKED).is_file():  # as a bundle keeps it
            table = read_columns(folder / PACKED, kind)
        else:
            table = read_csv(folder / "trials.csv", kind.columns)
            for name, names in (("times.csv", kind.time_columns), ("bounds.csv", BOUND_COLUMNS)):
                if name == "times.csv" or (folder / name).is_file():
                    beside = read_csv(folder / name, names)
                    _same_rows(name, beside, table)
                    table |= beside
        trials = trials_of(table, config.hold_out, kind, about["config"].get("stop_at"))
        bounds = _bounds_of(table, trials) if "bound_mm" in table else None
        times = read_json(folder / "times.json", "file of a run")
        checked(_Times, times, "times.json")
        about.pop("task", None)
        objects = kind.objects_of(about, folder)
        if not set(trials.truth.tolist()) <= set(objects):
            raise InputError("run.json: objects: a letter of trials.csv is missing")
    except InputError as error:
        raise InputError(f"{folder} is not a whole run: {error}") from error
    kept = tuple(folder / SHAPES / Path(name).name for name in config.shapes)
    kept = kept if all(file.is_file() for file in kept) else ()
    work = times.pop("work")
    return Run(about.pop("config"), about, objects, work, trials, times, bounds=bounds, shape_files=kept)


def trials_of(
    table: Mapping[str, NDArray[Any]], hold_out: Sequence[str], kind: Kind, stop_at: float | None
) -> Trials:
    """Put trials together from their columns. Raises InputError if rows are missing, or a value cannot be one.

    stop_at: where trials ended (`TrialRules`), for runs of version 0.1 in space, which do not say which touches were
    taken.
    """
    if "touch_index" not in table and not kind.own_touches:
        raise InputError("the column touch_index is missing")
    number = table[kind.number]
    table = {"nees": np.full(len(number), np.nan)} | dict(table)
    present = [name for name in (*kind.columns, *kind.time_columns) if name in table or name not in LATER]
    for name in present:
        _check(name, table[name])
    readings = int(number.max(initial=0))
    trials, left = divmod(len(number), max(readings, 1))
    if left or any(len(table[name]) != len(number) for name in present):
        raise InputError("rows are missing")
    if not np.array_equal(number, np.tile(np.arange(1, readings + 1), trials)):
        raise InputError("rows are missing")
    shape = trials, readings

    def poses(before: str) -> FloatArray:
        found = np.stack([table[f"{before}{name}"].astype(float) for name in kind.pose], axis=-1)
        found = found.reshape(*shape, -1)
        if kind.pose == POSE:
            return found
        from tactsim.core.rigid import checked_poses

        return checked_poses(found, f"{before}pose")

    begins = {name: before for before, name in kind.poses.items()}
    truth = table["truth"][::readings]
    found: dict[str, Any] = {
        "truth": truth,
        "known": ~(np.isin(truth, list(hold_out)) | (list(hold_out) == [EACH])),
        "trial": table["trial"].astype(np.int64)[::readings],
    }
    for name in (one.name for one in fields(kind.trials) if one.name not in found):
        if name in begins:
            found[name] = poses(begins[name])
        elif name == "touch_index" and name not in table and kind.own_touches:
            found[name] = (number - 1).reshape(shape)
            if stop_at is not None:
                sure = sure_enough(table["p_label"].reshape(shape)[:, :-1], stop_at)
                found[name][:, 1:][np.logical_or.accumulate(sure, axis=1)] = NOT_TAKEN
        else:
            of = {"text": np.str_, "count": np.int64, "number": np.float64}[column(name).holds]
            found[name] = table[name].astype(of).reshape(shape)
    return kind.trials(**found)


def _same_rows(name: str, table: Table, other: Table) -> None:
    """Raise InputError unless two tables, the first of which is called `name`, are of the same trials and readings."""
    shared = [one for one in table if one in ("truth", "trial") or one.endswith("_number")]
    if any(not np.array_equal(table[one], other.get(one, [])) for one in shared):
        raise InputError(f"{name} does not have the rows of trials.csv")


def _bounds_of(table: Mapping[str, NDArray[Any]], trials: Trials) -> FloatArray:
    """Give the bounds (n, r) mm of trials from their column. Raises InputError unless all are above 0."""
    _check("bound_mm", table["bound_mm"])
    if len(table["bound_mm"]) != trials.label.size or (table["bound_mm"] <= 0).any():
        raise InputError("bound_mm: a bound is missing, or not above 0")
    return table["bound_mm"].astype(float).reshape(trials.label.shape)


def _check(name: str, values: NDArray[Any]) -> None:
    """Raise InputError for what a column cannot hold, as a file may say it."""
    of = column(name)
    if values.ndim != 1 or values.dtype.kind not in {"text": "U", "count": "iu", "number": "f"}[of.holds]:
        raise InputError(f"the column {name} holds {values.dtype} of shape {values.shape}")
    if of.holds == "text":
        for label in np.unique(values).tolist():
            if not is_label(label):
                raise InputError(f"{name}: {short(label)} is empty, too long or not printable")
    elif of.holds == "number":
        finite(np.where(np.isnan(values), 0, values) if of.unknown else values, f"the column {name}")


def read_csv(path: Path, names: Sequence[str]) -> Table:
    """Read the columns of a CSV table. Raises InputError if it is not whole or has other columns."""
    try:
        lines = list(csv.reader(io.StringIO(read_text(path, "table of a run", _LARGEST_TABLE), newline="")))
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path} is not a whole table: {error}") from error
    header, rows = [[_RENAMED.get(name, name) for name in line] for line in lines[:1]], lines[1:]
    if header and set(names) - set(header[0]) <= set(LATER):
        names = [name for name in names if name in header[0]]
    if header != [list(names)] or not rows or any(len(row) != len(names) for row in rows):
        raise InputError(f"{path} does not have the columns {', '.join(names)} in every row")
    return {name: _parsed(name, values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}


def _parsed(name: str, values: Sequence[str]) -> NDArray[Any]:
    holds = column(name).holds
    try:
        return np.array(values, dtype={"text": np.str_, "count": np.int64, "number": np.float64}[holds])
    except (ValueError, OverflowError) as error:
        what = "whole number of 64 bits" if holds == "count" else "number"
        raise InputError(f"the column {name} holds what is no {what}") from error


def read_columns(path: Path, kind: Kind) -> Table:
    """Read the columns of a run of this kind as a bundle keeps them, with those of its bounds if it has them.

    Nothing is unpickled. Raises InputError if the file is not whole or lacks a column.
    """
    names = dict.fromkeys((*kind.columns, *kind.time_columns))
    table = read_npz(path, [name for name in names if name not in LATER], ["bound_mm", *LATER, *_RENAMED])
    return {_RENAMED.get(name, name): values for name, values in table.items()}


def sweep_order(path: Path) -> dict[str, int]:
    """Give the names of a sweep's runs, each with its place in the sweep. Raises InputError if it lists none."""
    content = read_json(path / "sweep.json", "sweep's list of runs")
    try:
        return {str(run["name"]): number for number, run in enumerate(content["runs"])}
    except (KeyError, TypeError) as error:
        raise InputError(f"{path / 'sweep.json'} lists no runs: {type(error).__name__}: {error}") from error
