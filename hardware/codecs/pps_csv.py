"""`pps-csv`: the recording that the vendor's demonstration tool writes, and what spreadsheets make of it.

A title line `Time [ms], Elem0, Elem1, ...`, then one line a frame: `0, 0.11, 0.02, ...`. The tool may have written
lines above the title, and a separator behind the last number. A spreadsheet that saved it again may have put a byte
order mark before it, and quotes around cells, and may write `0;0,11;0,02`: semicolons between the numbers and decimal
commas.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from statistics import mode
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import CodecError, CodecFormat, Frame
from tactsim.hardware.codecs.lines import LinesCodec, LinesFormat

_KPA = {"kPa": 1.0, "psi": 6.894757293168361, "Pa": 1e-3}  # 1 psi = 1 lbf/in^2
_TITLE_WITHIN = 20  # lines, at whose end the title has stood
# The title of the time, and its unit: `Time [ms]`, `Time(s)`, `timestamp_us`, `t`.
_TIME = re.compile(
    r'["\s]*(?:(?:elapsed[ _]?)?time(?:_?stamp)?|t)'
    r"(?:_(\w+)|\b(?:[^\[(/,;\t]*?(?:[\[(]\s*(\w+)\s*[\])]|(?:/|\bin\s)\s*(\w+)))?)",
    re.IGNORECASE,
)
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "sec": 1.0, "seconds": 1.0, "min": 60.0}
_SECONDS |= {"milliseconds": 1e-3, "msec": 1e-3, "millis": 1e-3, "usec": 1e-6, "micros": 1e-6}
_SECONDS |= {"µs": 1e-6, "μs": 1e-6}  # micro sign, and the Greek letter
_SINCE_1970 = 1e6  # s: more than any recording is long; from there on a clock tells the date
_STEPS = 50  # by which the unit of a time is told whose title does not say it


class CsvFormat(CodecFormat):
    """The table `[codec]` of a device file with `kind = "pps-csv"`."""

    kind: Literal["pps-csv"]
    taxels: int = Field(ge=1, le=10_000, description="columns behind the time", examples=[36])
    unit: Literal["kPa", "psi", "Pa", "N", "V", "count"] = Field(
        "kPa", description="unit of the numbers; readings in N, V or count keep theirs"
    )

    zero: float = Field(0.0, description="value of an unloaded taxel, which is taken off all numbers")

    @property
    def reading_unit(self) -> str:
        """Give the unit of the readings that are made of the numbers."""
        return "kPa" if self.unit in _KPA else self.unit

    def build(self) -> CsvCodec:
        """Make the codec."""
        return CsvCodec(self)


class CsvCodec(LinesCodec):
    """Read and write such lines as they come from a port or an emulator; see `read_table` for a file."""

    def __init__(self, form: CsvFormat) -> None:
        lines = LinesFormat(
            kind="csv",
            taxels=form.taxels,
            before=("clock",),
            zero=form.zero,
            kpa_per_count=_KPA.get(form.unit, 1.0),
        )
        super().__init__(lines)
        self.tick_wrap = None
        self._whole = form.unit == "count"
        self.title = (", ".join(["Time [ms]", *(f"Elem{k}" for k in range(self.taxels))]) + "\n").encode()

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn readings into the file's unit; counts are whole numbers."""
        values = super().from_kpa(pressures)
        return np.round(values) if self._whole else values


class Table(NamedTuple):
    """A recording that is read line by line. frames: None for a line that is no frame. remark: on the unit of time."""

    taxels: int
    frames: Iterator[Frame | None]
    remark: str | None


def read_table(lines: Iterable[bytes]) -> Table:
    """Read the head of a recording; its frames follow line by line.

    A frame's `seconds` are as the unit in the title says, or as the steps tell: below 1 they are s, below 1,000 ms,
    below 1,000,000 us, else ns. They count from the first frame if the clock counts from 1970. Taxels are the numbers
    behind the time in the first frame. Raises CodecError if there is no title within 20 lines, or no frame behind it.
    """
    lines = iter(lines)
    begin = next(lines, b"")
    if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise CodecError("its text is UTF-16; save it as UTF-8")
    texts = (
        text for line in chain([begin], lines) for text in line.decode("utf-8-sig", "replace").splitlines()
    )
    title = next((text for text in islice(texts, _TITLE_WITHIN) if _TIME.match(text)), None)
    if title is None:
        raise CodecError("no recording of the vendor's tool: its first line is 'Time [ms], Elem0, ...'")
    separator = next((mark for mark in ";\t" if mark in title), ",")
    filled = (text for text in texts if text.strip())
    samples = list(islice(filled, _STEPS))
    commas = separator != "," and any("," in text for text in samples)
    head = [_numbers(text, separator, commas) for text in samples]
    rows = [row for row in head if row is not None]
    width = mode(map(len, rows)) if rows else 0  # a line may be cut short, also the first
    if width < 2:
        but = f", but {samples[0].strip()[:60]!r}" if samples else ""
        raise CodecError(f"behind the title {title.strip()[:60]!r} stands no line of numbers{but}")
    times = [float(row[0]) for row in rows if len(row) == width]
    tick, remark = _tick(title, times)
    begun = times[0] * tick if times[0] * tick >= _SINCE_1970 else 0.0

    def frames() -> Iterator[Frame | None]:
        for row in chain(head, (_numbers(text, separator, commas) for text in filled)):
            if row is None or len(row) != width:
                yield None
            else:
                yield Frame(row[1:], seconds=float(row[0] * tick - begun))

    return Table(width - 1, frames(), remark)


def _numbers(text: str, separator: str, commas: bool) -> FloatArray | None:
    """Read the numbers of a line; None if one is no finite number, or which point is decimal is unclear.

    commas: whether lines of this recording have decimal commas, so that a point may be one of thousands.
    """
    try:
        (cells,) = csv.reader([text.strip()], delimiter=separator, skipinitialspace=True)
        while cells and not cells[-1].strip():
            cells.pop()
        if separator != "," and (commas or "," in text):
            cells = [] if "." in text else [cell.replace(",", ".") for cell in cells]
        numbers = np.array([float(cell) for cell in cells])
    except (csv.Error, ValueError):
        return None
    # A clock since 1970 in ns is larger than any reading may be.
    sound = len(numbers) and np.isfinite(numbers[0]) and (np.abs(numbers[1:]) <= LARGEST).all()
    return numbers if sound else None


def _tick(title: str, times: list[float]) -> tuple[float, str | None]:
    """Give the s of one unit of time: of the title's, or by the median step, and then a remark that says so."""
    named = _TIME.match(title)
    unit = next(filter(None, named.groups()), None) if named else None
    if unit is not None:
        if unit.lower() not in _SECONDS:
            raise CodecError(f"the title's unit of time is {unit!r}; known are {', '.join(_SECONDS)}")
        return _SECONDS[unit.lower()], None
    steps = np.abs(np.diff(times))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    unit = next((unit for most, unit in ((1, "s"), (1e3, "ms"), (1e6, "us")) if step < most), "ns")
    remark = f"the time is read as {unit}, by its steps of {step:g}: a title like 'time [s]' says it outright"
    return _SECONDS[unit], remark
