"""Lead a person through a guided session on the terminal: read, listen to keys, mark what was taken."""

from __future__ import annotations

import time

from tactsim.bench.pad.guide_screen import Screen
from tactsim.bench.pad.keyboard import keys
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.recording import Recorder
from tactsim.hardware.session import Phase, Press, Session

_REDRAW = 0.1  # s
_LOOK = 0.2  # s: the longest time for which nobody looks at the keys, or whether the pad is still there


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
