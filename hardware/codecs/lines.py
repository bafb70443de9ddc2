"""`csv`: lines of numbers, as an Arduino prints them with `Serial.print`; and which ones a device prints, guessed.

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

import math
import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tactsim.core.counters import Counters
from tactsim.core.errors import counted
from tactsim.core.finite import LARGEST
from tactsim.hardware.codecs.codec import CHECKSUMS, CountsCodec, CountsFormat, Frame, Framer
from tactsim.hardware.text_tables import unit_since_1970

_END = re.compile(rb"\r\n|\r|\n")
_LONGEST_NUMBER = 32  # characters of one number with its separator and its name
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_HEXADECIMAL = re.compile(rb"0[xX][0-9a-fA-F]{1,13}")
_BARE = re.compile(rb"(0[xX])?[0-9a-fA-F]{1,13}")
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
    base: Literal[10, 16] = Field(
        10, description="16 if all numbers are hexadecimal digits, with 0x before them or not"
    )
    checksum: str | None = Field(
        None, description='kind of the checksum behind a "*", in hexadecimal digits; none: there is none'
    )
    tick_s: float = Field(0.001, gt=0, le=3600, description="s a tick of the clock")

    @model_validator(mode="after")
    def _makes_sense(self) -> LinesFormat:
        if self.delimiter == self.decimal:
            raise ValueError("delimiter and decimal are both a comma: no line can be read")
        if self.base == 16 and self.decimal == ",":
            raise ValueError("hexadecimal numbers have no decimal comma: leave out decimal")
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
        heading = not numbers_in(fields, self.format.base) or FIRST_NAME.match(line)
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
            if not numbers_in(row, self.format.base) or (fields and len(row) != first and name > named):
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
        if form.base == 16:
            words = [f"{max(round(float(word)), 0):X}" for word in words]
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
        numbers = numbers_in([fields[column] for column in self._read], self.format.base)
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


def numbers_in(fields: list[bytes], base: int = 10) -> list[float] | None:
    """Read fields that are all decimal numbers, or all hexadecimal after 0x; None for anything else.

    base: 16 if they are hexadecimal without 0x, too.
    """
    if all(map((_HEXADECIMAL if base == 10 else _BARE).fullmatch, fields)):
        return [float(int(field, 16)) for field in fields]
    decimal = base == 10 and all(map(_NUMBER.fullmatch, fields))
    return [float(field) for field in fields] if decimal else None


_BESIDE = "\t\r\n\0\x1b\u00a0\u2009\u202f"  # characters of a text that print nothing
_NO_VALUE = (b"ovf", b"nan", b"inf")  # for a number that cannot be said
_LEAST_TEXT = 0.95  # share of printable characters in a text
_FRAMES = re.compile(rb"[,;\t ](frame|sample|scan|step)\W*\d+", re.IGNORECASE)  # names of columns
_NEAR = 10.0  # counts: a pad whose values are as near to 0 as this needs neither a zero nor a larger offset
_ALIKE = 0.1  # of how far columns are apart: lines no further apart than this say the same of the same taxels


@dataclass(frozen=True)
class GuessedLines:
    """Lines of numbers.

    columns: fields in a frame. rows: lines in a frame, with a line of another kind between frames; 1 if every line is
    one. before: what the first fields are: "skip" for what is never a number, "clock" for one that rises steadily or
    says the time since 1970, "index" where it rises by 1. tick_s: s, the clock's unit by its steps or size. decimal:
    the decimal point. odd: a field that is no number where others are, such as "ovf"; "" if there is none. named: the
    names of lines that are parts of a frame, with nothing between two frames, or of columns that are frames. checksum:
    the kind behind a "*"; "" if there is none. read: whether most of these lines are read by the device file. base: 16
    if the numbers are hexadecimal. zero: the typical value. apart: twice as far as nine in ten taxels are from it,
    which is beyond those that are not broken.
    """

    columns: int
    rows: int
    before: tuple[str, ...]
    decimal: str
    odd: str
    tick_s: float = 1e-3
    named: tuple[str, ...] = ()
    checksum: str = ""
    read: bool = False
    base: int = 10
    zero: float = 0.0
    apart: float = 0.0

    def describe(self) -> str:
        """Say what the lines are."""
        numbers = counted(self.columns, "hexadecimal number" if self.base == 16 else "number")
        what = f"lines of {numbers}, a frame each; if they are parts of one, let it print a frame a line"
        if self.rows > 1:
            columns = self.columns // self.rows
            what = f"frames of {self.rows} lines with {columns} numbers, another line between frames"
            what += f"; if each line is a frame, say taxels = {columns}, rows = 1, columns = {columns}"
        befores = {"clock": "a clock, as it rises steadily", "index": "the lines' count", "skip": "no number"}
        before = "".join(f"; field {k} is {befores[name]}" for k, name in enumerate(self.before, 1))
        odd = f"; {self.odd!r} is no number, and a line that says it is left out" if self.odd else ""
        return what + before + odd

    def refusal(self) -> str:
        """Say why no device file reads them, and what the device should print instead."""
        if "index" in self.before and self.named:
            return (
                f"Its columns are frames ({', '.join(self.named[:2])} ...), and its lines a taxel each: `bench import` "
                "reads a folder of such files, a press each, and `bench replay --rate` one, as a pad of so many taxels."
            )
        if self.named:
            return (
                f"The device prints the parts of a frame in lines of their own ({', '.join(self.named[:4])} ...), "
                "which no device file joins. Let it print a frame a line, or bare values and an empty line between two."
            )
        why = f"{self.odd!r} is no number" if self.odd else "a number is beyond what a reading may be"
        if self.tick_s == 1e-9:
            why = "field 1 counts ns since 1970, and us are the finest; or name it in a title, 'time [ns],t0,t1,...'"
        what = f"The device prints lines of {self.columns} fields, which no device file reads: {why}."
        return f"{what} Let it print decimal numbers, for a dead taxel 0."

    def device_file(self) -> str:
        """Write the device file (TOML) that reads them; what a count and a taxel measure, its owner has to say.

        Where values are far from 0, their typical one is its zero: they are taken for those of a pad that is free.
        """
        taxels = self.columns - len(self.before)
        side = math.isqrt(taxels)
        rows = self.rows if self.rows > 1 else side if side * side == taxels else 1
        lines = ['name = "mine"']
        if self.apart > _NEAR:
            apart = "so far apart are untouched taxels: changes with kpa_per_count"
            lines.append(f"largest_offset_kpa = {self.apart:.0f}  # {apart}")
        lines += ["[codec]", 'kind = "csv"', f"taxels = {taxels}"]
        if self.before:
            lines.append(f"before = {list(self.before)}".replace("'", '"'))
        if "clock" in self.before:
            lines.append(f"tick_s = {self.tick_s:g}")
        if self.decimal == ",":
            lines += ['delimiter = ";"', 'decimal = ","']
        if self.base != 10:
            lines.append(f"base = {self.base}")
        if self.checksum:
            lines.append(f'checksum = "{self.checksum}"')
        if abs(self.zero) > _NEAR:
            lines.append(f"zero = {self.zero:.0f}  # what it sends while nothing presses")
        lines += ["kpa_per_count = 1.0  # measure; below 0 where values fall under load", "[pad]"]
        lines += [f"rows = {rows}", f"columns = {taxels // rows}", "no_seam = true", "unread_columns = 0"]
        lines += [
            "pitch_x = 1.9  # mm from one column to the next: measure, as what follows",
            "pitch_y = 1.9",
        ]
        lines += ["taxel_width = 1.8  # mm of a taxel itself", "taxel_height = 1.8", "[[part]]"]
        lines += ['first_row = "bottom"  # or "top"', 'first_column = "right"  # or "left", seen from above']
        return "\n".join(lines)

    def tried(self, data: bytes, whole: float) -> GuessedLines:
        """Read these bytes by the device file, of which `whole` frames are in them: adds read, zero and apart."""
        codec = LinesFormat.model_validate(tomllib.loads(self.device_file())["codec"]).build()
        frames = [arrived.packet.values for arrived in Framer(codec, Counters()).feed(b"\n\n" + data, 0.0)]
        if 2 * len(frames) <= whole:
            return self
        level = np.median(frames, axis=0)
        zero = float(np.median(level))
        return replace(self, read=True, zero=zero, apart=2 * float(np.quantile(np.abs(level - zero), 0.9)))


def is_text(data: bytes) -> bool:
    """Tell whether bytes are printed text, and not frames of another kind or text at a wrong baud rate."""
    known = "".join(char for char in data.decode("utf-8", "ignore") if char.isprintable() or char in _BESIDE)
    return bool(data) and len(known.encode()) >= _LEAST_TEXT * len(data)


def guess_lines(data: bytes) -> GuessedLines | None:
    """Say which lines of numbers these bytes are, the first and last of which may be torn.

    Returns None if most fields are no numbers.
    """
    lines = [line.strip() for line in data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")[1:-1]]
    names = Counter(match[1].decode() for line in lines if (match := FIRST_NAME.match(line)))
    named = tuple(sorted(name for name, count in names.items() if count > 1))
    if any(line.startswith(b"[[") and not line.endswith(b"]]") for line in lines):
        named = ("[[", "]]")  # as NumPy prints a picture
    if (hexadecimal := _of_hexadecimal(lines)) is not None:
        return hexadecimal
    first_line = data.partition(b"\n")[0]
    columns_named = tuple(found[0][1:].decode() for found in _FRAMES.finditer(first_line))
    guesses = []
    for decimal, checksum in product(".,", ("", "xor8")):
        texts = [line.partition(b"*")[0] if checksum else line for line in lines]
        if decimal == "," and not any(b"," in text for text in texts):
            continue
        fields = [split_line(text, decimal) if text.strip(b"\0 ") else [] for text in texts]
        guess = _of_rows(lines, fields, decimal) or _of_lines(fields, decimal)
        if guess is not None:
            guess = replace(guess, checksum=checksum)
            whole = sum(map(bool, fields)) / guess.rows
            columns = guess.columns // guess.rows
            firsts = [[b",".join(row[:n]) for row in fields if len(row) == columns > n] for n in (1, 2)]
            turns = _in_turn(firsts[0])
            parts = named if len(named) > 1 else turns or _in_turn(firsts[1])
            numbered = guess.rows > 2 and turns in [tuple(map(str, range(k, k + guess.rows))) for k in (0, 1)]
            if "index" in guess.before and len(columns_named) > 1:
                guesses.append(replace(guess, named=columns_named))
            elif numbered or (guess.rows == 1 and parts):
                guesses.append(replace(guess, named=turns if numbered else parts))
            else:
                guesses.append(guess.tried(data, whole))
    # A comma between two numbers is no decimal one if both make sense.
    return max(guesses, key=lambda guess: (guess.read, guess.columns), default=None)


def _of_hexadecimal(lines: Sequence[bytes]) -> GuessedLines | None:
    """Find lines of hexadecimal digits without 0x: of one width, or with letters in several columns."""
    rows = [split_line(line) for line in lines if line.strip(b"\0 ")]
    words = {word for row in rows for word in row}
    lettered = {at for row in rows for at, word in enumerate(row) if not word.isdigit()}
    alike = (len({*map(len, words)}) == 1 and len(rows[0][0]) > 1) or len(lettered) > 1
    if not lettered or not alike or not all(re.fullmatch(rb"[0-9a-fA-F]{1,8}", word) for word in words):
        return None
    columns, count = Counter(map(len, rows)).most_common(1)[0]
    return GuessedLines(columns, 1, (), ".", "", base=16, read=2 * count > len(rows))


def _in_turn(first: Sequence[bytes]) -> tuple[str, ...]:
    """List the first fields of lines, words or numbers from 0 or 1 on, that come in turn: 0, 1, 2, 0, 1, 2 ...

    So do row and column where each line is a taxel's.
    """
    names = sorted(set(first))
    in_turn = 1 < len(names) <= len(first) // 5 and first[len(names) :] == first[: -len(names)]
    named = in_turn and (names[0] in (b"0", b"1", b"0,0", b"1,1") or not numbers_in(names[:1]))
    start = first.index(names[0]) if named else len(first)
    return tuple(name.decode("utf-8", "replace") for name in first[start : start + len(names)])


def _of_rows(lines: Sequence[bytes], fields: Sequence[list[bytes]], decimal: str) -> GuessedLines | None:
    """Find frames of two or more rows between lines that are no rows.

    A line of words may also be a note between frames of a line each: so it is where the lines that it parts read alike.
    """
    usual = Counter(map(len, fields)).most_common(1)[0][0] if fields else 0
    ends = [
        at for at, row in enumerate(fields)
        if _parts_frames(row) or (FIRST_NAME.match(lines[at]) and not (len(row) == usual and _valued(row).all()))
    ]  # fmt: skip
    frames = [fields[first + 1 : last] for first, last in pairwise(ends)]
    shapes = Counter((len(frame), len(frame[0])) for frame in frames if len({len(row) for row in frame}) == 1)
    if not shapes:
        return None
    (rows, columns), _ = shapes.most_common(1)[0]
    whole = _of_lines([row for frame in frames for row in frame], decimal)
    titled = any(
        len(fields[at]) == columns > 1 and not any(numbers_in([word]) for word in fields[at]) for at in ends
    )
    if rows < 2 or whole is None or whole.columns != columns or whole.before or titled:
        return None
    numbers = [[numbers_in(row) or [] for row in frame] for frame in frames]
    whole_frames = [frame for frame in numbers if [*map(len, frame)] == [columns] * rows]
    if whole_frames and any(lines[at].upper() != lines[at].lower() for at in ends):
        level = np.median(np.array(whole_frames), axis=0)
        if np.ptp(level, axis=0).max() < _ALIKE * np.ptp(level, axis=1).max():
            return None
    return GuessedLines(rows * columns, rows, (), decimal, whole.odd)


def _valued(fields: list[bytes]) -> NDArray[np.bool_]:
    """Tell which fields of a line are numbers, or stand for one."""
    return np.array([bool(numbers_in([field])) or field.lower() in _NO_VALUE for field in fields])


def _parts_frames(fields: list[bytes]) -> bool:
    """Tell whether a line is empty, or begins with a word, and so is no row that lacks a number."""
    return not fields or not (numbers_in(fields[:1]) or fields[0].lower() in _NO_VALUE)


def _of_lines(fields: Sequence[list[bytes]], decimal: str) -> GuessedLines | None:
    """Find the usual number of fields, most of which are numbers."""
    usual = Counter(len(row) for row in fields if row)
    if not usual:
        return None
    columns, count = usual.most_common(1)[0]
    alike = [row for row in fields if len(row) == columns and any(numbers_in([field]) for field in row)]
    known = np.array([[numbers_in([field]) is not None for field in row] for row in alike])
    if 2 * count < sum(usual.values()) or 2 * known.sum() <= known.size:
        return None
    valued = np.array(list(map(_valued, alike)))
    skipped = min(int(valued.any(axis=0).argmax()), 15)  # a device file names 16 at most
    odd = next((alike[row][column] for row, column in np.argwhere(~known) if column >= skipped), b"")
    before, tick_s = ["skip"] * skipped, 1e-3
    while len(before) < min(columns - 1, max(skipped + 1, 2)):
        times = [(numbers_in([row[len(before)]]) or [np.nan])[0] for row in alike]
        steps, since = np.diff(times), unit_since_1970(times)
        if len(steps) < 3:
            break
        # Stale lines before those of now, and a restart, make one odd step of many.
        least, most = np.quantile(steps, (0.05, 0.95), method="nearest")
        kind = "index" if since is None and least == most == 1 else "clock"
        if kind in before or not (least > 0 and most < 3 * least if since is None else least >= 0):
            break
        before.append(kind)
        if kind == "clock":
            tick_s = since or (1.0 if most < 1 else 1e-3 if most < 1000 else 1e-6)
    return GuessedLines(columns, 1, tuple(before), decimal, odd.decode("utf-8", "replace"), tick_s)
