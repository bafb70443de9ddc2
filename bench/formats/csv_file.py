"""A table of somebody else's presses, one a row, as a scan: CSV, as a spreadsheet or a lab's script writes it."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import IO, Literal

import numpy as np
from pydantic import Field

from tactsim.bench.trials import check_labels
from tactsim.core import InputError, Pad, Scan
from tactsim.core.checking import checked
from tactsim.core.documents import LARGE
from tactsim.core.errors import short
from tactsim.core.finite import LARGEST
from tactsim.core.making import without_poses
from tactsim.core.provenance import NO_POSES, poses_unknown
from tactsim.hardware.scans import POSE_COLUMNS, PlacedPress, has_pose, named_rows
from tactsim.hardware.text_tables import check_taxel_names

TABLES = (".csv", ".tsv", ".txt", ".log", ".asc", ".lvm")
_TAXEL = re.compile(r"t\d+")


class PressRow(PlacedPress):
    """The columns of a row that are no taxels. load_N: the force of the press. press: its number, the same in each
    row that was read of one press. poses: that nobody noted them, and the row's says only how rows of a press lie.
    """

    load_N: float | None = Field(None, ge=0)
    press: int | None = None
    poses: Literal["unknown"] | None = None


_NO_TAXELS = {*PressRow.model_fields, *POSE_COLUMNS}


def write_press_table(scan: Scan, stream: IO[bytes]) -> None:
    """Write the table that `read_press_table` reads: label, split, pose, press and load of each reading, and taxels.

    Poses that nobody noted are left out where all are 0, else the column `poses` says so.
    """
    text = io.TextIOWrapper(stream, "utf-8", newline="")
    table = csv.writer(text)
    unknown = poses_unknown(scan.meta)
    columns = {"label": scan.labels.tolist(), "split": scan.split.tolist()}
    if not unknown or scan.poses.any():
        columns |= dict(zip(("x_mm", "y_mm", "theta_rad"), scan.poses.T.tolist(), strict=True))
        columns |= {"poses": [NO_POSES["poses"]] * len(scan)} if unknown else {}
    columns["press"] = scan.press_numbers.tolist()
    if scan.loads is not None:
        columns["load_N"] = ["" if math.isnan(load) else load for load in scan.loads.tolist()]
    table.writerow([*columns, *(f"t{taxel}" for taxel in range(scan.readings.shape[1]))])
    for *row, values in zip(*columns.values(), scan.readings.tolist(), strict=True):
        table.writerow(row + values)
    text.detach()


# Names that poses have in other tables, and words before the numbers that stand below one.
_MAY_BE_A_POSE = re.compile(
    r"([xyz]|q[wxyz]|theta|phi|yaw|angle|heading|rot\w*|pos\w*|orient\w*)([\W_]*([cm]?m|deg|rad|turns))?\W*$",
    re.IGNORECASE,
)
_STATISTICS = {
    *("mean", "average", "avg", "median", "std", "stdev", "sd", "min", "max", "sum", "total", "count"),
    *("mittel", "mittelwert", "summe", "gesamt", "moyenne", "somme", "media", "suma", "somma", "gemiddelde"),
}


def columns_of(text: str) -> dict[str, str]:
    """Read what columns are called, as in `x_mm=position,label=:cable,taxels=pil*_fz`. Raises InputError.

    `:` stands before a value that all rows have; `taxels` is a pattern of their columns.
    """
    called: dict[str, str] = {}
    for part in text.split(","):
        name, _, theirs = part.strip().partition("=")
        if name not in (*_NO_TAXELS, "taxels") or not theirs.strip(": "):
            raise InputError(
                f"--columns {part.strip()!r}: give NAME=COLUMN, or NAME=:VALUE for all rows; names are "
                f"{', '.join(sorted(_NO_TAXELS))} and taxels, whose COLUMN is a pattern such as *_fz"
            )
        if name in called or theirs in called.values():
            twice = name if name in called else theirs
            raise InputError(f"--columns {part.strip()!r}: {twice} is named twice")
        called[name] = theirs.strip()
    return called


def read_press_table(
    path: Path, pad: Pad, unit: str, columns: Mapping[str, str] | None = None, *, noted: bool = True
) -> Scan:
    """Read a scan from a CSV with a row a press: columns as `PressRow` has them, theta_deg for theta_rad, and taxels.

    The taxels are the columns t0, t1 ...; if there is no t0, all other columns whose first cell is a number, in their
    order. Separators, decimal commas and capitals are read as `named_rows` does. columns: as `columns_of` reads them.
    Without a column of the pose nobody knows it. noted: False if nobody noted poses, whatever columns there are, as if
    the column `poses` said so: then they are read only of rows that share a press, as how these lie to each other.

    Raises InputError, with the line, for a row that is not whole, other taxels than the pad's, and no row at all.
    """
    rows, readings = list[PressRow](), list[list[float | None]]()
    said = list[tuple[str, dict[str, str]]]()  # where each row is, and its words but those of taxels
    taxels: list[str] = []
    columns = dict(columns or {})
    pattern = columns.pop("taxels", None)
    same = {name: theirs[1:] for name, theirs in columns.items() if theirs[0] == ":"}
    called = {name: theirs for name, theirs in columns.items() if name not in same}
    posed, like = True, list[str]()
    for where, words in named_rows(path, "presses", PressRow, LARGE, called, unit):
        words |= same
        if not rows:
            noted = noted and words.get("poses") != NO_POSES["poses"]
            posed = has_pose(words)
            like = [] if posed and noted else [name for name in words if _MAY_BE_A_POSE.match(name)]
            if like and noted and not called:
                raise InputError(
                    f"{where}: {', '.join(like)} may be poses; call them x_mm, y_mm and theta_rad or theta_deg, or "
                    "name the columns (--columns), or say that nobody noted them (--poses none)"
                )
        told = {name: word for name, word in words.items() if name in _NO_TAXELS}
        said.append((where, told))
        row = checked(PressRow, told if posed and noted else _unplaced(told), where)
        if row.label.lower().rstrip(":.") in _STATISTICS and row.label not in {other.label for other in rows}:
            raise InputError(
                f"{where}: {row.label!r} begins no press but what is told of all: leave the line out"
            )
        rows.append(row)
        if (row.press is None) != (rows[0].press is None):
            raise InputError(f"{where}: either all rows have a number in the column press, or none has")
        if row.poses != rows[0].poses:
            raise InputError(f"{where}: either all rows say unknown in the column poses, or none does")
        if not taxels:
            may_be = words if noted else {name: word for name, word in words.items() if name not in like}
            taxels = _taxel_columns(may_be, unit, where, pattern)
            if len(taxels) != pad.taxels:
                raise InputError(
                    f"{where}: {len(taxels)} columns of taxels, {', '.join(taxels[:3])} ..., and the pad has "
                    f"{pad.taxels}; call them t0 to t{pad.taxels - 1}, or say which they are (--columns taxels=PATTERN)"
                )
        readings.append([_number(words.get(name, "")) for name in taxels])
        if None in readings[-1]:
            name = taxels[readings[-1].index(None)]
            got = short(words.get(name, ""))
            raise InputError(f"{where}: {name}: give a number up to 1e9, got {got}; a dead taxel may say nan")
    check_labels({row.label for row in rows})
    if posed and not noted:
        times = Counter(row.press for row in rows)
        shared = [at for at, row in enumerate(rows) if row.press is not None and times[row.press] > 1]
        for at in shared:
            rows[at] = checked(PressRow, said[at][1], said[at][0])
        posed = bool(shared)
    loads = np.array([math.nan if row.load_N is None else row.load_N for row in rows])
    poses, labels, split, presses = zip(
        *((row.pose, row.label, row.split, row.press) for row in rows), strict=True
    )
    scan = Scan.from_arrays(
        np.array(readings), np.array(poses) if posed else None, labels, split, pad, unit=unit,
        loads=None if np.isnan(loads).all() else loads, presses=None if presses[0] is None else presses,
    )  # fmt: skip
    return scan if noted or not posed else without_poses(scan)


def _unplaced(words: Mapping[str, str]) -> dict[str, str]:
    """Give the words of a row with a pose of 0 for what it says of one."""
    others = {name: word for name, word in words.items() if name not in POSE_COLUMNS}
    return others | {"x_mm": "0", "y_mm": "0", "theta_rad": "0"}


def _taxel_columns(words: dict[str, str], unit: str, where: str, pattern: str | None) -> list[str]:
    """Choose the columns of taxels, in the order of the taxels. Raises InputError where their names say otherwise."""
    if pattern is not None:
        return [name for name in words if name not in _NO_TAXELS and fnmatchcase(name, pattern)]
    if "t0" in words:
        return sorted(filter(_TAXEL.fullmatch, words), key=lambda name: int(name[1:]))
    names = [name for name in words if name not in _NO_TAXELS and _number(words[name]) is not None]
    try:
        check_taxel_names(names, unit)
    except InputError as error:
        raise InputError(f"{where}: {error}; or call the taxels t0, t1 ...") from None
    return names


def _number(word: str) -> float | None:
    """Read a taxel's cell, which may say NaN; None if it is no number that a reading may be."""
    try:
        number = float(word)
    except ValueError:
        return None
    return None if abs(number) > LARGEST else number
