"""The columns of trials, one row a trial and reading, from which CSV, NPZ, Parquet and HDF5 are written and read.

Which columns a run has says its kind; what each one holds, and in which unit, stands here alone.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.bench import kinds
from tactsim.bench.config import EACH
from tactsim.bench.kinds import Kind
from tactsim.bench.trials import NOT_TAKEN, Trials, sure_enough
from tactsim.core import InputError
from tactsim.core.documents import read_text
from tactsim.core.errors import short
from tactsim.core.finite import finite
from tactsim.core.poses import POSE, FloatArray
from tactsim.core.scan import is_label

Table = dict[str, NDArray[Any]]  # (rows,) each
_LARGEST_TABLE = 1 << 30  # bytes


class Column(NamedTuple):
    """What a column holds: "text", "count" or "number"; its unit, and what it is. unknown: a number may be NaN."""

    holds: str
    unit: str
    what: str
    unknown: bool = False


LATER = ("nees", "touch_index")  # columns that runs of earlier versions may lack
_RENAMED = {"reading": "touch_index"}  # as runs of version 0.1 call them
_FRAMES = {
    "": "of the estimated robot_in_object",
    "true_": "of the true robot_in_object",
    "start_": "where the first touch starts",
}
_AXES = {"x": "mm", "y": "mm", "z": "mm", "theta": "rad", "qw": "", "qx": "", "qy": "", "qz": ""}
COLUMNS = {
    "truth": Column("text", "", "the true object"),
    "trial": Column("count", "", "which trial of its object it is, from 0"),
    "touch_index": Column(
        "count",
        "",
        "which of the object's test readings, or of the touches on offer, was taken, from 0; -1: not kept; "
        "-2: the trial had ended",
    ),
    "label": Column("text", "", "the estimated object"),
    "p_truth": Column("number", "", "the probability that the estimator gives the right label"),
    "p_label": Column("number", "", "the probability that it gives the label it names"),
    **{
        f"{before}{axis}": Column("number", unit, f"{axis} {of}")
        for before, of in _FRAMES.items()
        for axis, unit in _AXES.items()
    },
    "credibility": Column("number", "", "the smallest region of belief that holds the truth", unknown=True),
    "radius_90": Column("number", "mm", "radius of the circle of the 90 % region's area", unknown=True),
    "nees": Column("number", "", "squared error of the belief's mean over its covariance", unknown=True),
    "met": Column("count", "", "how many touches have met the object"),
    "evaluations": Column("count", "", "states at which the measurement model was asked"),
    "update_s": Column("number", "s", "processor time of the update"),
    "estimate_s": Column("number", "s", "processor time of the estimate"),
    "propose_s": Column("number", "s", "processor time of the choice of the touch"),
    "bound_mm": Column("number", "mm", "the Cramer-Rao bound of the error"),
}


def column(name: str) -> Column:
    """Say what a column holds: a number, if a kind of run of a package brings one of its own."""
    if name.endswith("_number"):
        return Column("count", "", f"which {name.removesuffix('_number')} of its trial it is, from 1")
    return COLUMNS.get(name, Column("number", "", name))


def columns(trials: Trials) -> Table:
    """Give the columns of trials, the times last."""
    readings = np.arange(1, trials.label.shape[1] + 1)
    kind = kinds.load(trials.kind)
    values = {"truth": trials.truth[:, None], "trial": trials.trial[:, None], kind.number: readings}
    for before, of in kind.poses.items():
        array = getattr(trials, of)
        values |= {f"{before}{name}": array[..., place] for place, name in enumerate(kind.pose)}
    names = dict.fromkeys((*kind.columns, *kind.time_columns))
    values |= {name: getattr(trials, name) for name in names if name not in values}
    return {name: np.broadcast_to(values[name], trials.label.shape).ravel() for name in names}


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


def same_rows(name: str, table: Table, other: Table) -> None:
    """Raise InputError unless two tables, the first of which is called `name`, are of the same trials and readings."""
    shared = [one for one in table if one in ("truth", "trial") or one.endswith("_number")]
    if any(not np.array_equal(table[one], other.get(one, [])) for one in shared):
        raise InputError(f"{name} does not have the rows of trials.csv")


def bounds_of(table: Mapping[str, NDArray[Any]], trials: Trials) -> FloatArray:
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


# ---- as CSV


def write_csv(names: Sequence[str], table: Mapping[str, NDArray[Any]]) -> str:
    """Write columns as CSV, each value so that it is read back to the bit."""
    return csv_text(names, zip(*(table[name].tolist() for name in names), strict=True))


def csv_text(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Write rows below their heads as CSV; None is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([cell for _, cell in zip(heads, row, strict=True)] for row in rows)
    return stream.getvalue()


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


# ---- as NPZ, in a form that packs well


def write_columns(table: Mapping[str, NDArray[Any]], stream: IO[bytes]) -> None:
    """Write columns as .npz, not compressed: numbers in 32 bits, counts in as few bytes as hold them.

    The same columns give the same bytes.
    """
    with zipfile.ZipFile(stream, "w") as archive:
        for name, values in table.items():
            content = io.BytesIO()
            np.save(content, _narrow(values), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getbuffer())


def _narrow(values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind == "f":
        return values.astype(np.float32)
    if values.dtype.kind == "i":
        ends = np.min_scalar_type(values.min()), np.min_scalar_type(values.max())
        return values.astype(np.promote_types(*ends))
    return values


def read_columns(path: Path, kind: Kind) -> Table:
    """Read the columns of a run of this kind that `write_columns` wrote, with those of its bounds if it has them.

    Nothing is unpickled. Raises InputError if the file is not whole or lacks a column.
    """
    from tactsim.core.npz import read_npz

    names = dict.fromkeys((*kind.columns, *kind.time_columns))
    table = read_npz(path, [name for name in names if name not in LATER], ["bound_mm", *LATER, *_RENAMED])
    return {_RENAMED.get(name, name): values for name, values in table.items()}
