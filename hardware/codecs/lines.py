"""`csv`: lines of numbers, as an Arduino prints them with `Serial.print`.

Between two numbers stand commas, semicolons, tabs, bars or blanks, one kind in a line. What sketches print around them
does no harm: a separator before the first number or behind the last, brackets, names as in `S0:12`, a `$` or a `#`, a
time as in `12:00:01.123 -> 12,34`. A frame is a line, or several, one for each row, between two lines of another kind:
empty ones, `-----` or `Frame 12`. A line that says `nan` or `ovf` is none, unless in a column that is left out (`skip`,
`after`), which may be a word or a date.

A line counts only if the end of the line before it was seen: the first line after the port was opened may be the
rest of one, which looks like a whole line of smaller numbers. A line that lost characters in its middle looks
like a line, too. Only a checksum behind the numbers tells, "*" and hexadecimal digits as in NMEA 0183:

    12,0,345*5B

It covers all characters before the "*", but for a "$" that the line begins with.
"""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from tactsim.core.finite import LARGEST
from tactsim.hardware.codecs.checksums import CHECKSUMS
from tactsim.hardware.codecs.codec import CountsCodec, CountsFormat, Frame

_END = re.compile(rb"\r\n|\r|\n")
_LONGEST_NUMBER = 32  # characters of one number with its separator and its name
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_HEXADECIMAL = re.compile(rb"0[xX][0-9a-fA-F]{1,13}")
_ESCAPE = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")  # clears or colours a terminal
_AROUND = bytes.maketrans(b"[](){}<>|$#\"'\0", b" " * 14)  # means nothing here, or no more than a blank
_NAME = re.compile(rb"(?<![\w.+-])(?:[A-Za-z_]\w*(?: \d+)? *[:=]|\d+: )")  # of a number, or of a row
# Of a line, as `S0:12`; among rows that have none it makes a heading, as `Frame: 12`.
FIRST_NAME = re.compile(rb"\W*([A-Za-z_]\w*(?: \d+)?) *[:=]")
_DIGITS = 9  # written of each value: as many as a float of 32 bits needs
_LARGEST_COUNT = float(1 << 53)  # of a clock or a frame counter: up to there every whole number is exact
_COUNTER = 1 << 32  # an Arduino's unsigned long starts again there

Column = Literal["clock", "index", "skip"]


class LinesFormat(CountsFormat):
    """The table `[codec]` of a device file with `kind = "csv"`."""

    kind: Literal["csv"]
    taxels: int = Field(ge=1, le=10_000, description="how many taxels a line has", examples=[16])
    axes: int = Field(
        1, ge=1, le=16, description="values of each taxel; all but one are kept in recordings only"
    )
    normal: int = Field(0, ge=0, le=15, description="which of them is read, from 0: the normal force")
    before: tuple[Column, ...] = Field(
        (), max_length=16, description="what the columns before the taxels hold: `clock`, `index` or `skip`"
    )
    after: int = Field(0, ge=0, le=1000, description="columns behind the taxels that mean nothing here")
    delimiter: Literal[",", ";", "tab", "blank"] = Field(
        ",", description="what an emulated device writes between two numbers; each of these is read"
    )
    decimal: Literal[".", ","] = Field(".", description="the decimal point")
    checksum: str | None = Field(
        None, description='kind of the checksum behind a "*", in hexadecimal digits; none: there is none'
    )
    tick_s: float = Field(0.001, gt=0, le=3600, description="s a tick of the clock")

    @model_validator(mode="after")
    def _makes_sense(self) -> LinesFormat:
        if self.delimiter == self.decimal:
            raise ValueError("delimiter and decimal are both a comma: no line can be read")
        if self.normal >= self.axes:
            raise ValueError(f"the normal axis {self.normal} is none of {self.axes}: count from 0")
        if self.before.count("clock") > 1 or self.before.count("index") > 1:
            raise ValueError("one column is the clock, and one the index")
        if self.checksum is not None and self.checksum not in CHECKSUMS:
            raise ValueError(f"unknown checksum {self.checksum!r}; known are {', '.join(CHECKSUMS)}")
        return self

    def build(self) -> LinesCodec:
        """Make the codec."""
        return LinesCodec(self)


class LinesCodec(CountsCodec):
    """Read and write such lines. A line that has another number of columns, or no numbers, is no frame."""

    before = 1

    def __init__(self, form: LinesFormat) -> None:
        super().__init__(form)
        self.format = form
        self.taxels, self.tick_s = form.taxels, form.tick_s
        self._columns = len(form.before) + form.taxels * form.axes + form.after
        self.longest = _LONGEST_NUMBER * (self._columns + 1)
        self._delimiter = {"tab": "\t", "blank": " "}.get(form.delimiter, form.delimiter)
        # The columns that are read, and where the clock and the counter stand among them.
        read = [column for column, name in enumerate(form.before) if name != "skip"]
        self._at = {form.before[column]: place for place, column in enumerate(read)}
        self._read = [*read, *range(len(form.before), self._columns - form.after)]
        self.tick_wrap = _COUNTER
        if "index" in self._at:
            self.index_wrap = _COUNTER  # two boards count each for itself, so nothing is paired by it

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Frame | None]:
        """Look for a line, or rows between empty lines, behind the line end at `start`; see `Codec.decode`.

        The last line's own end is left: it is the beginning of the next.
        """
        if buffer[start] not in b"\r\n":
            end = _END.search(buffer, start)
            return (end.start() if end else len(buffer)) - start, None
        line, used = self._line(buffer, start)
        fields = self._fields(line)
        frame = self._frame(fields) if used and self._is_right(line) else None
        heading = not numbers_in(fields) or FIRST_NAME.match(line)
        if used and frame is None and self.format.checksum is None and heading:
            fields, of_rows = self._rows(buffer, start + used)
            frame = self._frame(fields) if fields else None
            used = 0 if of_rows is None else used + (of_rows if frame else 0)
        if not used and len(buffer) - start >= self.longest:
            used = self.longest
        return used, frame

    def _line(self, buffer: bytes | bytearray, start: int) -> tuple[bytes, int]:
        """Give the line behind the line end at `start`, and how far its own end lies: 0 if it has not come."""
        end = _END.search(buffer, start + 1, start + self.longest)
        if end is None or (end.group() == b"\r" and end.end() == len(buffer)):  # a line feed may follow
            return b"", 0
        return bytes(buffer[start + 1 : end.start()]), end.end() - 1 - start

    def _rows(self, buffer: bytes | bytearray, start: int) -> tuple[list[bytes], int | None]:
        """Give the fields of the rows from the end of a line that is no row, at `start`, to the next such line.

        Returns (fields, how far the end of the last row lies), (..., None) if they have not all come, ([], 0) if no
        rows of equal length stand there.
        """
        fields: list[bytes] = []
        first, named, at = 0, False, 0
        while at < self.longest:
            line, used = self._line(buffer, start + at)
            if not used:
                return fields, None
            row, name = self._fields(line), FIRST_NAME.match(line) is not None
            if not numbers_in(row) or (fields and len(row) != first and name > named):
                return fields, at
            if (fields and len(row) != first) or len(row) >= self._columns:
                break
            first, named, fields, at = len(row), name, fields + row, at + used
        return [], 0

    def encode(self, frame: Frame) -> bytes:
        """Write one line; the columns and axes that are not read are 0."""
        form = self.format
        ahead = {"clock": int(frame.ticks or 0), "index": frame.index or 0, "skip": 0}
        values = np.zeros((form.taxels, form.axes))
        values[:, form.normal] = frame.values
        words = [str(ahead[name]) for name in form.before]
        words += [f"{value:.{_DIGITS}g}" for value in [*values.ravel(), *[0] * form.after]]
        line = self._delimiter.join(word.replace(".", form.decimal) for word in words).encode()
        return line + self._sum(line) + b"\r\n"

    def fails_checksum(self, buffer: bytes | bytearray, start: int) -> bool:
        """Tell whether a line of the right columns stands behind the line end at `start`, and its checksum is wrong."""
        if self.format.checksum is None or buffer[start] not in b"\r\n":
            return False
        line, _ = self._line(buffer, start)
        return not self._is_right(line) and self._numbers(self._fields(line)) is not None

    def _is_right(self, line: bytes) -> bool:
        """Tell whether the checksum behind a line's numbers is theirs; lines without one are right."""
        numbers, mark, digits = line.partition(b"*")
        return self.format.checksum is None or self._sum(numbers) == mark + digits.strip().upper()

    def _frame(self, fields: list[bytes]) -> Frame | None:
        numbers = self._numbers(fields)
        if numbers is None:
            return None
        form = self.format
        values = np.array(numbers[len(self._at) :]).reshape(form.taxels, form.axes)
        normal = values[:, form.normal]
        if not (np.abs(self.to_kpa(normal)) <= LARGEST).all():
            return None
        ticks, index = (numbers[self._at[name]] if name in self._at else None for name in ("clock", "index"))
        if index is not None and not (index.is_integer() and 0 <= index < _COUNTER):
            return None
        return Frame(normal, index=None if index is None else int(index), ticks=ticks)

    def _fields(self, line: bytes) -> list[bytes]:
        """Split a line, without its checksum, at the one kind of separator that stands in it."""
        numbers = line if self.format.checksum is None else line.partition(b"*")[0]
        return split_line(numbers, self.format.decimal)

    def _numbers(self, fields: list[bytes]) -> list[float] | None:
        """Read the numbers that mean something; None if a frame has more or fewer columns, or one of them is none."""
        if len(fields) != self._columns:
            return None
        numbers = numbers_in([fields[column] for column in self._read])
        if numbers is None or max(map(abs, numbers)) >= _LARGEST_COUNT:
            return None
        return numbers

    def _sum(self, line: bytes) -> bytes:
        if self.format.checksum is None:
            return b""
        size, function = CHECKSUMS[self.format.checksum]
        return b"*%0*X" % (2 * size, function(line.removeprefix(b"$")))


def split_line(line: bytes, decimal: str = ".") -> list[bytes]:
    """Split a line of numbers into fields with a decimal point, without their names and what stands before `->`."""
    line = _ESCAPE.sub(b"", line).rpartition(b"->")[2].translate(_AROUND)
    if decimal == ",":
        line = line.replace(b".", b"?").replace(b",", b".")
    line = _NAME.sub(b" ", line).strip(b" \t,;")
    separator = next((mark for mark in (b",", b";") if mark in line), None)
    fields = [field.strip() for field in line.split(separator)]
    words = fields[0].split() if separator else []
    if numbers_in(words[-1:]):  # behind a number, as in `20 12,34`, or a time, as in `[12:00:01] 12,34`
        fields[:1] = words if numbers_in(words) else words[-1:]
    return fields


def numbers_in(fields: list[bytes]) -> list[float] | None:
    """Read fields that are all decimal numbers, or all hexadecimal after 0x; None for anything else."""
    if all(map(_HEXADECIMAL.fullmatch, fields)):
        return [float(int(field, 16)) for field in fields]
    return [float(field) for field in fields] if all(map(_NUMBER.fullmatch, fields)) else None
