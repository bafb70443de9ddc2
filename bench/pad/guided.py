"""Do one guided session: open its recording and the pad, lead through the presses on the terminal, close both."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from tactsim.bench.pad.guide_screen import Screen
from tactsim.bench.pad.keyboard import keys
from tactsim.bench.pad.measured import known_letter
from tactsim.bench.pad.simulated_hand import PLACE, SimulatedHand
from tactsim.core.errors import InputError
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import Device
from tactsim.hardware.recording import Recorder, check_whole
from tactsim.hardware.scans import read_session
from tactsim.hardware.session import Phase, Plan, Press, Session
from tactsim.hardware.sources import open_source
from tactsim.hardware.terminal_pictures import Covers
from tactsim.hardware.wrappers import Corrected, Recorded
from tactsim.models import letter
from tactsim.press.clip import covers

_REDRAW = 0.1  # s
_LOOK = 0.2  # s: the longest time for which nobody looks at the keys, or whether the pad is still there


@dataclass(frozen=True)
class Station:
    """Where a person presses: the pad, and how they look at it.

    ports: where the pad is. segment(plan): what a recording says of a sitting (`cli.pad_options.segment`).
    from_behind: whether the object's back is seen as it is pressed.
    """

    ports: list[str]
    device: Device
    calibration: Calibration | None
    segment: Callable[[Plan], Mapping[str, Any]]
    from_behind: bool
    console: Console


@dataclass(frozen=True)
class Sitting:
    """How a session ended. done: whether nothing is missing. presses: recorded or skipped."""

    done: bool
    presses: int
    counters: dict[str, int]


def record(
    station: Station, plan: Plan, journal: Path, *, resume: bool, title: str = "", notice: str = ""
) -> Sitting:
    """Record the presses of a plan, or with `resume` those that `journal` does not have yet.

    notice: is said once the pad is open.

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
    if not resume and journal.exists():
        raise InputError(f"{journal} exists; name another file, or go on with its session by `--resume`")
    session = Session(plan, station.device.pad, presses)
    with Recorder(journal, append=resume) as recorder:
        recorder.segment(station.segment(plan), time.monotonic())
        with _open(station, session, recorder, new=not resume) as source:
            if notice:
                station.console.print(notice)
            screen = Screen(
                session, source.taxel_xy, shape(plan.label), station.from_behind, station.console, title
            )
            done = lead(session, source, recorder, first, screen, station.device.deadline)
            counters = source.counters.as_dict()
            recorder.end(counters, time.monotonic())
    return Sitting(done, len(session.presses), counters)


def _open(station: Station, session: Session, recorder: Recorder, new: bool) -> Source:
    if station.ports != [PLACE]:
        return open_recorded(station.ports, station.device, station.calibration, recorder, new)
    with _retried(recorder, new):
        letter(session.plan.label)  # an unknown one is refused before it is pressed
        hand = Recorded(SimulatedHand(session, station.device, seed=0), recorder)
        return hand if station.calibration is None else Corrected(hand, station.calibration, PLACE)


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


def shape(label: str) -> Covers | None:
    """Give the test for points on the letter of that name; None if there is no such letter."""
    known = known_letter(label)
    return None if known is None else partial(covers, known.contours)


def lead(
    session: Session, source: Source, recorder: Recorder, first: int, screen: Screen, deadline: float
) -> bool:
    """Record the presses that are missing; returns whether all are done.

    first: number of the next reading in the recording. deadline: s without a reading after which the pad counts as
    lost; a link that breaks counts at once. A pad that is lost is waited for.
    Stops at `q`, an interrupt, or the end of a source that has one.
    """
    number, drawn = first, 0.0
    heard, reconnects = time.monotonic(), source.counters.reconnects
    with keys() as pressed, screen:
        try:
            while session.phase is not Phase.DONE:
                try:
                    reading = source.read(min(_LOOK, deadline))
                except NoReading as error:
                    if time.monotonic() - heard > deadline or source.counters.reconnects > reconnects:
                        screen.felt, screen.lost = None, _reason(error)
                else:
                    heard, reconnects = time.monotonic(), source.counters.reconnects
                    screen.felt, screen.lost = reading.pressures, ""
                    _mark(recorder, session.take(reading, number), screen)
                    number += 1
                for key in pressed():
                    if key == "q":
                        return False
                    _mark(recorder, _command(session, key), screen)
                now = time.monotonic()
                if now - drawn >= _REDRAW:
                    drawn = now
                    screen.draw()
        except (KeyboardInterrupt, SourceEnded):
            return False
    return True


def _reason(error: NoReading) -> str:
    """Leave out for how long nothing came: that is not what is wrong."""
    late, _, why = str(error).partition(": ")
    return why or late


def _command(session: Session, key: str) -> Press | None:
    if key == " ":
        session.take_anyway()
    elif key == "s":
        return session.skip()
    elif key == "r":
        return session.redo()
    return None


def _mark(recorder: Recorder, press: Press | None, screen: Screen) -> None:
    if press is not None:
        recorder.mark(press.model_dump(), time.monotonic())
        screen.note(press)
