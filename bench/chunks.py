"""Chunks of a sweep's runs: the trials that a worker does at once, and the file that keeps them meanwhile.

A chunk's file is kept until its run is whole. It begins with a seal: a hash of its content, and of the source
code, the libraries and the readings that made it. A chunk whose seal differs is done again, so that no run mixes
results of different source code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path

import numpy as np

from tactsim.bench.machine import versions
from tactsim.bench.trial_plan import TrialPlan
from tactsim.bench.trials import Task, Trials
from tactsim.core import InputError
from tactsim.core.documents import LARGE, parse_json
from tactsim.core.files import read_bytes, replacing
from tactsim.core.npz import read_npz

MOST_TRIALS = 20  # trials of a chunk: the most that a worker loses when it is killed


@dataclass(frozen=True)
class Chunk:
    """Some trials of one letter in one run. made_with: what their result depends on, for the seal."""

    run: str
    number: int
    tasks: tuple[Task, ...]
    made_with: str

    def path(self, folder: Path) -> Path:
        """Name the chunk's file in a sweep's folder."""
        return folder / "chunks" / f"{self.run}.{self.number:05d}.npz"

    def seal(self, body: bytes) -> bytes:
        """Hash a file's content with what it was made with: 32 bytes."""
        return hashlib.sha256(self.made_with.encode() + body).digest()


def chunks_of(name: str, plan: TrialPlan, letters: Iterable[str], trials: int) -> list[Chunk]:
    """Divide a run into chunks of at most MOST_TRIALS trials of one letter."""
    trying = [plan.readings, plan.seed, plan.explore, plan.press is not None, plan.slip.model_dump()]
    trying.append(plan.each_held_out)
    made_with = json.dumps([plan.source, plan.digest, trying, versions()], sort_keys=True)
    tasks = [
        tuple(Task(letter, trial) for trial in range(first, min(first + MOST_TRIALS, trials)))
        for letter in letters
        for first in range(0, trials, MOST_TRIALS)
    ]
    return [Chunk(name, number, some, made_with) for number, some in enumerate(tasks)]


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
