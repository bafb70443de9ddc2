"""`pps-csv`: the recording that the vendor's demonstration tool writes.

A title line `Time [ms], Elem0, Elem1, ...`, then one line a frame: `0, 0.11, 0.02, ...`. A spreadsheet that saved it
again may have put a byte order mark before it and quotes around the names, and may write `0;0,11;0,02`: semicolons
between the numbers and decimal commas.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import Codec, CodecError, CodecFormat, Frame

_KPA = {"kPa": 1.0, "psi": 6.894757293168361, "Pa": 1e-3}  # 1 psi = 1 lbf/in^2
_MARK = b"\xef\xbb\xbf"  # byte order mark
_TITLES = tuple(mark + quote + b"Time" for mark in (b"", _MARK) for quote in (b"", b'"'))
_LONGEST_NUMBER = 32  # characters of one number with its separator
_LONGEST_TITLE = 24  # of one column's name with its separator


class CsvFormat(CodecFormat):
    """The table `[codec]` of a device file with `kind = "pps-csv"`."""

    kind: Literal["pps-csv"]
    taxels: int = Field(ge=1, le=10_000, description="columns behind the time", examples=[36])
    unit: Literal["kPa", "psi", "Pa", "N", "V", "count"] = Field(
        "kPa", description="unit of the numbers; readings in N, V or count keep theirs"
    )

    @property
    def reading_unit(self) -> str:
        """Give the unit of the readings that are made of the numbers."""
        return "kPa" if self.unit in _KPA else self.unit

    def build(self) -> CsvCodec:
        """Make the codec."""
        return CsvCodec(self)


class CsvCodec(Codec[Frame]):
    """Read and write such lines. A line that has another number of columns, or no numbers, is no frame."""

    tick_s = 1e-3

    def __init__(self, form: CsvFormat) -> None:
        self.format = form
        self.taxels = form.taxels
        self._longest_line = _LONGEST_NUMBER * (form.taxels + 1)
        self.longest = self._longest_line + _LONGEST_TITLE * (form.taxels + 1)
        self.title = (", ".join(["Time [ms]", *(f"Elem{k}" for k in range(self.taxels))]) + "\n").encode()

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Frame | None]:
        """Look for a line at `start`; see `Codec.decode`. The title line counts to the line behind it."""
        end = buffer.find(b"\n", start, start + self.longest)
        if end < 0:
            return (self.longest if len(buffer) - start >= self.longest else 0), None
        if bytes(buffer[start : start + 8]).startswith(_TITLES):
            second = buffer.find(b"\n", end + 1, start + self.longest)
            if second < 0:
                whole = len(buffer) - start >= self.longest
                return (end + 1 - start if whole else 0), None
            frame = self._frame(bytes(buffer[end + 1 : second]))
            return (second + 1 - start, frame) if frame else (end + 1 - start, None)
        return end + 1 - start, self._frame(bytes(buffer[start:end]))

    def encode(self, frame: Frame) -> bytes:
        """Write one line."""
        return (
            ", ".join(f"{value:.9g}" for value in [frame.ticks or 0.0, *frame.values.tolist()]) + "\n"
        ).encode()

    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn the file's unit into kPa; readings of other units are left in theirs."""
        return values * _KPA.get(self.format.unit, 1.0)

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn readings into the file's unit; counts are whole numbers."""
        values = pressures / _KPA.get(self.format.unit, 1.0)
        return np.round(values) if self.format.unit == "count" else values

    def _frame(self, line: bytes) -> Frame | None:
        fields = _fields(line)
        if len(fields) != self.taxels + 1:
            return None
        try:
            numbers = np.array([float(field) for field in fields])
        except ValueError:
            return None
        if not (np.abs(numbers) <= LARGEST).all():  # false for NaN too
            return None
        return Frame(numbers[1:], ticks=float(numbers[0]))


def _fields(line: bytes) -> list[bytes]:
    """Split a line at its commas, or at its semicolons, where a comma is a decimal point."""
    line = line.removeprefix(_MARK)
    if b";" not in line:
        return line.split(b",")
    if b"," in line and b"." in line:
        return []  # which of the two is decimal cannot be told for all numbers
    return line.replace(b",", b".").split(b";")


def count_taxels(first_line: bytes) -> int:
    """Count the taxels by the title line of a recording. Raises CodecError if it is none."""
    columns = _fields(first_line.strip())
    if len(columns) < 2 or not first_line.startswith(_TITLES):
        raise CodecError("no recording of the vendor's tool: its first line is 'Time [ms], Elem0, ...'")
    return len(columns) - 1
