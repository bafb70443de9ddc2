"""`pps-csv`: the recording that the vendor's demonstration tool writes, and what spreadsheets make of it.

A title line `Time [ms], Elem0, Elem1, ...`, then one line a frame: `0, 0.11, 0.02, ...`, or another table of text with
a time, as `text_tables` has them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from itertools import islice
from statistics import mode
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.finite import LARGEST
from tactsim.core.idle import failed_cells, flickering, mending, unwrapped
from tactsim.core.poses import FloatArray
from tactsim.hardware import text_tables
from tactsim.hardware.codecs.codec import CodecError, CodecFormat, Frame
from tactsim.hardware.codecs.lines import LinesCodec, LinesFormat

_KPA = {"kPa": 1.0, "psi": 6.894757293168361, "Pa": 1e-3}  # 1 psi = 1 lbf/in^2
_WORD = re.compile(r"(?:[A-Z]?[a-zµμ\ufffd]+|[A-Z]+)(?![a-zµμ\ufffd\d])")
_TIMES = {
    *("time", "timestamp", "datetime", "elapsed", "t", "seconds"),
    *("millis", "micros", "milli", "micro", "msec", "usec"),
    *("zeit", "uhrzeit", "zeitstempel", "temps", "heure", "tiempo", "hora", "tempo", "tijd"),
}
_OF_DAY = re.compile(r"\d:\d\d:\d\d")
# Of a date that is not in ISO 8601 nobody knows the month; the time of day is enough.
_CLOCK = re.compile(
    r"(?!\d{4}-\d\d-\d\d)(?:[\w/.,-]+ ){0,5}"
    r"(\d+):([0-5]\d):([0-5]\d(?:[.,]\d+|:\d{3})?)(?: ?([AaPp])[Mm]|Z)?"
)
_BELOW_S = re.compile(r":\d\d:\d\d[.,:](\d{1,3})\b")  # digits behind the second of a time of day
_GLUED = re.compile(r"(20\d\d[01]\d[0-3]\d[0-2]|0)\d[0-5]\d[0-5]\d(\.\d+|(?<=\d{14})\d{3})?")
_DAY = 86_400.0  # s
# Units of time as people write them, once blanks, points and case are gone: `mSec`, `Milli Sec.`, `µs`.
_SECOND = "(?:s|secs?|seconds?|secondes?|secondi|segundos?|seconden|sek|sekunden?)"
_UNITS = {
    f"{_SECOND}": 1.0,
    f"(?:m|milli){_SECOND}|millis": 1e-3,
    f"(?:[uµμ]|micro){_SECOND}|micros": 1e-6,  # micro sign, and the Greek letter
    f"(?:n|nano){_SECOND}": 1e-9,
    "mins?|minutes?": 60.0,
    "h|hrs?|hours?": 3600.0,
    "days?": _DAY,
}
_TIME_WORD = re.compile(r"(?:datetime|timestamp|time|elapsed|x_value|t(?![a-z]))[^a-zµμ]*", re.IGNORECASE)
_LATEST = 4e9  # s since 1970, in 2096
_SINCE_1970 = 1e6  # s: more than any recording is long; from there on a clock tells the date
# Below which median step a time is in that unit.
_BY_STEP = ((1e-5, "days", _DAY), (1, "s", 1.0), (1e3, "ms", 1e-3), (1e6, "us", 1e-6))
# After which clocks begin anew: at the end of their bits, perhaps in us or ms, of a minute, a second, half a day or an
# hour, by which clocks on the wall are put back in autumn.
_ROUNDS = (
    *(2.0**bits for bits in (8, 10, 12, 15, 16, 32)),
    2.0**32 / 1e3,
    2.0**32 / 1e6,
    *(60.0, 1e3, 1e6, 3600.0, 43_200.0),
)
_BY_CHANCE = 7.0  # log of the odds that a clock which began anew looks as if it had gone round
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


def read_table(texts: Iterable[str], unit: str = "") -> tuple[list[str], Iterator[Frame | str], str | None]:
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
    separator, time = text_tables.separator_of(head[line]), _time_at(titles[line])
    samples = [*head[line + 1 :], *texts]
    cells_of_lines = [cells for _, cells in text_tables.cells_of(samples, separator)]
    of_taxels = [cell for cells in cells_of_lines for at, cell in enumerate(cells) if at != time]
    thousands = text_tables.thousands_mark(of_taxels, unit=unit) or ""
    of_times = [cells[time] for cells in cells_of_lines if len(cells) > time]
    of_hours = text_tables.thousands_mark(of_times) or ""  # 1,040 ms
    if of_times and all(map(_GLUED.fullmatch, of_times)):
        raise CodecError(f"times such as {of_times[0]} have no marks within: write hours as in 12:00:01.5")
    parts = [found[1] for cell in of_times if (found := _BELOW_S.search(cell))]
    if len({*map(len, parts)}) > 1 and any(part[1:].endswith("0") for part in parts):
        raise CodecError(f"times end in {parts[0]} and {max(parts, key=len)}: write 40 ms as .040, not .40")
    decimals = ([] if of_hours else of_times) + [cell.replace(thousands, "") for cell in of_taxels]
    commas = text_tables.has_decimal_commas(decimals, separator)
    titles[line] = _with_units(titles[line], cells_of_lines[0] if cells_of_lines else [], time)
    for column in range(time):
        of_boards = {(cells[column], cells[time]) for cells in cells_of_lines if len(cells) > time}
        boards = sorted({board for board, _ in of_boards} - {titles[line][column]})
        if 1 < len(boards) < 20 and 2 * len(of_boards) > 3 * len({*of_times}):
            raise CodecError(
                f"column {titles[line][column]!r} says {', '.join(boards[:3])} at the same times: lines of several "
                "boards; write a file for each"
            )

    def numbers(text: str) -> FloatArray | None:
        """Read the time and the taxels of a frame; None if a cell is no number, or the time is NaN."""
        try:
            ((_, cells),) = text_tables.cells_of([text], separator)
            cells = cells[time:] + cells[:time] * (len(cells) == time + 1)
            filled = [
                cells[0].replace(of_hours, ""),
                *(cell.replace(thousands, "") or "nan" for cell in cells[1:]),
            ]
            first, *others = text_tables.with_points(filled, separator, commas)
            row = np.array(
                [
                    _of_day(first) if _OF_DAY.search(first) else float(first),
                    *map(text_tables.number_of, others),
                ]
            )
        except (ValueError, IndexError):  # a line that ends before the time
            return None
        # A clock since 1970 in ns is larger than any reading may be.
        return row if np.isfinite(row[0]) and not (np.abs(row[1:]) > LARGEST).any() else None

    parsed = [numbers(text) for text in samples]
    rows = [row for row in parsed if row is not None]
    width = mode(map(len, rows)) if rows else 0  # a line may be cut short, also the first
    if width < 2:
        read = "a time is a number, hh:mm:ss or a date of ISO 8601, and what is behind it numbers up to 1e9"
        but = f", but {samples[0].strip()[:60]!r}; {read}" if samples else ""
        raise CodecError(f"behind the title {head[line].strip()[:60]!r} stands no line of readings{but}")
    names = [*(titles[line][time + 1 :] or titles[line][:time]), *[""] * width][: width - 1]
    whole = np.array([row for row in rows if len(row) == width])
    stored = whole[:, 1:].copy()
    whole[:, 1:], wrapped = unwrapped(stored)
    whole[:, 1:][:, flickering(whole[:, 1:])] = np.nan
    whole[:, 0], rounds = _past_rounds(whole[:, 0])
    dead = np.isnan(whole).all(axis=0)
    if dead[1:].all():
        raise CodecError(f"behind the title {head[line].strip()[:60]!r} every number is NaN")
    for row, mended in zip((row for row in rows if len(row) == width), whole, strict=True):
        row[:] = mended
    failed = np.asarray(failed_cells(whole[:, 1:]).any(axis=1))
    clock = whole[:, 0].tolist()
    of_day = any(_OF_DAY.search(text) for text, row in zip(samples, parsed, strict=True) if row is not None)
    tick, remark = (1.0, None) if of_day else _tick(titles[line][time], clock)
    again_from_0 = f"the clock goes round {rounds} times: they go on from there"
    remarks = [*filter(None, [remark]), *([again_from_0] if rounds else [])]
    if dead.any():
        lost = ", ".join(map(str, np.flatnonzero(dead[1:])))
        said = "no number in every line, or failed in many, counts as 0: never pressed"
        remarks.insert(0, f"taxel {lost}: {said}")
    if wrapped:
        remarks.insert(0, mending(stored, wrapped))
    if failed.any():
        lines = f"{failed.sum():,} of {len(failed):,} lines"
        remarks.insert(0, f"{lines} have a failed cell, as 65535 is, and are left out")
    begun = clock[0] * tick if of_day or clock[0] * tick >= _SINCE_1970 else 0.0

    def frames() -> Iterator[Frame | str]:
        """Give the frames as they stand in the file."""
        last, failing = 0.0, iter(failed)
        for text, row in zip(samples, parsed, strict=True):
            if row is None or len(row) != width or next(failing) or (np.isnan(row) != dead).any():
                yield text
            else:
                row[dead] = 0
                seconds = float(row[0] * tick - begun)
                if of_day and clock[0] < _SINCE_1970:  # no date stands before it
                    seconds += _DAY * round((last - seconds) / _DAY)
                last = seconds
                yield Frame(row[1:], ticks=seconds)

    every = list(frames())
    times = np.array([frame.ticks for frame in every if isinstance(frame, Frame)])
    if len(times) > 1 and times.min() == times.max():
        raise CodecError(
            f"all {len(times)} lines have one time, {clock[0]:g}: it does not say when a press was; write their times"
        )
    again = int((np.diff(times) == 0).sum())
    if 2 * again > len(times):
        said = f"{again} of {len(times)} lines have the time of the line before: the clock is coarser than the lines"
        remarks.append(said)
    order = _order(times)
    if order is not None:
        placed = [frame for frame in every if isinstance(frame, Frame)]
        moved = int((order != np.arange(len(order))).sum())
        said = f"{moved} of {len(order)} lines are not in the order of their times, and were put there"
        remarks.append(said)
        every = [*(placed[k] for k in order), *(text for text in every if isinstance(text, str))]
    return names, iter(every), "; ".join(remarks) or None


def _past_rounds(clock: FloatArray) -> tuple[FloatArray, int]:
    """Let a clock (n,) that goes round begin no more at 0 again, and count that; of few lines a round several times."""
    steps = np.diff(clock)
    down = steps < 0
    for most in _ROUNDS if down.any() else ():
        over, usual = steps[down] + most, float(np.median(steps % most))  # more lines may go round than not
        often = len(over) * math.log(most / usual) > _BY_CHANCE if 0 < usual < most else False
        alike = np.ptp(clock) < most and np.abs(over - usual).max() <= min(usual, most - usual) / 2
        if (often and alike) or (200 * usual < most and over.min() >= 0 and over.max() <= 3 * usual):
            return clock + most * np.concatenate([[0], np.cumsum(down)]), int(down.sum())
    return clock, 0


def _order(times: FloatArray) -> NDArray[np.intp] | None:
    """Tell in which order lines come by their times (n,), s; None if they stand in it, or if a clock began anew.

    A clock that began anew goes through times again that have been: then two times lie nearer than lines do. Lines that
    were written late, or the newest first, fill the gaps between others.
    """
    steps = np.diff(times)
    if not (steps < 0).any():
        return None
    order = np.argsort(times, kind="stable")
    # A clock begins anew seldom; else lines are shuffled, and their steps are of any size.
    anew = 10 * (steps < 0).sum() < len(steps)
    usual = np.median(np.abs(steps[steps != 0]) if anew else np.diff(times[order]))
    near = (np.diff(times[order]) < usual / 4).sum() > (np.abs(steps) < usual / 4).sum()
    return None if near else order


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
        moment = datetime.fromisoformat(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    hours, minutes, seconds, half = found.groups()
    hour = int(hours) if half is None else int(hours) % 12 + 12 * (half in "Pp")
    return 3600 * hour + 60 * int(minutes) + float(re.sub("[,:]", ".", seconds))


def _with_units(title: Sequence[str], below: Sequence[str], time: int) -> list[str]:
    """Write the units of a line below the title into it, where that line says one of time and no number."""
    units = [unit.strip("[]() ") for unit in below]
    known = len(units) > time and any(re.fullmatch(form, units[time].lower()) for form in _UNITS)
    if not known or any(character.isdigit() for character in "".join(units)):
        return [*title]
    units += [""] * len(title)  # empty cells at the end of a line are gone
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(title, units, strict=False)]


def _tick(title: str, times: Sequence[float]) -> tuple[float, str | None]:
    """Give the s of one unit of time: of its title's, or by the median step, and then a remark that says so."""
    bracketed = re.search(r"[\[(]([^\])]*)[\])]", title)
    inside = bracketed[1] if bracketed else ""
    behind = _TIME_WORD.sub("", title.replace(f"{bracketed[0]}" if bracketed else "\0", ""))
    if re.search(r"\d", inside):
        raise CodecError(f"the title's unit of time is {inside.strip()!r}; write the times in s, ms or us")
    since = text_tables.unit_since_1970(times)
    if times and 1.2e17 < min(times) < 7e17:
        raise CodecError(f"times such as {times[0]:.0f} count 100 ns, as Windows does; write them in s or ms")
    steps = np.abs(np.diff(times))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    for text in (inside, behind, *re.split(r"[\W_]+", behind)):
        unit = re.sub(r"[^\w\ufffd]|[\d_]", "", text).lower()  # a mark for what the encoding lost stays
        found = next((seconds for form, seconds in _UNITS.items() if re.fullmatch(form, unit)), None)
        if found is not None:
            if since is not None and found * max(times) > _LATEST:
                raise CodecError(
                    f"the title {title!r} and {max(times):g}, which is a time since 1970 in other units, differ"
                )
            seldom = f"a line every {step * found:g} s, as {title!r} says: is it another unit?"
            return found, None if 1e-4 <= step * found <= 10 else seldom
    if re.fullmatch(r"\s*\w+\s*", inside):
        raise CodecError(
            f"the title's unit of time is {inside.strip()!r}; known are s, ms, us, ns, min, h, days"
        )
    if since is not None:
        names = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
        return since, f"the time is read as {names[since]} since 1970, by its size"
    unit, seconds = next(((unit, seconds) for most, unit, seconds in _BY_STEP if step < most), ("ns", 1e-9))
    remark = f"the time is read as {unit}, by its steps of {step:g}: a title like 'time [s]' says it outright"
    return seconds, remark
