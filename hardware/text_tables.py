"""Tables of text as instruments, scripts and spreadsheets write them: presses, marks, recordings, idle readings.

Between two cells stand semicolons, tabs, bars, commas or blanks: the first of these that is in the line of names.
Beside other marks than commas numbers may have decimal commas.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, dropwhile

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError, short
from tactsim.core.poses import FloatArray

TITLE_WITHIN = 40  # lines, at whose end the names have stood
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)
_OF_A_NUMBER = re.compile(  # with commas
    r"[-+]?(\d*,\d+(e[-+]?\d+)?|\d{1,3}(,\d{3})+(\.\d*)?|\d{1,3}(\.\d{3})+,\d*)", re.IGNORECASE
)
_BETWEEN_THOUSANDS = ("\u00a0", "\u202f", "\u2009", " ", "'", "\u2019", "\ufffd", ",", ".")  # or what was one
_DECIMAL_POINT = re.compile(r"[-+]?[\d,]*\.[\d.,]*(e[-+]?\d+)?", re.IGNORECASE)
_BY_CHANCE = 20  # numbers; of so many with up to three decimals one in ten ends earlier
_NO_NUMBERS = re.compile(r"\W*([A-Za-z_]|$)|\s*#")  # of a line above them
_UNIT_BEHIND = re.compile(r"[\[(] *([kMh]?Pa|psi|m?bar|mmHg|m?N|m?V|N/[cm]?m(?:²|\^?2)) *[\])]$")
# What stands before a frame and is none of it: a time of day, perhaps behind a date; and `t3` or `frame_3`, for 3.
_TIME_AHEAD = re.compile(
    r"^[\s\"']*(\d{1,4}[-./]\d\d?[-./]\d{1,4}[T ])?\d\d?:\d\d:\d\d([.:]\d+|,\d+(?=[;\s]))?Z?[\"']*(?=[;,\s])"
)
_FORTRAN = re.compile(r"(?<![\w.])(\d*\.\d*)[dD]([-+]?\d+)(?![\w.])")
_MISSING = re.compile(
    r"#?n/?a|null|none|-+|\?+|\*+|err(or)?|ol|b|#[\w/]+[!?]", re.IGNORECASE
)  # b: as Tekscan says it
_HEXADECIMAL = re.compile(r"(0x)?[\da-f]{2,8}", re.IGNORECASE)
# What programs show of arrays, and not all of it: NumPy's dots, MATLAB's blocks of columns and common factor.
_SHOWN = re.compile(r"^[\s\[]*(\.\.\.|Columns? \d+.*|1\.0e[-+]\d+ *\*)\s*$|\s\.\.\.\s", re.MULTILINE)
_NUMBERED = re.compile(r"[A-Za-z_]+(\d+)")
_LIST = re.compile(r"\[[^\[\]]*\]")
# Names of columns where a row is a taxel's.
_OF_A_TAXEL = {"row", "col", "column", "taxel", "sensor", "channel", "value"}


def separator_of(names: str) -> str:
    """Tell what parts the cells of a table by its line of names."""
    return next((mark for mark in ";\t|," if mark in names), " ")


def cells_of(lines: Iterable[str], separator: str, path: object = "it") -> Iterator[tuple[int, list[str]]]:
    """Split lines into cells, without quotes and blanks around them; each row with the number of its line, from 1.

    Raises InputError that names `path`.
    """
    whole = (_plain(line).rstrip(f"\r\n {separator}") for line in lines)
    reader = csv.reader(whole, delimiter=separator, skipinitialspace=True)
    try:
        for row in reader:
            yield reader.line_num, [cell.strip() for cell in row]
    except csv.Error as error:
        raise InputError(f"{path} is no table (CSV): {error}") from error


def _plain(line: str) -> str:
    """Write printed minuses, and exponents of Fortran's 1.5D+03, as Python does."""
    line = line.replace("\u2212", "-")
    return _FORTRAN.sub(r"\1E\2", line) if "D" in line or "d" in line else line


def number_of(cell: str) -> float:
    """Read a number; NaN for a word that stands where none is, as n/a or -. Raises ValueError for another."""
    try:
        return float(cell)
    except ValueError:
        if _MISSING.fullmatch(cell):
            return math.nan
        raise


def title_cells(line: str) -> list[str]:
    """Split a line of names, which may be a comment."""
    return next((cells for _, cells in cells_of([line.lstrip("#% ")], separator_of(line))), [])


def has_decimal_commas(cells: Iterable[str], separator: str) -> bool:
    """Tell whether numbers of a table have decimal commas: between commas in quotes, and then none has a point."""
    cells = list(cells)
    found = any("," in cell and _DECIMAL_COMMA.fullmatch(cell) for cell in cells)
    return found and (
        separator != "," or not any("." in cell and _DECIMAL_POINT.fullmatch(cell) for cell in cells)
    )


def with_points(cells: Sequence[str], separator: str, commas: bool) -> Sequence[str]:
    """Write the decimal commas of a row as points. commas: whether other rows of the table have some.

    A point beside them may be one of thousands: such a cell is no number.
    """
    if not (commas or (separator != "," and has_decimal_commas(cells, separator))):
        return cells
    return [
        f"{cell} among decimal commas" if "." in cell and _DECIMAL_POINT.fullmatch(cell)
        else cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell
        for cell in cells
    ]  # fmt: skip


def thousands_mark(cells: Iterable[str], commas: bool = False, unit: str = "") -> str | None:
    """Find the mark between the thousands of numbers, as in 5,166 or 1 234 567,5; None if they have none.

    cells: of all taxels. commas: whether other numbers of the table have decimal commas. unit: of the numbers.
    A comma or point is one if all that have it have three digits behind it, and decimals behind the other, or some
    number is whole without it. Raises InputError if that may be chance, since few have it, or counts may be thousands.
    """
    cells = list(cells)
    for mark in _BETWEEN_THOUSANDS:
        marked = [cell for cell in cells if mark in cell]
        decimal = {",": r"\.", ".": ","}.get(mark, "[.,]")
        form = re.compile(rf"[-+]?[1-9]\d{{0,2}}({re.escape(mark)}\d{{3}})+({decimal}\d*)?")
        found = [form.fullmatch(cell) for cell in marked]
        if not marked or not all(found):
            continue
        others = [cell for cell in cells if cell and mark not in cell]
        if mark not in ",." or any(one and (one[0].count(mark) > 1 or one[2]) for one in found):
            return mark
        counts = unit == "count" and max(abs(int(cell.replace(mark, ""))) for cell in marked) < 2**16
        if not (others or counts) or not all(re.fullmatch(r"[-+]?\d{1,3}", cell) for cell in others):
            continue
        if len(marked) < _BY_CHANCE and commas:
            return None  # what stands there is refused where it stands
        if len(marked) < _BY_CHANCE or not others:
            raise InputError(
                f"{marked[0]} may be {marked[0].replace(mark, '')} or {marked[0].replace(mark, '.')}, and no number "
                "tells which: write them without marks between thousands"
            )
        return mark
    return None


def unit_since_1970(times: ArrayLike) -> float | None:
    """Tell the s of a unit in which times (n,) count from 1970, by their size; None for any other clock.

    They are of the years from 2001 to 2096. A clock that counts us reads as much as s do, but in steps of a thousand.
    """
    known = np.asarray(times, dtype=float)
    if len(known) < 2:
        return None
    for seconds in (1.0, 1e-3, 1e-6, 1e-9):
        if seconds * known.min() >= 1e9 and seconds * known.max() < 4e9:
            return seconds if seconds < 1 or np.median(np.abs(np.diff(known))) < 1000 else None
    return None


def check_taxel_names(names: Sequence[str], unit: str) -> None:
    """Raise InputError if the names of columns tell that these are not the taxels in their order, along the rows.

    `t0 t1 t2`, `r0c0 r0c1 r1c0`, `x0y0 x1y0 x0y1` and `A B C` rise; of `A1 A2 B1 B2` nobody knows whether letters are
    rows. Beside names with numbers one without is no taxel's. A unit behind all of them, as in `S1 [N]`, is `unit`, or
    that is count.
    """
    stated = {found and found[1] for found in map(_UNIT_BEHIND.search, names)}
    if unit != "count" and len(stated) == 1 and not stated & {None, unit}:
        raise InputError(f"columns {names[0]} ... are not in {unit}; count keeps numbers as they are")
    letters = [name[0].upper() for name in names if re.fullmatch(r"[A-Za-z]\d*", name)]
    alphabet = [chr(65 + at) for at in range(len({*letters}))]
    if len(letters) == len(names) and len(alphabet) > 1 and sorted({*letters}) == alphabet:
        said = f"columns {', '.join(names[:4])} ..."
        if len(names) == len(alphabet) ** 2:
            raise InputError(f"{said}: letters may be rows or columns; call the taxels r1c1, r1c2 ...")
        if len(names) == len(alphabet) and letters != alphabet:
            raise InputError(f"{said} are in no order of taxels, which go along the rows")
    names = [f"{name}.0" if f"{name}.1" in names else name for name in names]  # as pandas counts equal names
    numbers = [[int(number) for number in re.findall(r"\d+", name)] for name in names]
    kinds = [re.sub(r"\d+", "#", name) for name in names]
    if len(_OF_A_TAXEL.intersection(map(str.lower, names))) > 1:
        raise InputError(
            f"columns {', '.join(names)}: it has a taxel a row; make it a table with a column a taxel"
        )
    if max(map(kinds.count, filter(None, kinds)), default=0) < 2:
        return
    odd = [name for name, number in zip(names, numbers, strict=True) if not number]
    if odd and any(kinds.count(kind) > 1 for kind in kinds if "#" in kind):
        raise InputError(
            f"column {odd[0]!r} has no number as others have: leave it out if it is no taxel, or number the taxels"
        )
    rows_last = re.match(r"(x|c|col|column)[\W_]*#.*#", kinds[0], re.IGNORECASE)
    order = [number[::-1] for number in numbers] if rows_last else numbers
    if len({*kinds}) == 1 and order != sorted(order):
        raise InputError(
            f"columns {', '.join(names[:4])} ... are in no order of taxels, which go along the rows"
        )


def numbers_of(text: str) -> FloatArray:
    """Read a table of numbers (rows, columns), perhaps below lines of words. Raises ValueError if it is none."""
    lines = list(dropwhile(_NO_NUMBERS.match, text.splitlines()))
    if not lines:
        raise ValueError("it holds no row of numbers")
    rows = [cells for _, cells in cells_of(lines, separator_of(lines[0]))]
    commas = has_decimal_commas(chain(*rows), separator_of(lines[0]))
    return np.loadtxt([" ".join(with_points(cells, separator_of(lines[0]), commas)) for cells in rows])


def frames_of_text(text: str, taxels: int, ahead: int = 1) -> FloatArray:
    """Read frames (n, taxels) of a text: a line each, perhaps behind a clock, several lines each, or a line a taxel.

    ahead: so many numbers, 0 or 1, may stand before a frame in its line, a clock. Lines that hold anything but numbers
    say nothing; commas are decimal or stand between thousands where something else parts numbers. Where a line has as
    many numbers as a part of the taxels, so many lines that follow each other are a frame, and what stands between them
    is none. Raises InputError.
    """
    if shown := _SHOWN.search(text):
        raise InputError(
            f"{shown[0].strip()!r} stands in it: it is what a program shows of an array; let it write all numbers"
        )
    text = _LIST.sub(lambda found: found[0].replace("\n", " "), text)  # NumPy parts a long one
    cells = [_cells(line) for line in text.splitlines()]
    behind = [cell for row in cells for cell in row[1:]]  # before them a clock may stand
    thousands = thousands_mark(behind) or ""
    commas = has_decimal_commas((cell.replace(thousands, "") for cell in chain(*cells)), ";")
    numbers = [_numbers(row, thousands, commas) for row in cells]
    widths = Counter(len(one) for one in numbers if one is not None)
    fitting = [width for width in widths if width in (taxels, taxels + ahead) or taxels % max(width, 1) == 0]
    width = max(fitting, key=lambda one: (one * widths[one], one), default=0)
    rows = [one for one in numbers if one is not None]
    for row, one in zip(cells, numbers, strict=True):
        if one is None and 1 < len(row) == width and all(map(_HEXADECIMAL.fullmatch, row)):
            raise InputError(f"its numbers are hexadecimal, as in {short(' '.join(row))}; write decimal ones")
    if len(widths) == 1 and len(rows) == taxels and width in (0, taxels + 1, *range(1, taxels)):
        table = np.array(rows)
        if (np.diff(table[:, 0]) == 1).all():  # the number of its taxel begins each line
            if taxels < len(rows[0]) <= taxels + 2:
                raise InputError(
                    f"its {taxels} lines of {len(rows[0])} numbers may be frames or taxels; leave the first out"
                )
            return table[:, 1:].T
    if width < 2:
        counts = ", ".join(map(str, sorted(widths))) or "no"
        such = (
            "" if widths else f" such as {short(next(filter(None, map(str.strip, text.splitlines())), ''))}"
        )
        raise InputError(f"its lines{such} have {counts} numbers, no frames of {taxels} taxels")
    if width >= taxels:
        whole = np.array([one for one in rows if len(one) == width])
        clock = whole[:, 0]
        if width > taxels and ((np.diff(clock) < 0).any() or (clock[0] == clock[-1] and len(clock) > 1)):
            raise InputError(
                f"its lines have {width} numbers for {taxels} taxels, and the first is no clock that rises"
            )
        return whole[:, -taxels:]
    lines, frames, block = taxels // width, list[list[float]](), list[list[float]]()
    for number, one in enumerate([*numbers, None], start=1):
        if one is not None and len(one) == width:
            block.append(one)
            continue
        if len(block) % lines:
            raise InputError(
                f"line {number - len(block)}: {len(block)} lines of {width} numbers follow each other; a frame of "
                f"{taxels} taxels has {lines}"
            )
        frames += np.reshape(block, (-1, taxels)).tolist()
        block = []
    return np.array(frames)


def _cells(line: str) -> list[str]:
    """Split a line at commas, semicolons, tabs or blanks; at commas not if they may be decimal beside another mark."""
    line = _TIME_AHEAD.sub("", re.sub(r"[\[\]]", " ", _plain(line)))  # lists have brackets
    words = [word.strip("\"'") for word in re.split(r"[;|\t ]+", line.strip(",;|\t \r")) if word]
    marked = [word for word in words if "," in word]
    if marked and len(words) > 1 and all(map(_OF_A_NUMBER.fullmatch, marked)):
        return words
    cells = [part.strip("\"'") for word in words for part in word.split(",") if part]
    return [_NUMBERED.sub(r"\1", cells[0]), *cells[1:]] if len(cells) > 1 else cells


def _numbers(cells: list[str], thousands: str, commas: bool) -> list[float] | None:
    """Read cells that are all numbers; None if there are none, or anything else."""
    try:
        values = [
            number_of(cell.replace(thousands, "").replace(",", "." if commas else ",")) for cell in cells
        ]
    except ValueError:
        return None
    return None if np.isnan(values).all() else values
