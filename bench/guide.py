"""Lead a person through a guided session on the terminal: draw, read, listen to keys, mark what was taken."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from tactsim.core.poses import FloatArray
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.calibration import force
from tactsim.hardware.recording import Recorder
from tactsim.hardware.session import Phase, Press, Session
from tactsim.hardware.terminal_pictures import Covers, placement, tactile_image, where

KEYS = "space take it as it is   r redo the one before   s skip   q stop (goes on later with --resume)"
_REDRAW = 0.1  # s
_NUMBERS = re.compile(r"[\d.,]+")  # a message that differs in numbers alone is not said again


def lead(
    session: Session,
    source: Source,
    recorder: Recorder,
    first: int,
    covers: Covers | None,
    from_behind: bool,
    console: Console,
) -> bool:
    """Record the presses that are missing; returns whether all are done.

    first: number of the next reading in the recording. covers: the object's shape, for the drawing.
    Stops at `q`, an interrupt, or the end of a source that has one.
    """
    number, drawn = first, 0.0
    screen = _Screen(session, source, covers, from_behind, console)
    with _keys() as pressed, screen:
        try:
            while session.phase is not Phase.DONE:
                try:
                    reading = source.read()
                except NoReading as error:
                    session.message = str(error)
                else:
                    _mark(recorder, session.take(reading, number), screen)
                    number += 1
                    screen.felt = reading.pressures
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


def _command(session: Session, key: str) -> Press | None:
    if key == " ":
        session.take_anyway()
    elif key == "s":
        return session.skip()
    elif key == "r":
        return session.redo()
    return None


def _mark(recorder: Recorder, press: Press | None, screen: _Screen) -> None:
    if press is not None:
        recorder.mark(press.model_dump(), time.monotonic())
        screen.note(press)


class _Screen:
    """What the person sees: on a terminal one picture that changes, otherwise a line for each press."""

    def __init__(
        self, session: Session, source: Source, covers: Covers | None, from_behind: bool, console: Console
    ) -> None:
        self._session, self._source, self._covers, self._from_behind = session, source, covers, from_behind
        self._console = console
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self.felt: FloatArray = np.zeros(len(source.taxel_xy))
        self._said: set[tuple[int, str]] = set()  # without a picture: what was said of which press

    def __enter__(self) -> _Screen:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def draw(self) -> None:
        """Show what is asked for and what the pad feels."""
        session, total = self._session, len(self._session.plan.poses)
        if self._live is None:
            said = session.current, _NUMBERS.sub("", session.message)
            if session.message and said not in self._said:
                self._console.print(f"press {session.current + 1} of {total}: {session.message}")
                self._said.add(said)
            return
        if session.phase is Phase.DONE:
            return
        pose = np.array(session.plan.poses[session.current])
        now = float(force(self.felt, session.pad))
        lines = [
            Text(
                f"{session.plan.label} ({session.plan.split}), press {session.current + 1} of {total}, "
                f"{len(session.presses)} done",
                "bold",
            ),
            Text(where(pose, self._from_behind)),
            placement(pose, session.pad, self._covers, self._from_behind),
            Text(f"{session.phase.value}  {now:5.2f} N  {100 * session.progress:3.0f} %", "bold green"),
            Text(session.message, "bold red"),
            tactile_image(self.felt, self._source.taxel_xy, self._from_behind),
        ]
        if session.image is not None:
            lines += [
                Text("the last press that was taken"),
                tactile_image(session.image, self._source.taxel_xy, self._from_behind),
            ]
        self._live.update(Group(*lines, Text(KEYS, "dim")), refresh=True)

    def note(self, press: Press) -> None:
        """Print what became of a press, if no picture shows it."""
        if self._live is not None:
            return
        line = f"press {press.number + 1} of {len(self._session.plan.poses)}: {press.what}"
        if press.what == "taken" and self._session.image is not None:
            line += f", {float(force(self._session.image, self._session.pad)):.2f} N"
        self._console.print(line)


@contextmanager
def _keys() -> Iterator[Callable[[], list[str]]]:
    """Read single keys without waiting, where standard input is a terminal."""
    if not sys.stdin.isatty():
        yield lambda: []
        return
    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield _typed
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)


def _typed() -> list[str]:
    keys = []
    while select.select([sys.stdin], [], [], 0)[0]:
        keys.append(os.read(sys.stdin.fileno(), 1).decode(errors="replace").lower())
    return keys
