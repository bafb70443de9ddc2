"""Make a `Scan` of recordings: of guided sessions, and of others with a list of what was pressed when."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, field_validator, model_validator

from tactsim.core.checking import checked
from tactsim.core.documents import SMALL, read_text
from tactsim.core.errors import InputError, short
from tactsim.core.files import opened
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.scan import MOST_TURNED, Scan
from tactsim.core.source import Source, SourceError
from tactsim.hardware import text_tables
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.codecs.codec import STRICT
from tactsim.hardware.press_readings import Moments, PressReadings, Window
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Kind, Whole
from tactsim.hardware.session import Plan, Press, Tare, count_taken, note, parse_mark


@dataclass
class SessionRecord:
    """What the recording of a guided session says.

    readings: how many it has. presses: the marks by number. calibrations: of each segment, and of each tare taken
    within it, from which reading on it corrects, and the calibration or None. segments: the segments' contents.
    """

    path: Path
    plan: Plan
    pad: Pad
    whole: Whole
    readings: int
    presses: dict[int, Press]
    calibrations: list[tuple[int, Calibration | None]]
    segments: list[dict[str, Any]]


def read_session(path: str | Path) -> SessionRecord:
    """Read the recording of a guided session through. Raises InputError if it is none or makes no sense."""
    plan: Plan | None = None
    presses: dict[int, Press] = {}
    calibrations: list[tuple[int, Calibration | None]] = []
    segments: list[dict[str, Any]] = []

    def take(kind: Kind, content: dict[str, Any], readings: int) -> None:
        nonlocal plan
        if kind is Kind.SEGMENT:
            stated = None if content.get("plan") is None else checked(Plan, content["plan"], "plan")
            if segments and stated != plan:
                raise InputError("its segments follow different plans")
            plan = stated
            segments.append(content)
            calibration = content.get("calibration")
            if calibration is not None:
                calibration = checked(Calibration, calibration, "calibration")
            calibrations.append((readings, calibration))
        elif kind is Kind.MARK and plan is not None:
            mark = parse_mark(content, len(plan.poses))
            if mark.first + (0 if isinstance(mark, Tare) else mark.count) > readings:
                raise InputError("mark: it names readings that come after it")
            if isinstance(mark, Tare):
                calibrations.append((mark.first, mark.calibration))
            note(presses, mark)

    replay = Replay(path, corrected=False, on_note=take)
    readings = sum(1 for _ in replay)
    if plan is None:
        raise SourceError(f"{path} is no recording of a guided session; `bench record --letter` makes one")
    return SessionRecord(
        Path(path), plan, replay.pad, replay.whole, readings, presses, calibrations, segments
    )


def scan_of_sessions(
    paths: Sequence[str | Path], moments: Moments | None = None, at_load: float = 1.0
) -> Scan:
    """Make one scan of guided sessions: each press is the mean of its readings.

    Taxels that one of the calibrations leaves out, and those that are wrong while the pad is idle, are left out
    everywhere. moments, at_load: of training and of test presses, as `scan_of_intervals` has them.
    Raises InputError if there is no press in them, their pads differ, two are the same recording, or moments are wanted
    and none is found.
    """
    sessions = [read_session(path) for path in paths]
    first: dict[str, str | Path] = {}
    for path in paths:
        with opened(path) as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
        if content in first:
            raise InputError(f"{path} is the same recording as {first[content]}; give each one once")
        first[content] = path
    pad = sessions[0].pad
    kept = np.ones(pad.taxels, dtype=bool)
    for session in sessions:
        if session.pad != pad:
            raise InputError(f"{session.path} was recorded with another pad than {sessions[0].path}")
        for _, calibration in session.calibrations:
            kept &= True if calibration is None else calibration.kept
    read = PressReadings(pad, pad.taxel_xy[kept], moments, at_load)
    taken = [_taken(session) for session in sessions]
    if not any(taken):
        raise InputError(f"{paths[0]}: no press was recorded yet")
    for session, windows in zip(sessions, taken, strict=True):
        read.take(_corrected(session, kept), windows)
    meta = {
        "source": "recorded",
        "pad": pad.model_dump(mode="json"),
        "versions": {"tactsim": version("tactsim")},
        "recordings": [_about(session) for session in sessions],
        "frame_noise_kpa": float(np.median(read.spreads)) if read.spreads else None,
    }
    return read.scan(meta)


def _taken(session: SessionRecord) -> list[Window]:
    """List the presses that were taken, by number, and which readings of the recording each is."""
    plan = session.plan
    return [
        Window(press.first, press.first + press.count - 1, plan.label, plan.split, plan.poses[number])
        for number, press in sorted(session.presses.items())
        if press.what == "taken"
    ]


def _corrected(session: SessionRecord, kept: NDArray[np.bool_]) -> Iterator[tuple[float, FloatArray]]:
    """Give the readings of a session by number, on the taxels `kept`, each corrected as its segment says."""
    corrections = {
        first: None if calibration is None else Correction(calibration, session.pad)
        for first, calibration in session.calibrations
    }
    correction = None
    for number, reading in enumerate(Replay(session.path, corrected=False)):
        correction = corrections.get(number, correction)
        pressures = reading.pressures if correction is None else correction.whole(reading.pressures)
        yield number, pressures[kept]


def _about(session: SessionRecord) -> dict[str, Any]:
    """Say for a scan's `meta` where a letter's readings come from."""
    first = session.segments[0]
    return {
        "file": session.path.name,
        "label": session.plan.label,
        "device": first.get("device", {}).get("name"),
        "urls": first.get("urls"),
        "started": first.get("started"),
        "finished": session.whole.finished,
        "presses": count_taken(session.presses),
        "skipped": sorted(press.number for press in session.presses.values() if press.what == "skipped"),
        "frames_a_press": session.plan.frames,
        "calibrated": [
            None if calibration is None else calibration.taken.isoformat()
            for _, calibration in session.calibrations
        ],
    }


class PlacedPress(BaseModel):
    """One line of a table of presses: what is pressed where, sensor_in_object; the angle may be `theta_deg`."""

    model_config = STRICT

    label: str = Field(min_length=1, max_length=100)
    split: Literal["train", "test"] = "train"
    x_mm: float
    y_mm: float
    theta_rad: float = Field(description="or theta_deg")

    @field_validator("theta_rad")
    @classmethod
    def _is_in_rad(cls, angle: float) -> float:
        if abs(angle) > MOST_TURNED:
            raise ValueError(f"{angle:g} rad are more than two turns; call a column of degrees theta_deg")
        return angle

    @model_validator(mode="before")
    @classmethod
    def _in_rad(cls, words: dict[str, Any]) -> dict[str, Any]:
        words = {name: word for name, word in words.items() if word != ""}
        if "theta_deg" not in words:
            return words
        if "theta_rad" in words:
            raise ValueError("theta_rad and theta_deg both say the angle; leave one out")
        degrees = words["theta_deg"]
        try:
            angle = math.radians(float(degrees))
        except ValueError:
            raise ValueError(f"theta_deg: give a number, got {short(degrees)}") from None
        return {name: word for name, word in words.items() if name != "theta_deg"} | {"theta_rad": angle}

    @property
    def pose(self) -> tuple[float, float, float]:
        """Give sensor_in_object [mm, mm, rad]."""
        return self.x_mm, self.y_mm, self.theta_rad


class Interval(PlacedPress):
    """One line of a marks file: what was pressed where, from `first_s` to `last_s` of a recording.

    Times count from the recording's first reading, on the device's clock where it has one, else on the host's.
    """

    first_s: float = Field(ge=0)
    last_s: float

    @model_validator(mode="after")
    def _ordered(self) -> Interval:
        if self.last_s < self.first_s:
            raise ValueError(f"last_s {self.last_s:g} is before first_s {self.first_s:g}")
        return self


def read_intervals(path: str | Path) -> list[Interval]:
    """Read a marks file: CSV with the columns label, split, x_mm, y_mm, theta_rad (or theta_deg), first_s, last_s.

    Raises InputError with the line that is wrong.
    """
    return [checked(Interval, row, place) for place, row in named_rows(path, "marks", Interval)]


def named_rows(
    path: str | Path,
    what: str,
    kind: type[PlacedPress],
    most: int = SMALL,
    called: Mapping[str, str] | None = None,
) -> Iterator[tuple[str, dict[str, str]]]:
    """Read a table of presses: where each row stands, and its words by name. Raises InputError.

    The line of names is the one of the first 40 that has the most names of `kind`, in capitals or not. What stands
    above it is left out, and so are lines that begin with #, and empty rows. called: what names of `kind` are called
    in the table, where otherwise.
    """
    lines = read_text(path, what, most).splitlines()
    known = {name.lower(): name for name in (*kind.model_fields, "theta_deg")}
    known |= {theirs.lower(): name for name, theirs in (called or {}).items()}
    titles = (text_tables.title_cells(line) for line in lines[: text_tables.TITLE_WITHIN])
    heads = [[known.get(cell.lower(), cell) for cell in cells] for cells in titles]
    names = max(heads, key=lambda head: len({*head}.intersection(known.values())), default=[])
    if called and not {*names}.intersection(known.values()):
        raise InputError(f"{path}: no line names a column {' or '.join(map(repr, called.values()))}")
    if not {*names}.intersection(known.values()):
        also = "; of a recording `bench replay --marks` makes presses" if what == "presses" else ""
        raise InputError(f"{path}: no line names its columns, which are {', '.join(known.values())}{also}")
    for name, theirs in (called or {}).items():
        if name not in names:
            raise InputError(
                f"{path}: no column is called {theirs!r}; there are {short(', '.join(filter(None, names)))}"
            )
    above = heads.index(names) + 1
    separator = text_tables.separator_of(lines[above - 1])
    below = ("" if line[:1] == "#" else line for line in lines[above:])
    rows = list(text_tables.cells_of(below, separator, path))
    for name in filter(None, names):
        if names.count(name) > 1:
            raise InputError(f"{path}: two columns are called {name!r}")
    words = [at for at, name in enumerate(names) if name in ("label", "split")]
    taxels = [at for at, name in enumerate(names) if name not in known.values()]
    others = [at for at in range(len(names)) if at not in (*words, *taxels)]

    def cells(columns: list[int]) -> Iterator[str]:
        return (row[at] for _, row in rows for at in columns if at < len(row))

    commas = text_tables.has_decimal_commas(cells(others), separator)
    try:
        thousands = text_tables.thousands_mark(cells(taxels), commas) or ""
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    commas = commas or (not thousands and text_tables.has_decimal_commas(cells(taxels), separator))
    if not any(row for _, row in rows):
        raise InputError(f"{path} holds no {what}: there is no row below the names {', '.join(names)}")
    for number, row in rows:
        where = f"{path}, line {above + number}"
        if any(row[len(names) :]):
            raise InputError(f"{where}: it has more columns than the title {short(lines[above - 1])}")
        if row:
            whole = [cell.replace(thousands, "") if at in taxels else cell for at, cell in enumerate(row)]
            pointed = text_tables.with_points(whole, separator, commas)
            named = {
                name: row[at] if at in words else pointed[at] for at, name in enumerate(names[: len(row)])
            }
            yield where, {name: word for name, word in named.items() if name}


def scan_of_intervals(
    source: Source, intervals: Sequence[Interval], moments: Moments | None = None, at_load: float = 1.0
) -> Scan:
    """Make a scan of a recording without guidance: the mean of the readings in each interval.

    moments: how many of each training press, at even shares of its load up to the plateau, as further readings at its
    pose; "auto" as `with_moments` has it, and "found" the same where there is a rise, else none. at_load: the share of
    their load at which test presses are read; one that does not show it is left out. The plateau is found within the
    interval, the rise in what was read since the interval before; then the plateau's median is the press's reading.
    Taxels that are stuck or always loaded while nothing presses are left out: `meta["left_out"]` says which, numbered
    as on the whole pad, and why.

    Raises InputError if an interval holds no reading, ends behind the last one, a link was lost within it, or moments
    are wanted and no press has any.
    """
    read, times = PressReadings(source.pad, source.taxel_xy, moments, at_load), list[float]()
    windows = [Window(each.first_s, each.last_s, each.label, each.split, each.pose) for each in intervals]
    empty = read.take(_timed(source, intervals, times), windows)
    _check_within(intervals, times)
    for window in empty:
        raise InputError(f"no reading lies between {window.first:g} and {window.last:g} s ({window.label})")
    meta = {
        "source": "recorded",
        "pad": source.pad.model_dump(mode="json"),
        "versions": {"tactsim": version("tactsim")},
        **({} if source.unit == "kPa" else {"unit": source.unit}),
    }
    return read.scan(meta)


def _timed(
    source: Source, intervals: Sequence[Interval], times: list[float]
) -> Iterator[tuple[float, FloatArray]]:
    """Give the readings of a recording by their times, s from the first, which `times` collects.

    Raises InputError if a link was lost within an interval.
    """
    begin = 0.0
    for reading in source:
        time = reading.host_time if reading.device_time is None else reading.device_time
        begin = begin if times else time
        times.append(time - begin)
        if reading.after_loss and len(times) > 1:
            for each in intervals:
                if each.first_s <= times[-2] and times[-1] <= each.last_s:
                    raise InputError(
                        f"the pad was lost between {each.first_s:g} and {each.last_s:g} s ({each.label}): what was "
                        "pressed before and after it is not one press"
                    )
        yield times[-1], reading.pressures


def _check_within(intervals: Sequence[Interval], times: Sequence[float]) -> None:
    """Raise InputError if an interval ends more than one reading behind the last of the readings at `times`, s."""
    if not times:
        raise InputError("the recording holds no reading: nothing in it is a frame of the device file")
    end = times[-1]
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    late = max(intervals, key=lambda each: each.last_s)
    if late.last_s > end + max(step, 0.0) + 1e-9:
        count = (
            "in s from the first reading"
            if any(times[1:])
            else "by a clock, and the recording states none (--rate HZ)"
        )
        raise InputError(
            f"the recording ends at {end:g} s, but a mark ({late.label}) goes on until {late.last_s:g} s; times count "
            f"{count}"
        )
