"""`csv`: lines of numbers, as an Arduino prints them with `Serial.print`.

A line counts only if the end of the line before it was seen: the first line after the port was opened may be the
rest of one, which looks like a whole line of smaller numbers. A line that lost characters in its middle looks
like a line, too. Only a checksum behind the numbers tells, "*" and hexadecimal digits as in NMEA 0183:

    12,0,345*5B

It covers all characters before the "*".
"""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.checksums import CHECKSUMS
from tactsim.hardware.codecs.codec import Codec, CodecFormat, Frame
from tactsim.hardware.codecs.layout import Bytes

_END = b"\n"
_LONGEST_NUMBER = 32  # characters of one number with its separator
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_DIGITS = 9  # written of each value: as many as a float of 32 bits needs
_LARGEST_COUNT = float(1 << 53)  # of a clock or a frame counter: up to there every whole number is exact
_COUNTER = 1 << 32  # an Arduino's unsigned long starts again there

Column = Literal["clock", "index", "skip"]


class LinesFormat(CodecFormat):
    """The table `[codec]` of a device file with `kind = "csv"`.

    pressure in kPa = (value - zero) * kpa_per_count.
    """

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
        ",", description="what stands between two numbers; blanks around it do no harm"
    )
    decimal: Literal[".", ","] = Field(".", description="the decimal point")
    checksum: str | None = Field(
        None, description='kind of the checksum behind a "*", in hexadecimal digits; none: there is none'
    )
    tick_s: float = Field(0.001, gt=0, le=3600, description="s a tick of the clock")
    zero: float = Field(0.0, description="value of an unloaded taxel")
    kpa_per_count: float = Field(
        description="kPa of one count; kPa = (value - zero) * kpa_per_count", examples=[0.1]
    )
    start: Bytes = Field(b"", max_length=256, description="bytes that make the device speak, sent once")
    request: Bytes = Field(b"", max_length=256, description="bytes that ask for one line")
    request_every_s: float = Field(0.0, ge=0, le=60, description="s from one request to the next, at least")

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
        if not self.kpa_per_count:
            raise ValueError("kpa_per_count must not be 0")
        return self

    def build(self) -> LinesCodec:
        """Make the codec."""
        return LinesCodec(self)


class LinesCodec(Codec[Frame]):
    """Read and write such lines. A line that has another number of columns, or no numbers, is no frame."""

    before = len(_END)

    def __init__(self, form: LinesFormat) -> None:
        self.format = form
        self.start, self.request, self.request_every_s = form.start, form.request, form.request_every_s
        self.taxels, self.tick_s, self.speaks = form.taxels, form.tick_s, not form.request
        self._columns = len(form.before) + form.taxels * form.axes + form.after
        self.longest = _LONGEST_NUMBER * (self._columns + 1)
        self._delimiter = {"tab": "\t", "blank": " "}.get(form.delimiter, form.delimiter)
        self._at = {name: form.before.index(name) for name in ("clock", "index") if name in form.before}
        self.tick_wrap = _COUNTER
        if "index" in self._at:
            self.index_wrap = _COUNTER  # two boards count each for itself, so nothing is paired by it

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Frame | None]:
        """Look for a line behind the line end at `start`; see `Codec.decode`.

        The line's own end is left: it is the beginning of the next.
        """
        at = buffer.find(_END, start)
        if at != start:
            return (at if at >= 0 else len(buffer)) - start, None
        end = buffer.find(_END, start + 1, start + self.longest)
        if end < 0:
            return (self.longest if len(buffer) - start >= self.longest else 0), None
        return end - start, self._frame(bytes(buffer[start + 1 : end]))

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

    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn values into kPa by the format's zero and scale."""
        return (values - self.format.zero) * self.format.kpa_per_count

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa into values."""
        return pressures / self.format.kpa_per_count + self.format.zero

    def fails_checksum(self, buffer: bytes | bytearray, start: int) -> bool:
        """Tell whether a line of the right columns stands behind the line end at `start`, and its checksum is wrong."""
        end = buffer.find(_END, start + 1, start + self.longest)
        if self.format.checksum is None or end < 0 or not buffer.startswith(_END, start):
            return False
        numbers, is_right = self._summed(bytes(buffer[start + 1 : end]).removesuffix(b"\r"))
        return not is_right and self._numbers(numbers) is not None

    def _summed(self, line: bytes) -> tuple[bytes, bool]:
        """Give the numbers of a line, and whether the checksum behind them is theirs."""
        numbers, _, _ = line.partition(b"*")
        return numbers, self._sum(numbers) == line[len(numbers) :].upper()

    def _frame(self, line: bytes) -> Frame | None:
        line = line.removesuffix(b"\r")
        if self.format.checksum is not None:
            line, is_right = self._summed(line)
            if not is_right:
                return None
        found = self._numbers(line)
        if found is None:
            return None
        form = self.format
        ahead = len(form.before)
        values = np.array(found[ahead : len(found) - form.after]).reshape(form.taxels, form.axes)
        normal = values[:, form.normal]
        if not (np.abs(self.to_kpa(normal)) <= LARGEST).all():
            return None
        ticks, index = (found[self._at[name]] if name in self._at else None for name in ("clock", "index"))
        if index is not None and not (index.is_integer() and 0 <= index < _COUNTER):
            return None
        return Frame(normal, index=None if index is None else int(index), ticks=ticks)

    def _numbers(self, line: bytes) -> list[float] | None:
        """Read the numbers of a line; None if there are more or fewer, or one of them is none."""
        fields = line.split() if self._delimiter == " " else line.split(self._delimiter.encode())
        fields = [field.strip(b" \t") for field in fields]
        if self.format.decimal == ",":
            fields = [field.replace(b".", b"?").replace(b",", b".") for field in fields]
        if len(fields) != self._columns or not all(map(_NUMBER.fullmatch, fields)):
            return None
        numbers = [float(field) for field in fields]
        return numbers if all(abs(number) < _LARGEST_COUNT for number in numbers) else None

    def _sum(self, line: bytes) -> bytes:
        if self.format.checksum is None:
            return b""
        size, function = CHECKSUMS[self.format.checksum]
        return b"*%0*X" % (2 * size, function(line))
