"""Do many trials in worker processes, some at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import as_completed
from typing import TypeVar

import numpy as np

from tactsim.bench.trials import Progress
from tactsim.core.workers import worker_processes

_Task = TypeVar("_Task")
_Part = TypeVar("_Part")

# Chunks for each process: so many that none waits long for the last of another.
_CHUNKS = 8


def done_in_chunks(
    do: Callable[[list[_Task]], tuple[_Part, dict[str, int]]],
    tasks: list[_Task],
    *,
    jobs: int,
    progress: Progress,
) -> tuple[list[_Part], Counter[str]]:
    """Do tasks in `jobs` processes. do: takes some tasks, and returns what they gave and the work, flattened.

    Returns what the parts gave, in the order of the tasks, and the work of all of them.
    """
    chunks = np.array_split(np.arange(len(tasks)), min(len(tasks), _CHUNKS * jobs))
    parts: dict[int, _Part] = {}
    work: Counter[str] = Counter()
    done = 0
    progress("trials", 0, len(tasks))
    with worker_processes(jobs) as pool:
        futures = {pool.submit(do, [tasks[i] for i in chunk]): place for place, chunk in enumerate(chunks)}
        for future in as_completed(futures):
            parts[futures[future]], part_work = future.result()
            work.update(part_work)
            done += len(chunks[futures[future]])
            progress("trials", done, len(tasks))
    return [parts[place] for place in range(len(chunks))], work
