"""Lead a person through presses on the terminal: one session, whose recording is its journal, or a run's trials.

What is measured already is kept. Its screen shows where to press and what the pad feels, side by side.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from tactsim.bench.machine import versions
from tactsim.bench.pad import known_letter, poses_to_press, recording_of
from tactsim.bench.pad.simulated_hand import PLACE, SimulatedHand
from tactsim.bench.watching import PadReader, PadView
from tactsim.bench.watching.watch_screen import over_picture, show
from tactsim.core import Pad, Scan
from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import Source, SourceEnded
from tactsim.hardware.calibration import Calibration, force
from tactsim.hardware.device import Device
from tactsim.hardware.recording import Kind, Recorder, RecordReader, check_whole
from tactsim.hardware.scans import read_session
from tactsim.hardware.session import Leader, Phase, Plan, Press, Session, Tare, count_taken, parse_mark
from tactsim.hardware.session import note as enter
from tactsim.hardware.sources import Recorded, open_source, taxels_of
from tactsim.hardware.terminal_pictures import Covers, on_template, placement, tactile_image, where
from tactsim.models import Letter, letter
from tactsim.press.clip import covers

_KEYS = "space take it as it is   r redo the last   s skip   t tare   q stop for now"
_REACH = 27.0  # mm from the pad's middle that the drawing shows at least: a letter may lie beside the pad
_DRAWN = 0.55  # of the screen's width that the drawing takes at most
_BESIDE = 5.0  # mm that it shows beside a larger pad
_NUMBERS = re.compile(r"[\d.,]+")  # a message that differs in numbers alone is not said again


@dataclass(frozen=True)
class Station:
    """Where a person presses: the pad, and how they look at it.

    ports: where the pad is. from_behind: whether the object's back is seen as it is pressed.
    """

    ports: list[str]
    device: Device
    calibration: Calibration | None
    from_behind: bool
    console: Console

    def segment(self, plan: Plan) -> dict[str, Any]:
        """Describe a sitting for its recording."""
        return segment(self.device, self.ports, self.calibration, plan=plan.model_dump(mode="json"))


@dataclass(frozen=True)
class Sitting:
    """How a session ended. done: whether nothing is missing. presses: recorded or skipped."""

    done: bool
    presses: int
    counters: dict[str, int]


def record(
    station: Station,
    plan: Plan,
    journal: Path,
    *,
    resume: bool,
    title: str = "",
    notice: str = "",
    pressed: Letter | None = None,
) -> Sitting:
    """Record the presses of a plan, or with `resume` those that `journal` does not have yet.

    notice: is said once the pad is open. pressed: the object, by default the letter that the plan's label names.

    Raises InputError if the journal is of another session or pad, exists (without `resume`), or the pad cannot be
    opened.
    """
    presses, first = {}, 0
    if resume and check_whole(journal).records:  # without records, it was killed before it began
        before = read_session(journal)
        if before.plan.poses != plan.poses or before.plan.label != plan.label:
            raise InputError(
                f"{journal} is a session of {before.plan.label!r} with {len(before.plan.poses)} presses, not the "
                "one asked for; resume it with the same letter and poses"
            )
        if before.pad != station.device.pad:
            raise InputError(f"{journal} was recorded with another pad than {station.device.name!r}")
        plan, presses, first = before.plan, before.presses, before.readings
        last = before.calibrations[-1][1]
        if last and (station.calibration is None or last.taken > station.calibration.taken):
            station = replace(station, calibration=last)  # a tare was taken since
    if not resume and journal.exists():
        raise InputError(f"{journal} exists; name another file, or go on with its session by `--resume`")
    session = Session(plan, station.device.pad, presses)
    pressed = known_letter(plan.label) if pressed is None else pressed
    screen = Screen(session, station.from_behind, station.console, title, pressed)
    if not station.console.is_terminal and plan.patience is None and (notice or not title):
        station.console.print(
            f"{plan.label}: {count_taken(presses)} of {len(plan.poses)} presses; this is no terminal: the guide draws "
            "nothing and takes no keys (of a machine that presses say --patience)",
            soft_wrap=True,
        )
    with Recorder(journal, append=resume) as recorder:

        def note(press: Press) -> None:
            recorder.mark(press.model_dump(), time.monotonic())
            screen.note(press)

        def take(reading: Reading) -> None:
            leader.take(reading)
            if session.phase is Phase.DONE:  # what comes now is no longer between two presses
                raise SourceEnded("all presses are recorded")

        def tared(calibration: Calibration) -> None:
            tare = Tare(first=leader.tared(calibration), calibration=calibration)
            recorder.mark(tare.model_dump(mode="json"), time.monotonic())

        leader = Leader(session, first, note)
        recorder.segment(station.segment(plan), time.monotonic())
        with _open(station, leader, recorder, pressed, new=not resume) as source:
            screen.taxel_xy, places = source.taxel_xy, taxels_of(source)
            session.called = lambda k: station.device.called(int(places[k]))
            if notice:
                station.console.print(notice)
            name = " ".join(station.ports)
            with PadReader(source, station.device, name, on_reading=take, on_tare=tared) as reader:
                _lead(leader, reader, screen, station.console)
            if reader.error is not None:
                raise reader.error
            counters = source.counters.as_dict()
            recorder.end(counters, time.monotonic())
    return Sitting(session.phase is Phase.DONE, len(session.presses), counters)


def _lead(leader: Leader, reader: PadReader, screen: Screen, console: Console) -> None:
    """Show what is asked for until all presses are done, at `q`, an interrupt, or the end of a source that has one."""

    def over(view: PadView) -> bool:
        return view.state == "ended" or reader.error is not None

    def obey(key: str, _: PadView) -> None:
        reader.tare() if key == "t" else leader.obey(key)

    with suppress(KeyboardInterrupt):
        show(reader, console, over, screen.draw, obey)


def _open(station: Station, leader: Leader, recorder: Recorder, pressed: Letter | None, new: bool) -> Source:
    """Open the pad, or let a simulated hand press what the leader asks for."""
    if station.ports != [PLACE]:
        return open_recorded(station.ports, station.device, station.calibration, recorder, new)
    with _retried(recorder, new):
        if station.calibration is not None:
            raise InputError(f"{PLACE} has no zero to correct and needs no calibration")
        plan = leader.session.plan
        hand = SimulatedHand(pressed or letter(plan.label), np.array(plan.poses), station.device, seed=0)
        hand.asked = leader.asked
        return Recorded(hand, recorder)


def segment(device: Device, ports: list[str], calibration: Calibration | None, **more: Any) -> dict[str, Any]:
    """Describe a segment of a recording: the device, its calibration and ports, and the versions."""
    return {
        "device": device.as_json(),
        "calibration": None if calibration is None else calibration.model_dump(mode="json"),
        "urls": list(ports),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        **more,
    }


def open_recorded(
    ports: list[str], device: Device, calibration: Calibration | None, recorder: Recorder, new: bool
) -> Source:
    """Open what is recorded. A recording that is new is removed if that fails, so that it can be tried again."""
    with _retried(recorder, new):
        source = open_source(ports, device, calibration, recorder)
        if source.pad != device.pad:
            source.close()
            raise InputError(f"{ports[0]} has another pad than --device says")
        return source


@contextmanager
def _retried(recorder: Recorder, new: bool) -> Iterator[None]:
    try:
        yield
    except InputError:
        if new:
            recorder.discard()
        raise


@dataclass(frozen=True)
class Wanted:
    """The trials to be measured: of each letter `trials`, each of `readings` presses. seed: of their poses.

    own: the user's objects among the letters, by name.
    """

    letters: Sequence[str]
    trials: int
    readings: int
    seed: int
    own: Mapping[str, Letter] = field(default_factory=dict)


def measure(station: Station, wanted: Wanted, folder: Path, settings: Mapping[str, Any]) -> bool:
    """Lead through the trials that are missing in `folder`; returns whether all are there now.

    settings: fields of the sessions' plans (`Plan`). Stops where the person stops, and can be called again.
    Raises InputError if a recording in the folder does not fit, or too many presses were skipped.
    """
    trials = [(label, trial) for label in wanted.letters for trial in range(wanted.trials)]
    pad = station.device.pad
    # Wrong settings come to light before anything is pressed.
    plans = [_plan(label, trial, wanted, settings, pad) for label, trial in trials]
    notice = f"presses are kept in {folder}"
    for number, ((label, trial), plan) in enumerate(zip(trials, plans, strict=True), start=1):
        path = recording_of(folder, label, trial)
        begun = path.exists()
        if begun and _taken(path, plan) >= wanted.readings:
            continue
        title = f"trial {number} of {len(trials)}: "
        sitting = record(
            station, plan, path, resume=begun, title=title, notice=notice, pressed=wanted.own.get(label)
        )
        notice = ""
        if not sitting.done:
            return False
        if _taken(path, plan) < wanted.readings:
            raise InputError(
                f"{path} has too few presses, since too many were skipped; remove it and measure this trial again"
            )
    return True


def count_measured(wanted: Wanted, folder: Path) -> int:
    """Count the presses that are in the folder for these trials."""
    paths = [recording_of(folder, label, trial) for label in wanted.letters for trial in range(wanted.trials)]
    return sum(count_taken(_progress(path)[1]) for path in paths if path.exists())


def check_pads(train: Scan, station: Station) -> None:
    """Raise InputError unless the training readings have a taxel where the pad has one."""
    shared = (abs(train.taxel_xy[:, None] - station.device.pad.taxel_xy[None]).max(axis=-1) < 1e-3).any()
    if not shared:
        raise InputError(
            f"--train-scan was taken on another pad than that of {station.device.name!r}: no taxel is at the same place"
        )


def _plan(label: str, trial: int, wanted: Wanted, settings: Mapping[str, Any], pad: Pad) -> Plan:
    poses = poses_to_press(label, trial, wanted.readings, wanted.seed, pad, wanted.own.get(label))
    content = {"label": label, "split": "test", "poses": list(map(tuple, poses.tolist()))}
    return checked(Plan, {**content, "enough": wanted.readings, **settings}, "session")


def _taken(path: Path, plan: Plan) -> int:
    """Count the presses of a recording that was begun. Raises InputError if it was not made for this trial."""
    before, presses = _progress(path)
    if before is not None and (before.label, before.poses) != (plan.label, plan.poses):
        raise InputError(
            f"{path} is a session of {before.label!r} with other poses: it was measured with another seed or number of "
            "readings; name another folder"
        )
    return count_taken(presses)


def _progress(path: Path) -> tuple[Plan | None, dict[int, Press]]:
    """Read plan and marks of a recording, without its readings; there is no plan if it was killed before it began."""
    plan: Plan | None = None
    presses: dict[int, Press] = {}
    for record in RecordReader(path):
        if record.kind is Kind.SEGMENT:
            plan = checked(Plan, record.json().get("plan"), f"plan of {path}")
        elif record.kind is Kind.MARK and plan is not None:
            enter(presses, parse_mark(record.json(), len(plan.poses)))
    return plan, presses


class Screen:
    """What the person sees: on a terminal one picture that changes, otherwise a line for each press.

    taxel_xy: (taxels, 2) mm of the readings that the session takes; some of the pad's may be left out.
    """

    def __init__(
        self,
        session: Session,
        from_behind: bool,
        console: Console,
        title: str = "",
        pressed: Letter | None = None,
    ) -> None:
        """Show a session. title: what stands before the object's name. pressed: the object, if its shape is known."""
        self._session, self.taxel_xy = session, session.pad.taxel_xy
        self._covers: Covers | None = None if pressed is None else partial(covers, pressed.contours)
        self._from_behind, self._console, self._title = from_behind, console, title
        self._said: set[tuple[int, str]] = set()  # without a picture: what was said of which press

    def draw(self, view: PadView) -> Group | None:
        """Draw what is asked for and what the pad feels; without a terminal, say what is wrong."""
        # For how long nothing came is not what is wrong.
        late, _, why = view.trouble.partition(": ")
        lost = (why or late) if view.state == "lost" else ""
        if self._session.phase is Phase.DONE:
            return None
        if self._console.is_terminal:
            return self._picture(view, lost)
        self._say(f"the pad is lost: {lost}" if lost else self._session.message)
        return None

    def note(self, press: Press) -> None:
        """Print what became of a press, if no picture shows it."""
        if self._console.is_terminal:
            return
        line = f"{self._title}press {self._number(press.number)}: {press.what}"
        if press.what == "taken" and self._session.image is not None:
            line += f", {float(force(self._session.image, self._session.pad)):.2f} N"
        self._console.print(line)

    def _say(self, message: str) -> None:
        said = self._session.current, _NUMBERS.sub("", message)
        if message and said not in self._said:
            self._console.print(f"{self._title}press {self._number(self._session.current)}: {message}")
            self._said.add(said)

    def _number(self, press: int) -> str:
        plan = self._session.plan
        if plan.enough is None:
            return f"{press + 1} of {len(plan.poses)}"
        mark = self._session.presses.get(press)
        counts = mark is not None and mark.what == "taken"
        return f"{count_taken(self._session.presses) + (not counts)} of {plan.enough}"

    def _picture(self, view: PadView, lost: str) -> Group:
        session, plan = self._session, self._session.plan
        pose = np.array(plan.poses[session.current])
        title = f"{self._title}{plan.label} ({plan.split}), press {self._number(session.current)}"
        if plan.enough is None:
            title += f", {len(session.presses)} done"
        heading = Text(title, "bold")
        heading.append(f"   {on_template(pose)}", "not bold")
        if lost:
            state = Text("THE PAD IS LOST", "bold white on red")
            message = f"{lost}. It goes on when the pad is back"
        else:
            state = Text(
                f"{session.phase.value}  {view.force + 0.0:5.2f} N  {100 * session.progress:3.0f} %",
                "bold green",
            )
            message = view.message or session.message
        console = self._console
        message_lines = Text(message, "bold red")
        if len(message_lines.wrap(console, console.width)) < 2:
            message_lines.append("\n")  # nothing below jumps
        return over_picture(
            console,
            [heading, Text(where(pose, self._from_behind))],
            partial(self._pictures, view, pose, console.width),
            [state, message_lines, Text(_KEYS, "dim")],
        )

    def _pictures(self, view: PadView, pose: FloatArray, width: int, height: int) -> Table:
        """Draw where to press, and beside it what the pad feels and felt last, in `width` x `height` characters."""
        session, pad = self._session, self._session.pad
        reach = max(_REACH, *(float(edges.max()) + _BESIDE for edges in (pad.column_edges, pad.row_edges)))
        # mm of a character along x; along y it is twice as much.
        cell = max(1.0, reach / height, 2 * reach / (_DRAWN * width))
        drawing = placement(pose, pad, self._covers, self._from_behind, reach, cell)
        drawing.right_crop()  # the last line's end
        across = width - int(2 * reach / cell) - 3
        now, last = (
            Text("\n").join([*Text(title).wrap(self._console, across), Text()])
            for title in (
                f"the pad now, its {'face' if self._from_behind else 'back'}",
                "the last press that was taken",
            )
        )
        titles = now.plain.count("\n") + last.plain.count("\n")
        room = across, max((height - titles) // 2, 1)
        now.append(tactile_image(view.pressures, session.pad.taxel_xy, self._from_behind, room))
        if session.image is not None:
            last.append(tactile_image(session.image, self.taxel_xy, self._from_behind, room))
            room_left = now.plain.count("\n") + last.plain.count("\n") < height
            now.append("\n" * room_left).append(last)
        now.right_crop()
        table = Table.grid(padding=(0, 3, 0, 0))
        table.add_column(no_wrap=True, overflow="crop")
        table.add_column(no_wrap=True, overflow="crop")
        table.add_row(drawing, now)
        return table
