"""Run an estimator in a process of its own, behind a fence, that is told no more than an estimator needs to know.

The other process (`plug_in_process`) has the training readings. Truth, test readings and the order of the trials stay
here. It gets one reading at a time, and must answer before it gets the next: with all readings of a trial at once it
could look ahead. Trials come in an order that nobody knows, and random numbers without the seed that they come from:
trials letter by letter, and a seed that names the letter, would give the truth away.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from time import monotonic
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import ArrayLike
from pydantic import ConfigDict

from tactsim.bench.leaderboard.messages import Message, receive, send
from tactsim.core import InputError, Scan
from tactsim.core.cache_folder import FOLDER_VARIABLE, cache_folder
from tactsim.core.compiling import kernel_folder
from tactsim.core.errors import printable
from tactsim.core.plug_ins import plug_ins
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimate, Estimator, Options, PoseSamples
from tactsim.estimators.estimator import check_estimate, unflatten_work
from tactsim.estimators.registry import BUILT_IN, GROUP

_CHILD = "tactsim.bench.leaderboard.plug_in_process"
_KEPT = 4000  # characters of what a plug-in prints, the last
_SPAWNED = 8  # generators that a trial's generator can spawn and that are the same as without this process
_GRACE = 10.0  # s after a limit until the system ends a process whose parent has died
_LONGEST = 500  # characters of a status


@dataclass(frozen=True)
class Limits:
    """What a plug-in may take: seconds by the clock for `fit` and for a trial, MB of memory beside the libraries."""

    fit_s: float = 1800.0
    trial_s: float = 300.0
    memory_mb: int = 4000


class NoScore(Exception):
    """An estimator that failed: its status, in one line, and the last that it printed."""

    def __init__(self, status: str, output: str = "") -> None:
        super().__init__(status)
        self.status, self.output = printable(" ".join(status.split()))[:_LONGEST], output


class _Stated(Options):
    """Options as another process states them."""

    model_config = ConfigDict(frozen=True, extra="allow")


class Confined(Estimator):
    """An estimator whose work is done in another process; `confined` makes one.

    Raises NoScore for what the other process does not do, does too slowly, or may not do.
    """

    def __init__(
        self, pipe: socket.socket, process: subprocess.Popen[bytes], folder: Path, limits: Limits
    ) -> None:
        super().__init__(Options())
        self.output: deque[str] = deque(maxlen=_KEPT)
        self._pipe, self._process, self._folder, self._limits = pipe, process, folder, limits
        self._letters: tuple[str, ...] = ()
        self._left = limits.fit_s
        self._seconds = 0.0
        self._work: dict[str, int] = {}
        self._answer = Message({})
        self._about: dict[str, Any] = {}
        self._proposes = False
        self._reader = Thread(target=_read, args=(process, self.output), daemon=True)
        self._reader.start()

    def begin(self, name: str, options: Mapping[str, Any], package: str) -> None:
        """Have the estimator made. Raises InputError if there is none of that name, or for a wrong option."""
        said = {"estimator": name, "options": dict(options), "package": package}
        answer = self._ask("begin", {**said, "memory_mb": self._limits.memory_mb}).words
        if "refused" in answer:
            raise InputError(str(answer["refused"]))
        try:
            self._about = dict(answer["about"])
            self.options = _Stated(**self._about["options"])
            self._proposes = bool(answer["proposes"])
            budget = self._about["budget"]
            self.budget = None if budget is None else str(budget["option"])
        except (KeyError, TypeError, ValueError) as error:
            raise self._no_message(error) from error

    @property
    def settings(self) -> dict[str, Any]:
        """Give the options that are not the defaults."""
        return self._about["settings"]

    def describe(self) -> str:
        """Say in one line how the estimator is set up, as it says itself."""
        return str(self._about["description"])

    @property
    def proposes(self) -> bool:
        """Tell whether the estimator proposes readings."""
        return self._proposes

    def clock(self) -> float:
        """Give the seconds of processor time that the estimator's process has worked, as it says itself."""
        return self._seconds

    def fit(self, scan: Scan) -> None:
        """Have the estimator made anew and learn; it is given the training readings.

        Of the scan's `meta` it is told the objects and how they were pressed, but for the seed.
        """
        self._left = self._limits.fit_s
        train = _training(scan)
        train.save(self._folder / "training.npz")
        self._letters = train.letters
        self._count(self._ask("fit", {}))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial, with random numbers as `rng` gives them."""
        self._left = self._limits.trial_s
        seed = cast(SeedSequence, rng.bit_generator.seed_seq)
        words = [one.generate_state(4, np.uint64) for one in (seed, *seed.spawn(_SPAWNED))]
        # Sent as floats of the same bits.
        self._count(self._ask("reset", {}, {"words": np.array(words).view(float)}))

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Hand over one reading; the estimate comes back with the answer."""
        arrays = {"reading": np.asarray(reading), "sensor_in_robot": np.asarray(sensor_in_robot)}
        self._answer = self._ask("update", {}, arrays)
        self._count(self._answer)
        self._seconds += self._timed(0)

    def estimate(self) -> Estimate:
        """Give the estimate that came with the last answer."""
        words, arrays = self._answer.words, self._answer.arrays
        self._seconds += self._timed(1)
        try:
            samples = PoseSamples(arrays["poses"], arrays["weights"]) if "weights" in arrays else None
            found = Estimate(words["label"], words["probabilities"], arrays["robot_in_object"], samples)
            check_estimate(found, self, (*self._letters, NONE))
        except (InputError, KeyError, TypeError, AttributeError) as error:
            raise self._no_message(error) from error
        return found

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Have one of the poses (n, 3) chosen."""
        self._answer = self._ask("propose", {}, {"candidates": np.asarray(candidates)})
        self._seconds += self._timed(0)
        chosen = self._answer.words.get("chosen")
        if not (isinstance(chosen, int) and 0 <= chosen < len(candidates)):
            raise self._failed(f"crashed: it proposed {chosen} of {len(candidates)} touches")
        return chosen

    @property
    def work(self) -> dict[str, Any]:
        """Count what was done, as the estimator says itself."""
        return unflatten_work(self._work)

    def end(self) -> None:
        """End the other process, whatever it does, and take all that it has printed."""
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def _ask(
        self, what: str, words: Mapping[str, Any], arrays: Mapping[str, FloatArray] | None = None
    ) -> Message:
        start = monotonic()
        try:
            send(self._pipe, Message({"do": what, "seconds": self._left + _GRACE, **words}, arrays or {}))
            answer = receive(self._pipe, start + self._left)
        except TimeoutError:
            limit = self._limits.trial_s if what in ("reset", "update", "propose") else self._limits.fit_s
            raise self._failed(
                f"timed out: {_STAGES.get(what, 'a trial')} took more than {limit:g} s"
            ) from None
        except (EOFError, OSError):
            raise self._failed(f"crashed: {self._how_it_ended()}") from None
        except ValueError as error:
            raise self._no_message(error) from error
        self._left -= monotonic() - start
        if "status" in answer.words:
            raise self._failed(str(answer.words["status"]))
        return answer

    def _count(self, answer: Message) -> None:
        work = answer.words.get("work")
        if not (
            isinstance(work, dict)
            and all(type(count) is int and abs(count) < 2**62 for count in work.values())
        ):
            raise self._no_message("counts of work that are none")
        self._work = work

    def _timed(self, which: int) -> float:
        try:
            seconds = float(self._answer.words["seconds"][which])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise self._no_message(error) from error
        if not 0 <= seconds < 1e6:
            raise self._no_message("a time that is none")
        return seconds

    def _no_message(self, error: object) -> NoScore:
        return self._failed(f"crashed: its process answered what it should not: {error}")

    def _failed(self, status: str) -> NoScore:
        self.end()
        return NoScore(status, "".join(self.output))

    def _how_it_ended(self) -> str:
        try:
            ended = self._process.wait(5)
        except subprocess.TimeoutExpired:
            return "it closed what it was to answer through"
        if ended >= 0:
            return f"its process ended by itself, with status {ended}"
        name = signal.Signals(-ended).name
        more = "; the system may have run out of memory" if name == "SIGKILL" else ""
        return f"its process was ended by {name}{more}"


_STAGES = {"begin": "its import", "fit": "fit"}


def is_plug_in(name: str) -> bool:
    """Tell whether an estimator comes from an installed package, not from this one."""
    return name not in BUILT_IN


def module_of(name: str) -> str:
    """Name the module of a plug-in, which is not imported; "tactsim" for any other name."""
    points = [point for point in plug_ins(GROUP) if point.name == name and is_plug_in(name)]
    return points[0].module if points else "tactsim"


@contextmanager
def confined(name: str, options: Mapping[str, Any], limits: Limits) -> Iterator[Confined]:
    """Start a process with the estimator of that name; the process ends with the block.

    Raises InputError for an unknown name or a wrong option, and on a system without the limits of POSIX, as Windows.
    Raises NoScore if the process fails.
    """
    if find_spec("resource") is None:
        raise InputError(
            f"{name} is a plug-in, and this system cannot confine one: its limits are those of Linux and macOS; "
            "submit and verify there"
        )
    with TemporaryDirectory(prefix="tactsim-") as folder:
        ours, theirs = socket.socketpair()
        with ours:
            with theirs:
                process = subprocess.Popen(
                    [sys.executable, "-m", _CHILD, str(theirs.fileno())], cwd=folder, env=_environment(folder),
                    pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, start_new_session=True,
                )  # fmt: skip
            estimator = Confined(ours, process, Path(folder), limits)
            try:
                estimator.begin(name, options, module_of(name))
                yield estimator
            finally:
                estimator.end()


def _training(scan: Scan) -> Scan:
    """Give the training readings, and of how they were made what an estimator may know: not the seed."""
    train = scan.where("train")
    meta = {name: train.meta[name] for name in ("objects", "options") if name in train.meta}
    if isinstance(meta.get("options"), Mapping):
        meta["options"] = {**meta["options"], "seed": 0}
    return Scan(
        train.readings, train.poses, train.labels, train.split, train.taxel_xy, json.loads(json.dumps(meta)),
        train.sequence, train.sequence_times, train.sequence_force, train.loads,
    )  # fmt: skip


def _environment(folder: str) -> dict[str, str]:
    """Give the variables that a plug-in's process sees: none of the user's own, and its folder as home."""
    kept = ("PATH", "LANG", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "PYTHONHASHSEED")
    ends = ("_NUM_THREADS", "_CORETYPE")
    found = {name: value for name, value in os.environ.items() if name in kept or name.endswith(ends)}
    if (kernels := kernel_folder("tactsim")) is not None:
        # Numba must be able to write where it reads. What a plug-in writes there is seen by no other process.
        shutil.copytree(kernels, Path(folder, "kernels", kernels.name), dirs_exist_ok=True)
    path = os.pathsep.join(str(Path(place).absolute()) for place in sys.path)
    return found | {
        "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "HOME": folder, "TMPDIR": folder,
        "NUMBA_CACHE_DIR": str(Path(folder, "kernels")),
        FOLDER_VARIABLE: str(cache_folder().absolute()),
    }  # fmt: skip


def _read(process: subprocess.Popen[bytes], output: deque[str]) -> None:
    """Take what a plug-in prints, so that it neither waits nor reaches the terminal; the last is kept."""
    with cast(BinaryIO, process.stdout) as stream:
        while content := os.read(stream.fileno(), 1 << 16):
            output.extend(content.decode(errors="replace"))
