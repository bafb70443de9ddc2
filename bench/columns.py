"""The columns of trials, one row a trial and reading, from which CSV, NPZ, Parquet and HDF5 are written and read.

Which columns a run has says its kind; what each one holds, and in which unit, stands here alone.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.bench import kinds
from tactsim.bench.trials import Trials

Table = dict[str, NDArray[Any]]  # (rows,) each


class Column(NamedTuple):
    """What a column holds: "text", "count" or "number"; its unit, and what it is. unknown: a number may be NaN."""

    holds: str
    unit: str
    what: str
    unknown: bool = False


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
