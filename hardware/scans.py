"""Make a `Scan` of recordings: of guided sessions, and of others with a list of what was pressed when."""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, field_validator, model_validator

from tactsim.core.checking import checked
from tactsim.core.documents import SMALL, read_text
from tactsim.core.errors import InputError, short
from tactsim.core.files import opened
from tactsim.core.making import check_pose_units
from tactsim.core.moments import moments_of, plateau, shares_of
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import NO_POSES, poses_unknown
from tactsim.core.scan import MOST_TURNED, Scan
from tactsim.core.source import Source, SourceError
from tactsim.hardware import text_tables
from tactsim.hardware.calibration import LEAST_FRAMES, Calibration, Correction, find_stuck
from tactsim.hardware.codecs.codec import STRICT
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Kind, Whole
from tactsim.hardware.session import Plan, Press, Tare, count_taken, note, parse_mark

Moments = int | Literal["auto", "found"]

# Readings that are remembered: of what came since the last press, and of the idle pad.
_SINCE, _IDLE = 20_000, 2000
# A pad is idle while less than this share of a press is felt, above the least that is felt.
_RESTING = 0.1
# A taxel that seldom reads less than this share of the highest of a press, also in an idle pad, is always loaded.
_LOADED, _SELDOM = 0.25, 0.1
# More than this share of the taxels are not always loaded: then the pad has no tare.
_MOST_LOADED = 0.25


class Window(NamedTuple):
    """What was pressed, and the first and the last place of the press in its recording, such as times or numbers."""

    first: float
    last: float
    label: str
    split: str
    pose: tuple[float, float, float]


class _Row(NamedTuple):
    """A reading of the scan. press: a number of its own. share: of the press's load. image: (taxels,)."""

    press: int
    share: float
    image: FloatArray
    window: Window


@dataclass
class PressReadings:
    """Collects the presses of recordings, their moments, and the taxels that are wrong in one of them.

    moments: how many of each training press are wanted, "auto", or "found": auto, and none where no press shows a rise.
    at_load: the share of their load at which test presses are taken. spreads: of each press with several readings their
    standard deviation, (taxels,).
    """

    pad: Pad
    taxel_xy: FloatArray
    moments: Moments | None = None
    at_load: float = 1.0
    spreads: list[FloatArray] = field(default_factory=list)
    _rows: list[_Row] = field(default_factory=list)
    _wrong: dict[int, str] = field(default_factory=dict)
    _presses: int = 0
    _tests: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        if not 0 < self.at_load <= 1:
            raise InputError(
                f"test presses are asked for at {self.at_load:g} of their load; give a share above 0, at most 1"
            )
        count = "auto" if self.moments == "found" else self.moments
        self._of_training = np.ones(1) if count is None else shares_of(count)
        self._shares = np.union1d(self._of_training, self.at_load)  # at which images are wanted

    def take(self, readings: Iterable[tuple[float, FloatArray]], windows: Sequence[Window]) -> list[Window]:
        """Take in a recording: its readings (place, pressures (taxels,)), places rising, and what was pressed in it.

        A press's reading is the mean of those in its window. A test press that does not show the share of its load that
        is asked for is left out. Returns the windows without a reading.
        """
        idle = _IdleReadings()
        means: dict[int, FloatArray] = {}
        moments: dict[int, tuple[NDArray[np.bool_], FloatArray]] = {}
        for number, before, held in _presses_of(readings, windows, idle):
            means[number] = held.mean(axis=0)
            if len(held) > 1:
                self.spreads.append(held.std(axis=0, ddof=1))
            if self._shares[0] < 1:
                found, images = _on_the_way(before, held, self._shares)
                if found.any():
                    moments[number] = found, images
        wanted = {"train": self._of_training, "test": np.array([self.at_load])}
        # A rise is an image below the whole load that training asks for.
        lower = np.isin(self._shares, self._of_training) & (self._shares < 1)
        if self.moments == "found" and not any(found[lower].any() for found, _ in moments.values()):
            wanted = {"test": wanted["test"]} if self.at_load < 1 else {}
        for number in sorted(means):
            window, of_press = windows[number], list[tuple[float, FloatArray]]()
            self._tests[window.label] += window.split == "test"
            if window.split in wanted and number in moments:
                found, images = moments[number]
                chosen = found & np.isin(self._shares, wanted[window.split])
                of_press = list(zip(self._shares[chosen].tolist(), images[chosen], strict=True))
            elif window.split == "train" or self.at_load == 1:
                of_press = [(1.0, means[number])]
            self._rows += [_Row(self._presses, share, image, window) for share, image in of_press]
            self._presses += bool(of_press)
        if means:
            self._wrong |= wrong_taxels(idle.rows, np.array(list(means.values())))
        return [window for number, window in enumerate(windows) if number not in means]

    def scan(self, meta: dict[str, Any]) -> Scan:
        """Make the scan, without the taxels that are wrong.

        Raises InputError if no taxel is left, or moments or a lower load are wanted and none is found.
        """
        kept = np.setdiff1d(np.arange(len(self.taxel_xy)), list(self._wrong))
        if not len(kept):
            raise InputError(
                "every taxel is stuck or always loaded in one of the recordings; nothing is left to read"
            )
        if self._wrong:
            of_pad = [int(np.abs(self.pad.taxel_xy - xy).sum(axis=1).argmin()) for xy in self.taxel_xy]
            left_out = {str(of_pad[taxel]): why for taxel, why in sorted(self._wrong.items())}
            meta = {**meta, "left_out": left_out}
        rows = self._rows
        if self.moments in ("auto", "found"):
            rows = _without_seldom_shares(rows)
        if self.moments is not None:
            lower = [row for row in rows if row.window.split == "train" and row.share < 1]
            if lower:
                shares = sorted({row.share for row in rows if row.window.split == "train"})
                presses = len({row.press for row in lower})
                told = {"shares": shares, "of": "felt", "split": "train", "presses": presses}
                meta = {**meta, "moments": told}
            elif self.moments != "found":
                raise InputError(
                    "no press of the recording shows a plateau and images on the way there, so there are no moments to "
                    "take; record whole presses with more images a second, or leave out --moments"
                )
        if self.at_load < 1:
            if all(row.window.split == "train" for row in rows):
                raise InputError(
                    f"no test press shows {self.at_load:.0%} of its load on the way to a plateau; record whole presses "
                    "with more images a second, or leave out --at-load"
                )
            tests = {(row.window.label, row.press) for row in rows if row.window.split == "test"}
            shown = Counter(label for label, _ in tests)
            missing = {label: [count - shown[label], count] for label, count in sorted(self._tests.items())}
            told = {label: counts for label, counts in missing.items() if counts[0]}
            meta = {**meta, "test_load": self.at_load, "test_load_missing": told}
        apart = any(row.share < 1 for row in rows)
        numbered = apart or poses_unknown(meta)
        poses = np.array([row.window.pose for row in rows])
        check_pose_units(poses, self.taxel_xy)
        return Scan(
            np.array([row.image for row in rows])[:, kept],
            poses,
            np.array([row.window.label for row in rows]),
            np.array([row.window.split for row in rows]),
            self.taxel_xy[kept],
            meta,
            presses=np.array([row.press for row in rows]) if numbered else None,
            moments=np.array([row.share for row in rows]) if apart else None,
        )


def wrong_taxels(idle: Sequence[FloatArray], presses: FloatArray) -> dict[int, str]:
    """Find the taxels that are wrong while nothing presses: {number: why}.

    idle: readings (taxels,) between presses. presses: (n, taxels) the readings of the presses. A taxel is stuck if it
    never changes, neither idle nor pressed, though the others do; it is always loaded if it reads a quarter of the
    highest taxel of a press nearly always, while the pad is idle and in presses: not where a long light touch only was
    taken for an idle pad. Without 40 idle readings nothing is known of any. Raises InputError if none ever changes.
    """
    rested = np.array(idle).reshape(-1, presses.shape[1])
    felt = rested.sum(axis=1)
    if len(rested) >= LEAST_FRAMES:
        least = np.quantile(felt, 0.05)
        rested = rested[felt <= least + _RESTING * max(float(np.median(presses.sum(axis=1))) - least, 0.0)]
    if len(rested) < LEAST_FRAMES:
        return {}
    level = np.median(rested, axis=0)
    if (rested == level).all() and (presses == level).all():
        raise InputError("every taxel of the recording is stuck: none changes when something presses")
    zero = float(np.median(level))
    wrong = {
        int(taxel): f"stuck at {level[taxel]:.4g}"
        for taxel in find_stuck(rested)
        if (presses[:, taxel] == level[taxel]).all()
    }
    highest = float(np.median(presses.max(axis=1))) - zero
    least_of = [np.quantile(np.abs(readings - zero), _SELDOM, axis=0) for readings in (rested, presses)]
    loaded = np.flatnonzero(np.min(least_of, axis=0) > _LOADED * highest)
    if highest > 0 and len(loaded) <= _MOST_LOADED * len(level):
        for taxel in loaded.tolist():
            wrong.setdefault(taxel, f"always loaded: it reads {level[taxel]:.4g} while nothing presses")
    return wrong


@dataclass
class _IdleReadings:
    """Evenly some of the readings of an idle pad, at most 2,000. rows: (taxels,) each."""

    rows: list[FloatArray] = field(default_factory=list)
    _every: int = 1
    _seen: int = 0

    def add(self, pressures: FloatArray) -> None:
        """Take in one more."""
        if self._seen % self._every == 0:
            self.rows.append(pressures)
            if len(self.rows) > _IDLE:
                self.rows, self._every = self.rows[::2], 2 * self._every
        self._seen += 1


def _presses_of(
    readings: Iterable[tuple[float, FloatArray]], windows: Sequence[Window], idle: _IdleReadings
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Split readings (place, pressures) into presses, one after the other.

    Gives of each the number of its window, what was read since the press before, (k, taxels), and within it, (m,
    taxels); `idle` takes what lies in none. Nothing is given of a window without a reading.
    """
    coming = deque(sorted(range(len(windows)), key=lambda number: windows[number]))
    before: deque[FloatArray] = deque(maxlen=_SINCE)
    held: list[tuple[float, FloatArray]] = []
    for place, pressures in chain(readings, [(np.inf, np.zeros(0))]):
        while coming and windows[coming[0]].last < place:
            number = coming.popleft()
            own = [values for at, values in held if at <= windows[number].last]
            if own:
                yield number, np.array(before).reshape(-1, len(own[0])), np.array(own)
            before.clear()
            # What two windows have in common is read in both.
            held = [one for one in held if coming and windows[coming[0]].first <= one[0]]
        if np.isinf(place):
            return
        values = np.array(pressures, dtype=float)
        if coming and windows[coming[0]].first <= place:
            held.append((place, values))
        else:
            before.append(values)
            idle.add(values)


def _on_the_way(
    before: FloatArray, held: FloatArray, shares: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Find the moments of a press in what was read before it and within it, of its own rise alone; see `moments_of`."""
    images = np.concatenate([before, held])
    felt = images.sum(axis=1)
    load = felt - np.quantile(felt, 0.05)
    still = plateau(load[len(before) :])
    if still is None:
        return np.zeros(len(shares), dtype=bool), np.zeros((len(shares), images.shape[1]))
    begin = len(before) + still.start
    light = np.flatnonzero(load[:begin] <= _RESTING * np.median(load[len(before) :][still]))
    own = slice(int(light[-1]) if len(light) else 0, None)
    return moments_of(images[own], shares, load[own])


def _without_seldom_shares(rows: Sequence[_Row]) -> list[_Row]:
    """Leave out training readings at a share of the load that fewer than half as many presses show as any other."""
    counts = Counter(row.share for row in rows if row.window.split == "train" and row.share < 1)
    seldom = {share for share, count in counts.items() if count < max(counts.values()) / 2}
    return [row for row in rows if row.window.split != "train" or row.share not in seldom]


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
        raise SourceError(
            f"{path} is no recording of a guided session, which `bench record` makes with --letter or --shape; of "
            "others `bench replay --marks FILE` makes a scan"
        )
    return SessionRecord(
        Path(path), plan, replay.pad, replay.whole, readings, presses, calibrations, segments
    )


def scan_of_sessions(
    paths: Sequence[str | Path], moments: Moments | None = None, at_load: float = 1.0
) -> Scan:
    """Make one scan of guided sessions: each press is the mean of its readings.

    Taxels that one of the calibrations leaves out, and those that are wrong while the pad is idle, are left out
    everywhere. moments, at_load: of training and of test presses, as `scan_of_intervals` has them. Raises InputError if
    there is no press in them, their pads differ, two are the same recording, or moments are wanted and none is found.
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


# Columns that say something of a pose.
POSE_COLUMNS = ("x_mm", "y_mm", "theta_rad", "theta_deg")


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

    placed: ClassVar[bool] = True

    first_s: float = Field(ge=0)
    last_s: float

    @model_validator(mode="after")
    def _ordered(self) -> Interval:
        if self.last_s < self.first_s:
            raise ValueError(f"last_s {self.last_s:g} is before first_s {self.first_s:g}")
        return self


class UnplacedInterval(Interval):
    """A line of a marks file without poses, which nobody noted: each is 0."""

    placed: ClassVar[bool] = False

    x_mm: float = 0.0
    y_mm: float = 0.0
    theta_rad: float = 0.0


def read_intervals(path: str | Path) -> list[Interval]:
    """Read a marks file: CSV with the columns label, split, x_mm, y_mm, theta_rad (or theta_deg), first_s, last_s.

    Without all columns of the pose nobody noted it. Raises InputError with the line that is wrong.
    """
    rows = list(named_rows(path, "marks", Interval))
    kind = Interval if any(has_pose(row) for _, row in rows) else UnplacedInterval
    return [checked(kind, row, place) for place, row in rows]


def has_pose(names: Iterable[str]) -> bool:
    """Tell whether a table with columns of these names says anything of a pose."""
    return not set(POSE_COLUMNS).isdisjoint(names)


def named_rows(
    path: str | Path,
    what: str,
    kind: type[PlacedPress],
    most: int = SMALL,
    called: Mapping[str, str] | None = None,
    unit: str = "",
) -> Iterator[tuple[str, dict[str, str]]]:
    """Read a table of presses: where each row stands, and its words by name. Raises InputError.

    The line of names is the one of the first 40 that has the most names of `kind`, in capitals or not. What stands
    above it is left out, and so are lines that begin with #, % or //, and empty rows. called: what names of `kind` are
    called in the table, where otherwise. unit: of other numbers.
    """
    lines = read_text(path, what, most).splitlines()
    known = {name.lower(): name for name in (*kind.model_fields, "theta_deg")}
    known |= {theirs.lower(): name for name, theirs in (called or {}).items()}
    titles = (text_tables.title_cells(line) for line in lines[: text_tables.TITLE_WITHIN])
    heads = [[known.get(cell.lower(), known.get(_spelt(cell), cell)) for cell in cells] for cells in titles]
    names = max(heads, key=lambda head: len({*head}.intersection(known.values())), default=[])
    if called and not {*names}.intersection(known.values()):
        raise InputError(f"{path}: no line names a column {' or '.join(map(repr, called.values()))}")
    if not {*names}.intersection(known.values()):
        also = "; of a recording `bench replay --marks` makes presses, of a folder with a press a file `bench import`"
        also = also if what == "presses" else ""
        raise InputError(f"{path}: no line names its columns, which are {', '.join(known.values())}{also}")
    for name, theirs in (called or {}).items():
        if name not in names:
            raise InputError(
                f"{path}: no column is called {theirs!r}; there are {short(', '.join(filter(None, names)))}"
            )
    above = heads.index(names) + 1
    separator = text_tables.separator_of(lines[above - 1])
    below = ("" if line.startswith(("#", "%", "//")) else line for line in lines[above:])
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
        thousands = text_tables.thousands_mark(cells(taxels), commas, unit) or ""
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    whole = (cell.replace(thousands, "") for cell in cells(taxels))
    commas = commas or text_tables.has_decimal_commas(whole, separator)
    if not any(row for _, row in rows):
        raise InputError(f"{path} holds no {what}: there is no row below the names {', '.join(names)}")
    for number, row in rows:
        where = f"{path}, line {above + number}"
        if any(row[len(names) :]):
            raise InputError(f"{where}: it has more columns than the title {short(lines[above - 1])}")
        if row:
            bare = [cell.replace(thousands, "") if at in taxels else cell for at, cell in enumerate(row)]
            pointed = text_tables.with_points(bare, separator, commas)
            named = {
                name: row[at] if at in words else pointed[at] for at, name in enumerate(names[: len(row)])
            }
            yield where, {name: word for name, word in named.items() if name}


def _spelt(cell: str) -> str:
    """Spell a title as names of columns are: `X (mm)` as x_mm, `theta [°]` as theta_deg."""
    return re.sub(r"\W+", "_", cell.lower().replace("°", "deg")).strip("_")


def scan_of_intervals(
    source: Source, intervals: Sequence[Interval], moments: Moments | None = None, at_load: float = 1.0
) -> Scan:
    """Make a scan of a recording without guidance: the mean of the readings in each interval.

    moments: how many of each training press, at even shares of its load up to the plateau, as further readings at its
    pose; "auto" as `with_moments` has it, and "found" the same where there is a rise, else none. at_load: the share of
    their load at which test presses are read; one that does not show it is left out. The plateau is found within the
    interval, the rise in what was read since the interval before; then the plateau's median is the press's reading.
    Taxels that are stuck or always loaded while nothing presses are left out: `meta["left_out"]` says which, numbered
    as on the whole pad, and why. Where nobody noted the poses, `meta["poses"]` says so.

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
        **({} if any(each.placed for each in intervals) else NO_POSES),
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
