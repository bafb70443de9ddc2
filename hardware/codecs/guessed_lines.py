"""Guess from what a device prints which lines those are, for an owner who has no device file yet."""

from __future__ import annotations

import math
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from tactsim.core.counters import Counters
from tactsim.core.errors import counted
from tactsim.hardware.codecs.lines import FIRST_NAME, LinesFormat, numbers_in, split_line
from tactsim.hardware.framing import Framer

_BESIDE = "\t\r\n\0\x1b"  # characters of a text that print nothing
_NO_VALUE = (b"ovf", b"nan", b"inf")  # for a number that cannot be said
_LEAST_TEXT = 0.95  # share of printable characters in a text
_ALIKE = 0.1  # of how far columns are apart: lines no further apart than this say the same of the same taxels


@dataclass(frozen=True)
class GuessedLines:
    """Lines of numbers.

    columns: fields in a frame. rows: lines in a frame, with a line of another kind between frames; 1 if every line is
    one. before: what the first fields are: "skip" for what is never a number, "clock" for one that rises
    steadily, "index" where it rises by 1. tick_s: s, the clock's unit by its steps. decimal: the decimal point. odd: a
    field that is no number where others are, such as "ovf"; "" if there is none. named: the names of lines that are
    parts of a frame, with nothing between two frames. checksum: the kind behind a "*"; "" if there is none. read:
    whether most of these lines are read by the device file.
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

    def describe(self) -> str:
        """Say what the lines are."""
        numbers = counted(self.columns, "number")
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
        if self.named:
            return (
                f"The device prints the parts of a frame in lines of their own ({', '.join(self.named[:4])} ...), "
                "which no device file joins. Let it print a frame a line, or bare values and an empty line between two."
            )
        why = f"{self.odd!r} is no number" if self.odd else "a number is beyond what a reading may be"
        what = f"The device prints lines of {self.columns} fields, which no device file reads: {why}."
        return f"{what} Let it print decimal numbers, for a dead taxel 0."

    def device_file(self) -> str:
        """Write the device file (TOML) that reads them; what a count and a taxel measure, its owner has to say."""
        taxels = self.columns - len(self.before)
        side = math.isqrt(taxels)
        rows = self.rows if self.rows > 1 else side if side * side == taxels else 1
        lines = ['name = "mine"', "[codec]", 'kind = "csv"', f"taxels = {taxels}"]
        if self.before:
            lines.append(f"before = {list(self.before)}".replace("'", '"'))
        if "clock" in self.before:
            lines.append(f"tick_s = {self.tick_s:g}")
        if self.decimal == ",":
            lines += ['delimiter = ";"', 'decimal = ","']
        if self.checksum:
            lines.append(f'checksum = "{self.checksum}"')
        lines += ["kpa_per_count = 1.0  # measure, this and what follows", "[pad]", f"rows = {rows}"]
        lines += [f"columns = {taxels // rows}", "no_seam = true", "unread_columns = 0"]
        return "\n".join(lines)

    def frames(self, data: bytes) -> int:
        """Count the frames that the device file reads of these bytes."""
        codec = LinesFormat.model_validate(tomllib.loads(self.device_file())["codec"]).build()
        return len(Framer(codec, Counters()).feed(b"\n\n" + data, 0.0))


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
    guesses = []
    for decimal, checksum in product(".,", ("", "xor8")):
        texts = [line.partition(b"*")[0] if checksum else line for line in lines]
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
            if numbered or (guess.rows == 1 and parts):
                guesses.append(replace(guess, named=turns if numbered else parts))
            else:
                guesses.append(replace(guess, read=2 * guess.frames(data) > whole))
    # A comma between two numbers is no decimal one if both make sense.
    return max(guesses, key=lambda guess: (guess.read, guess.columns), default=None)


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
        steps = np.diff([(numbers_in([row[len(before)]]) or [np.nan])[0] for row in alike])
        kind = "index" if (steps == 1).all() else "clock"
        if kind in before or len(steps) < 3 or not (steps > 0).all() or steps.max() >= 3 * steps.min():
            break
        before.append(kind)
        if kind == "clock":
            tick_s = 1.0 if steps.max() < 1 else 1e-3 if steps.max() < 1000 else 1e-6
    return GuessedLines(columns, 1, tuple(before), decimal, odd.decode("utf-8", "replace"), tick_s)
