"""Lead through touches and let an estimator take each: the state of `bench live`."""

from __future__ import annotations

import queue
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Thread
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from tactsim.bench.pad.simulated_hand import SimulatedHand, touch_above
from tactsim.bench.watching.recogniser import NOTHING, Belief, Recogniser, Touch
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.session import Leader, Plan, Press, Session, note

Explore = Literal["information", "random"]
_CHOOSING = "choosing the next touch"


@dataclass(frozen=True, eq=False)
class LiveView:
    """What is asked for and what is believed.

    number: grows with every belief. phase: what is waited for, in words. message: what is wrong with the touch, or "".
    progress: share of the touch's readings that have come. asked: (3,) sensor_in_robot of the touch that is asked for,
    or None. tried: nothing is left to ask for.
    """

    number: int = 0
    phase: str = "learning the letters"
    message: str = ""
    progress: float = 0.0
    asked: FloatArray | None = None
    tried: bool = False
    belief: Belief = NOTHING


class TouchLeader(Leader):
    """Ask for touches at the poses of a plan, chosen by the estimator or at random, and take those that are steady.

    The estimator has a thread, so that readings and viewers never wait for it. The session is looked at by two threads,
    one at a time: that of the readings while a touch is asked for, that of the estimator while it is `choosing`.
    """

    def __init__(
        self,
        recogniser: Recogniser,
        plan: Plan,
        pad: Pad,
        explore: Explore,
        seed: int,
        hand: SimulatedHand | None = None,
        called: Callable[[int], str] = str,
    ) -> None:
        """Prepare to ask for touches on `pad`. hand: what presses it, if it is simulated. called: see `Session`."""
        super().__init__(Session(plan, pad, called=called))
        self._called = called
        self.choosing = True
        self.recogniser = recogniser
        self.error: Exception | None = None  # what ended it, if something did
        self.beliefs: list[Belief] = []  # one for each touch that was taken, in order
        self._plan, self._pad, self._explore, self._hand = plan, pad, explore, hand
        self._poses = np.array(plan.poses)
        self._rng = np.random.default_rng(seed)
        self._numbers: list[int] = []  # which presses of the plan the recogniser's touches are
        self._view = LiveView()
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._jobs.put(self._begin)
        self._thread = Thread(target=self._work, name="estimate", daemon=True)
        if hand is not None:
            hand.asked = self.asked

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._jobs.put(None)
        self._thread.join(5.0)

    def view(self) -> LiveView:
        """Give what is asked for and believed now."""
        with self.changed:
            return self._view

    def idle(self) -> bool:
        """Tell whether no touch waits for the estimator."""
        return not self._jobs.unfinished_tasks

    def tared(self, calibration: Calibration) -> int:
        """Let noise, as the tare has found it, not count as a touch; else see `Leader.tared`."""
        with self.changed:
            if not self.choosing:  # else the estimator's thread has the session
                super().tared(calibration)
            touch = max(self._plan.touch_kpa, touch_above(max(calibration.noise)))
            self._plan = self.session.plan = self._plan.model_copy(update={"touch_kpa": touch})
            return self._count

    def commands(self) -> dict[str, Callable[[], None]]:
        """Name what a person may ask for."""
        return {**super().commands(), "begin": self.begin_anew}

    def redo(self) -> None:
        """Ask for the last touch again; what it told is forgotten."""
        self._close(self._redo)

    def begin_anew(self) -> None:
        """Forget everything: another object comes."""
        self._close(self._begin)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception as error:  # the caller raises it again, in the main thread
                self.error = error
                return
            finally:
                self._jobs.task_done()

    def _believe(self, number: int, touch: Touch) -> None:
        """Take in the touch that is press `number` of the plan."""
        belief = self.recogniser.take(touch)
        self._numbers.append(number)
        with self.changed:
            self.beliefs.append(belief)
            self._publish(belief)

    def _forget(self, number: int) -> None:
        if number in self._numbers:
            index = self._numbers.index(number)
            del self._numbers[index]
            belief = self.recogniser.take_back(index)
            with self.changed:
                self._publish(belief)

    def _publish(self, belief: Belief) -> None:
        self._set(number=self._view.number + 1, belief=belief)

    def _set(self, **changes: Any) -> None:
        self._view = replace(self._view, **changes)

    def _close(self, job: Callable[[], None]) -> None:
        """Take no more of the touch that is asked for, and do the job: what would still come is void."""
        with self.changed:
            self.choosing = True
            self._jobs.put(job)

    def after(self, press: Press | None, came: float) -> None:
        """Pass on what became of a touch, if something did, and say how it stands; `came`: s, of the last reading."""
        session = self.session
        if press is None:
            self._set(phase=session.phase.value, message=session.message, progress=session.progress)
        else:
            self.choosing = True
            self._set(phase=_CHOOSING, message="", progress=0.0)
            if press.what == "taken" and session.image is not None:
                touch = Touch(session.image, self._poses[press.number], came)
                self._jobs.put(lambda: self._believe(press.number, touch))
            self._jobs.put(self._choose)

    def _begin(self) -> None:
        with self.changed:
            self.choosing = True  # a job before may have asked
            self.session = Session(self._plan, self._pad, called=self._called)
            self._set(phase=_CHOOSING, message="", asked=None, tried=False)
            self._numbers.clear()
            self._publish(self.recogniser.begin_anew())
        self._choose()

    def _redo(self) -> None:
        with self.changed:
            mark = self.session.redo()
            if mark is None:
                self.choosing = self._view.asked is None
                return
            self.choosing = True
        self._forget(mark.number)
        if self._can_press(mark.number):
            self._ask(mark.number)
        else:
            self._choose()

    def _choose(self) -> None:
        """Choose the next touch among those that are left, and ask for it."""
        while left := [k for k in range(len(self._poses)) if k not in self.session.presses]:
            chosen = int(self._rng.integers(len(left)))
            if self._explore == "information":
                chosen = self.recogniser.choose(self._poses[left])
            if self._can_press(left[chosen]):
                self._ask(left[chosen])
                return
        with self.changed:
            self._set(phase="every pose was tried; begin anew", asked=None, tried=True)

    def _can_press(self, number: int) -> bool:
        """Let the hand get ready to press there, if there is one; a pose where no press rests is left out."""
        if self._hand is None or self._hand.prepare(number):
            return True
        note(self.session.presses, Press(number=number, what="skipped"))
        return False

    def _ask(self, number: int) -> None:
        with self.changed:
            self.session.current, self.choosing = number, False
            now = {"phase": self.session.phase.value, "message": self.session.message}
            self._set(**now, asked=self._poses[number], tried=False)
