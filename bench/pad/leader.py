"""Lead through the presses of a session, between the thread that reads the pad and the person who looks on."""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock

from tactsim.core.reading import Reading
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.session import Phase, Press, Session

KEYS = {" ": "take", "r": "redo", "s": "skip", "n": "begin"}  # on a terminal, of the commands that there are


class Leader:
    """Take readings of the pad and commands of a person, one at a time, and pass on each press that is done.

    session: what is asked for. choosing: whether nothing is asked for until it is known what.
    """

    def __init__(
        self, session: Session, first: int = 0, done: Callable[[Press], None] = lambda press: None
    ) -> None:
        """Prepare to lead. first: number of the next reading. done(press): is told what became of each press."""
        self.session, self.choosing = session, False
        self.changed = RLock()
        self._count, self._done = first, done

    def take(self, reading: Reading) -> None:
        """Take in a reading of the pad; called in the thread that reads. Raises InputError as `Session.take` does."""
        with self.changed:
            number, self._count = self._count, self._count + 1
            if not self.choosing:
                self.after(self.session.take(reading, number), reading.host_time)

    def after(self, press: Press | None, came: float) -> None:
        """Pass on what became of a press, if something did, with the reading that came at `came`, s."""
        if press is not None:
            self._done(press)

    def tared(self, calibration: Calibration) -> int:
        """Begin the open press anew, from another zero; returns the number of the first reading that it corrects."""
        with self.changed:
            self.session.tared()
            return self._count

    def asked(self) -> int | None:
        """Give the number of the press that should be on the pad now; None while the pad should be free."""
        with self.changed:
            waits = self.choosing or self.session.phase in (Phase.LIFT, Phase.DONE)
            return None if waits else self.session.current

    def commands(self) -> dict[str, Callable[[], None]]:
        """Name what a person may ask for."""
        return {"take": self.take_anyway, "redo": self.redo, "skip": self.skip}

    def obey(self, key: str) -> None:
        """Do what a key of the terminal asks for, if it asks for something."""
        if command := self.commands().get(KEYS.get(key, "")):
            command()

    def take_anyway(self) -> None:
        """Take the press that is asked for as it is from now on."""
        with self.changed:
            if not self.choosing:
                self.session.take_anyway()

    def skip(self) -> None:
        """Leave out the press that is asked for."""
        with self.changed:
            if not self.choosing:
                self.after(self.session.skip(), 0.0)

    def redo(self) -> None:
        """Ask for the last press again."""
        with self.changed:
            self.after(self.session.redo(), 0.0)
