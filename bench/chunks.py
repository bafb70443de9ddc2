"""Chunks of a sweep's runs: the trials that a worker does at once, and the file that keeps them meanwhile.

A chunk's file is kept until its run is whole. It begins with a seal: a hash of its content, and of the source
code, the libraries and the readings that made it. A chunk whose seal differs is done again, so that no run mixes
results of different source code.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path

import numpy as np

from tactsim.bench.machine import versions
from tactsim.bench.trial_plan import TrialPlan
from tactsim.bench.trials import OneTrial, Trials
from tactsim.core import InputError
from tactsim.core.documents import LARGE, parse_json
from tactsim.core.files import read_bytes, replacing
from tactsim.core.npz import read_npz

MOST_TRIALS = 20  # trials of a chunk: the most that a worker loses when it is killed


@dataclass(frozen=True)
class Chunk:
    """Some trials of one run. made_with: what their result depends on, for the seal."""

    run: str
    number: int
    tasks: tuple[OneTrial, ...]
    made_with: str

    def path(self, folder: Path) -> Path:
        """Name the chunk's file in a sweep's folder."""
        return folder / "chunks" / f"{self.run}.{self.number:05d}.npz"

    def seal(self, body: bytes) -> bytes:
        """Hash a file's content with which trials it holds and what they were made with: 32 bytes."""
        tasks = json.dumps([[task.truth, task.trial] for task in self.tasks])
        return hashlib.sha256(f"{self.made_with} {tasks}".encode() + body).digest()


def chunks_of(name: str, plan: TrialPlan, letters: Iterable[str], trials: int) -> list[Chunk]:
    """Divide a run into chunks of at most MOST_TRIALS trials, letter after letter.

    A chunk goes on with the next letter, so that a run of few trials is one chunk, for which one worker fits once.
    """
    trying = [plan.readings, plan.seed, plan.explore, plan.press is not None, plan.slip.model_dump()]
    trying.append(plan.each_held_out)
    made_with = json.dumps([plan.source, plan.digest, trying, versions()], sort_keys=True)
    tasks = [OneTrial(letter, trial) for letter in letters for trial in range(trials)]
    return [
        Chunk(name, number, tuple(tasks[first : first + MOST_TRIALS]), made_with)
        for number, first in enumerate(range(0, len(tasks), MOST_TRIALS))
    ]


class Waiting:
    """Chunks that no worker has yet, handed out so that few workers fit the estimator of the same run."""

    def __init__(self, chunks: Iterable[Chunk]) -> None:
        self._of_run: dict[str, deque[Chunk]] = {}
        for chunk in chunks:
            self._of_run.setdefault(chunk.run, deque()).append(chunk)
        self._untouched = deque(self._of_run)

    def __len__(self) -> int:
        """Count the runs with chunks left."""
        return len(self._of_run)

    def take(self, run: str | None = None) -> Chunk:
        """Take a chunk: of `run` if it has one left, or else of a run of which none was taken, or of any.

        Raises IndexError if no chunk is left.
        """
        if run not in self._of_run:
            if not self._of_run:
                raise IndexError("no chunk is left")
            untouched = self._untouched.popleft() if self._untouched else None
            run = untouched or max(self._of_run, key=lambda name: len(self._of_run[name]))
        chunk = self._of_run[run].popleft()
        if not self._of_run[run]:
            del self._of_run[run]
        return chunk


def save_chunk(folder: Path, chunk: Chunk, trials: Trials, work: Mapping[str, int]) -> None:
    """Keep a chunk that is done, whole or not at all. Raises InputError if it cannot be written."""
    content = BytesIO()
    arrays = {field.name: getattr(trials, field.name) for field in fields(Trials)}
    np.savez(content, allow_pickle=False, work=np.array(json.dumps(work)), **arrays)
    body = content.getvalue()
    with replacing(chunk.path(folder)) as stream:
        stream.write(chunk.seal(body) + body)


def load_chunk(folder: Path, chunk: Chunk) -> tuple[Trials, dict[str, int]] | None:
    """Read a chunk that is done; None if there is no file, or its seal differs."""
    try:
        content = read_bytes(chunk.path(folder), LARGE)
    except InputError:
        return None
    if chunk.seal(content[32:]) != content[:32]:
        return None
    try:
        arrays = read_npz(BytesIO(content[32:]), ("work", *(field.name for field in fields(Trials))))
        work = parse_json(str(arrays.pop("work")), "work")
    except InputError:
        return None
    return Trials(**arrays), work
