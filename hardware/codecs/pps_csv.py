"""`pps-csv`: the recording that the vendor's demonstration tool writes, and what spreadsheets make of it.

A title line `Time [ms], Elem0, Elem1, ...`, then one line a frame: `0, 0.11, 0.02, ...`, or another table of text with
a time, as `text_tables` has them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from itertools import chain, islice
from statistics import mode
from typing import Literal

import numpy as np
from pydantic import Field

from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.hardware import text_tables
from tactsim.hardware.codecs.codec import CodecError, CodecFormat, Frame
from tactsim.hardware.codecs.lines import LinesCodec, LinesFormat

_KPA = {"kPa": 1.0, "psi": 6.894757293168361, "Pa": 1e-3}  # 1 psi = 1 lbf/in^2
_WORD = re.compile(r"(?:[A-Z]?[a-zµμ\ufffd]+|[A-Z]+)(?![a-zµμ\ufffd\d])")
_TIMES = {"time", "timestamp", "datetime", "elapsed", "t", "seconds", "millis", "micros"}
_OF_DAY = re.compile(r"\d:\d\d:\d\d")
_CLOCK = re.compile(r"(\d+):([0-5]\d):([0-5]\d(?:[.,]\d+)?)(?: ?([AaPp])[Mm]|Z)?")
_DAY = 86_400.0  # s
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "sec": 1.0, "seconds": 1.0, "min": 60.0}
_SECONDS |= {"milliseconds": 1e-3, "msec": 1e-3, "millis": 1e-3, "usec": 1e-6, "micros": 1e-6}
_SECONDS |= {"secs": 1.0, "days": _DAY, "µs": 1e-6, "μs": 1e-6}  # micro sign, and the Greek letter
_SINCE_1970 = 1e6  # s: more than any recording is long; from there on a clock tells the date
_BY_STEP = ((1e-5, "days"), (1, "s"), (1e3, "ms"), (1e6, "us"))  # of a time, below which it is in that unit
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


def read_table(texts: Iterable[str]) -> tuple[list[str], Iterator[Frame | str], str | None]:
    """Read the head of a recording: the names of its taxels, its frames line by line, and a remark on its time.

    A line that is no frame comes as text.
    What stands before the time is left out. A frame's ticks are s, as the unit in the title says, or as the steps
    tell: below 0.00001 they are days, below 1 s, below 1,000 ms, below 1,000,000 us, else ns; or as a time of day does.
    They count from the first frame if the clock counts from midnight or from 1970. Taxels are the numbers behind the
    time, or before it if it is the last column.
    Raises CodecError if there is no title with a time within 40 lines, or no frame behind it.
    """
    texts = filter(str.strip, texts)
    head = list(islice(texts, text_tables.TITLE_WITHIN + _STEPS))
    titles = [text_tables.title_cells(text) for text in head[: text_tables.TITLE_WITHIN]]
    named = [at for at, cells in enumerate(titles) if _time_at(cells) >= 0]
    if not named:
        raise CodecError(
            "no recording of the vendor's tool: its first line is 'Time [ms], Elem0, ...'; lines as a device prints "
            "them are read by a device file with the codec kind 'csv', which `bench probe` writes"
        )
    # Words about the recording may say time, too.
    line = max(named, key=lambda at: (text_tables.separator_of(head[at]) != " ", len(titles[at])))
    separator, time, samples = text_tables.separator_of(head[line]), _time_at(titles[line]), head[line + 1 :]
    known = chain(*(cells for _, cells in text_tables.cells_of(samples, separator)))
    commas = text_tables.has_decimal_commas(known, separator)

    def numbers(text: str) -> FloatArray | None:
        """Read the time and the taxels of a frame; None if a cell is no number, or the time is NaN."""
        try:
            ((_, cells),) = text_tables.cells_of([text], separator)
            cells = cells[time:] + cells[:time] * (len(cells) == time + 1)
            filled = [cell or "nan" for cell in cells]
            first, *others = text_tables.with_points(filled, separator, commas)
            row = np.array([_of_day(first) if _OF_DAY.search(first) else float(first), *map(float, others)])
        except ValueError:
            return None
        # A clock since 1970 in ns is larger than any reading may be.
        return row if np.isfinite(row[0]) and not (np.abs(row[1:]) > LARGEST).any() else None

    rows = [row for text in samples if (row := numbers(text)) is not None]
    width = mode(map(len, rows)) if rows else 0  # a line may be cut short, also the first
    if width < 2:
        but = f", but {samples[0].strip()[:60]!r}" if samples else ""
        raise CodecError(f"behind the title {head[line].strip()[:60]!r} stands no line of numbers{but}")
    names = [*(titles[line][time + 1 :] or titles[line][:time]), *[""] * width][: width - 1]
    whole = np.array([row for row in rows if len(row) == width])
    dead = np.isnan(whole).all(axis=0)
    if dead[1:].all():
        raise CodecError(f"behind the title {head[line].strip()[:60]!r} every number is NaN")
    clock = whole[:, 0].tolist()
    of_day = any(map(_OF_DAY.search, samples))
    tick, remark = (1.0, None) if of_day else _tick(titles[line][time], clock)
    if dead.any():
        lost = ", ".join(map(str, np.flatnonzero(dead[1:])))
        also = f"; {remark}" if remark else ""
        remark = f"taxel {lost}: NaN in every line, which counts as 0: never pressed{also}"
    begun = clock[0] * tick if of_day or clock[0] * tick >= _SINCE_1970 else 0.0

    def frames() -> Iterator[Frame | str]:
        last = 0.0
        for text in chain(samples, texts):
            row = numbers(text)
            if row is None or len(row) != width or (np.isnan(row) != dead).any():
                yield text
            else:
                row[dead] = 0
                seconds = float(row[0] * tick - begun)
                if of_day and clock[0] < _SINCE_1970:  # no date stands before it
                    seconds += _DAY * round((last - seconds) / _DAY)
                last = seconds
                yield Frame(row[1:], ticks=seconds)

    return names, frames(), remark


def _words(cell: str) -> list[str]:
    """List the words of a title's cell: time and ms of `Time [ms]`, `time_ms` or `timeMs`; none of `t0`."""
    return [word.lower() for word in _WORD.findall(cell.replace("X_Value", "time"))]  # as LabVIEW calls it


def _time_at(cells: Sequence[str]) -> int:
    """Tell which cell of a title, of two or more, names the time; -1 if none does."""
    named = [at for at, cell in enumerate(cells) if _TIMES.intersection(_words(cell))]
    return named[0] if named and len(cells) > 1 else -1


def _of_day(text: str) -> float:
    """Read `12:00:01.5` or `1:00:01 PM` in s of the day, behind a date of ISO 8601 since 1970. Raises ValueError."""
    if (found := _CLOCK.fullmatch(text)) is None:
        return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
    hours, minutes, seconds, half = found.groups()
    hour = int(hours) if half is None else int(hours) % 12 + 12 * (half in "Pp")
    return 3600 * hour + 60 * int(minutes) + float(seconds.replace(",", "."))


def _tick(title: str, times: Sequence[float]) -> tuple[float, str | None]:
    """Give the s of one unit of time: of its title's, or by the median step, and then a remark that says so."""
    unit = next((word for word in _words(title) if word in _SECONDS), None)
    if unit is not None:
        return _SECONDS[unit], None
    if bracketed := re.search(r"[\[(]\s*(\w+)\s*[\])]", title):
        raise CodecError(f"the title's unit of time is {bracketed[1]!r}; known are {', '.join(_SECONDS)}")
    steps = np.abs(np.diff(times))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    unit = next((unit for most, unit in _BY_STEP if step < most), "ns")
    remark = f"the time is read as {unit}, by its steps of {step:g}: a title like 'time [s]' says it outright"
    return _SECONDS[unit], remark
