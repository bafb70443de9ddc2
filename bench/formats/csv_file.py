"""A table of somebody else's presses, one a row, as a scan: CSV, as a spreadsheet or a lab's script writes it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from pydantic import Field

from tactsim.bench.trials import check_labels
from tactsim.core import InputError, Pad, Scan
from tactsim.core.checking import checked
from tactsim.core.documents import LARGE
from tactsim.core.errors import short
from tactsim.core.finite import LARGEST
from tactsim.hardware.scans import PlacedPress, named_rows
from tactsim.hardware.text_tables import check_taxel_names

TABLES = (".csv", ".tsv", ".txt", ".log", ".asc", ".lvm")
_TAXEL = re.compile(r"t\d+")


class PressRow(PlacedPress):
    """The columns of a row that are no taxels. load_N: the force of the press. press: its number, the same in each
    row that was read of one press.
    """

    load_N: float | None = Field(None, ge=0)
    press: int | None = None


_NO_TAXELS = {*PressRow.model_fields, "theta_deg"}


def read_press_table(path: Path, pad: Pad, unit: str) -> Scan:
    """Read a scan from a CSV with a row a press: columns as `PressRow` has them, theta_deg for theta_rad, and taxels.

    The taxels are the columns t0, t1 ...; if there is no t0, all other columns whose first cell is a number, in their
    order. Separators, decimal commas and capitals are read as `named_rows` does.

    Raises InputError, with the line, for a row that is not whole, other taxels than the pad's, and no row at all.
    """
    rows, readings = [], []
    taxels: list[str] = []
    for where, words in named_rows(path, "presses", PressRow, LARGE):
        row = checked(PressRow, {name: word for name, word in words.items() if name in _NO_TAXELS}, where)
        rows.append(row)
        if (row.press is None) != (rows[0].press is None):
            raise InputError(f"{where}: either all rows have a number in the column press, or none has")
        if not taxels:
            taxels = _taxel_columns(words, unit, where)
            if len(taxels) != pad.taxels:
                raise InputError(
                    f"{where}: {len(taxels)} columns of taxels, {', '.join(taxels[:3])} ..., and the pad has "
                    f"{pad.taxels}; call them t0 to t{pad.taxels - 1}"
                )
        readings.append([_number(words.get(name, "")) for name in taxels])
        if None in readings[-1]:
            name = taxels[readings[-1].index(None)]
            got = short(words.get(name, ""))
            raise InputError(f"{where}: {name}: give a finite number, got {got}; a dead taxel may say nan")
    check_labels({row.label for row in rows})
    loads = np.array([math.nan if row.load_N is None else row.load_N for row in rows])
    return Scan.from_arrays(
        np.array(readings),
        np.array([row.pose for row in rows]),
        [row.label for row in rows],
        [row.split for row in rows],
        pad,
        unit=unit,
        loads=None if np.isnan(loads).all() else loads,
        presses=None if rows[0].press is None else [row.press for row in rows],
    )


def _taxel_columns(words: dict[str, str], unit: str, where: str) -> list[str]:
    """Choose the columns of taxels, in the order of the taxels. Raises InputError where their names say otherwise."""
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
