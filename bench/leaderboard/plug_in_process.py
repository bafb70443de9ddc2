"""The process that a plug-in runs in: it learns, then answers one reading at a time. `confined` starts it.

It is given the training readings, and then what the pad says, reading by reading. The truth, the test readings and the
order of the trials are in the other process.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any, cast

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence
from numpy.random.bit_generator import ISpawnableSeedSequence

from tactsim.bench.leaderboard import fence
from tactsim.bench.leaderboard.messages import Message, receive, send
from tactsim.bench.machine import peak_memory_mb
from tactsim.core import InputError, Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimator, create
from tactsim.estimators.estimator import about_estimator, check_estimate, flatten_work


class Words(ISpawnableSeedSequence):
    """The random words that a seed gives, without the seed: in it are the letter and the trial.

    words: (1 + n, 4) of the sequence itself and of the first n that it spawns.
    """

    def __init__(self, words: np.ndarray) -> None:
        self._words, self._spawned = words, 0

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> np.ndarray:
        """Give the words that PCG64 asks for; for others make some of them."""
        if n_words == 4 and np.dtype(dtype) == np.uint64:
            return self._words[0].copy()
        return SeedSequence(self._words[0].tolist()).generate_state(n_words, dtype)

    def spawn(self, n_children: int) -> list[Any]:
        """Give the next sequences; those past the words that are known are others than without this process."""
        first, self._spawned = self._spawned + 1, self._spawned + n_children
        known = self._words[first : first + n_children]
        more = range(first + len(known), first + n_children)
        return [Words(word[None]) for word in known] + [
            SeedSequence([*self._words[0].tolist(), k]) for k in more
        ]


class _Process:
    def __init__(self, pipe: socket.socket) -> None:
        self._pipe = pipe
        self._estimator: Estimator | None = None
        self._letters: Sequence[str] = ()

    def tell(self, status: str) -> None:
        """Say why this process ends, and end it."""
        send(self._pipe, Message({"status": status}))
        os._exit(1)

    def begin(self, words: dict[str, Any]) -> Message:
        """Put up the fence, then import and make the estimator: its module's code is a plug-in's too."""
        self._memory_mb, self._name, self._options = words["memory_mb"], words["estimator"], words["options"]
        fence.limit(self._memory_mb)
        self._taken_mb = peak_memory_mb()
        fence.build(Path.cwd(), words["package"], lambda what: self.tell(f"peeked: {what}"))
        try:
            estimator = create(self._name, **self._options)
        except InputError as error:
            return Message({"refused": str(error)})
        return Message({"about": about_estimator(estimator), "proposes": estimator.proposes})

    def fit(self) -> Message:
        """Make the estimator anew, and have it learn the training readings."""
        scan = Scan.load("training.npz")
        self._estimator = estimator = create(self._name, **self._options)
        self._letters = (*scan.letters, NONE)
        if estimator.uses_forward_model:
            from tactsim.press import forward_model

            estimator.bring(forward_model(scan))
        estimator.fit(scan)
        return Message({"work": flatten_work(estimator.work)})

    def reset(self, words: FloatArray) -> Message:
        """Begin a trial."""
        self._made.reset(Generator(PCG64(cast(SeedSequence, Words(words.view(np.uint64))))))
        return Message({"work": flatten_work(self._made.work)})

    def update(self, reading: FloatArray, sensor_in_robot: FloatArray) -> Message:
        """Take in a reading and say what is held to be true after it."""
        estimator = self._made
        start = process_time()
        estimator.update(reading, sensor_in_robot)
        updated = process_time()
        estimate = estimator.estimate()
        done = process_time()
        check_estimate(estimate, estimator, self._letters)
        arrays = {"robot_in_object": np.asarray(estimate.robot_in_object, dtype=float)}
        if estimate.samples is not None:
            arrays |= {"poses": estimate.samples.poses, "weights": estimate.samples.weights}
        said = {label: float(p) for label, p in estimate.probabilities.items()}
        return Message(
            {
                "label": str(estimate.label), "probabilities": said, "work": flatten_work(estimator.work),
                "seconds": [updated - start, done - updated],
            },
            arrays,
        )  # fmt: skip

    def propose(self, candidates: FloatArray) -> Message:
        """Choose where to touch next."""
        start = process_time()
        chosen = self._made.propose(candidates)
        if not isinstance(chosen, int | np.integer):
            raise InputError(f"it proposed a {type(chosen).__name__}, which is no index")
        return Message({"chosen": int(chosen), "seconds": [process_time() - start]})

    @property
    def _made(self) -> Estimator:
        assert self._estimator is not None
        return self._estimator

    def answer(self, asked: Message) -> Message:
        """Do what is asked; what goes wrong becomes a status."""
        words, arrays = dict(asked.words), asked.arrays
        what = words.pop("do")
        # Should the other process die while a plug-in hangs, the system ends this one.
        signal.setitimer(signal.ITIMER_REAL, words.pop("seconds"))
        try:
            answer = self.begin(words) if what == "begin" else getattr(self, what)(**arrays)
            if peak_memory_mb() - self._taken_mb > self._memory_mb:
                raise MemoryError
        except MemoryError:
            return Message({"status": f"out of memory: it takes more than {self._memory_mb:,} MB"})
        except BaseException as error:
            traceback.print_exc()
            if (refused := _refused(error)) is not None:
                return Message({"status": f"forbidden: {refused.strerror}"})
            return Message({"status": f"crashed: {_in_one_line(error)}"})
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        return answer


def _refused(error: BaseException | None) -> fence.Refused | None:
    """Find what the fence refused behind an error: libraries raise errors of their own when they fail."""
    while error is not None and not isinstance(error, fence.Refused):
        error = error.__cause__ or error.__context__
    return error


def _in_one_line(error: BaseException) -> str:
    said = " ".join(str(error).split())[:300]
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{': ' * bool(said)}{said}{place}"


def main() -> None:
    """Answer until the other process closes the pipe or a plug-in fails."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    with socket.socket(fileno=int(sys.argv[1])) as pipe:
        process = _Process(pipe)
        while True:
            try:
                asked = receive(pipe)
            except EOFError:
                os._exit(0)  # freeing every object first takes half a second
            send(pipe, process.answer(asked))


if __name__ == "__main__":
    main()
