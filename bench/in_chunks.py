"""Do many trials in several processes, some at a time; this process is one of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Generic, TypeVar

import numpy as np

from tactsim.bench.trials import Progress
from tactsim.core.workers import Workers, worker_processes

_Task = TypeVar("_Task")
_Part = TypeVar("_Part")

# Chunks for each process: so many that none waits long for the last of another.
_CHUNKS = 8


class _Overtaken(Exception):
    """A worker has done the chunk that was done here at the same time."""


@dataclass(frozen=True, eq=False)
class Begun(Generic[_Task, _Part]):
    """Tasks with which worker processes, if there are any, have begun, in chunks, from the first one on."""

    chunks: list[list[_Task]]
    futures: list[Future[tuple[_Part, dict[str, int]]]]
    workers: Workers | None

    def finish(
        self,
        do: Callable[[list[_Task], Callable[[int], None]], tuple[_Part, dict[str, int]]],
        progress: Progress,
    ) -> tuple[list[_Part], Counter[str]]:
        """Do chunks here, from the last one on, until none waits; then those that workers have not done yet.

        A worker may still be starting when all else is done. So a chunk may be done twice at once; it gives the same,
        and what is there first counts. do: takes some tasks, and a function to be told how many of them are done;
        returns what they gave and the work, flattened. Returns what the chunks gave, in the order of the tasks, and the
        work of all of them. Raises what a chunk raised, and BrokenExecutor if a worker died.
        """
        every = sum(map(len, self.chunks))
        here: dict[int, tuple[_Part, dict[str, int]]] = {}

        def there(place: int) -> bool:
            future = self.futures[place]
            if not future.done() or future.cancelled():
                return False
            future.result()  # the error of a worker ends the work now, and not when all else is done
            return True

        def report(done: int) -> None:
            known = [place for place in range(len(self.chunks)) if place in here or there(place)]
            progress("trials", min(every, done + sum(len(self.chunks[place]) for place in known)), every)

        report(0)
        places = list(reversed(range(len(self.chunks))))
        for place in places:
            if not self.futures[place].cancel():
                break
            here[place] = do(self.chunks[place], report)
        for place in places:
            if place in here or there(place):
                continue

            def report_unless_overtaken(done: int, place: int = place) -> None:
                if there(place):
                    raise _Overtaken
                report(done)

            with suppress(_Overtaken):
                here[place] = do(self.chunks[place], report_unless_overtaken)
        report(0)
        parts, work = [], Counter[str]()
        for place, future in enumerate(self.futures):
            part, of_part = here[place] if place in here else future.result()
            parts.append(part)
            work.update(of_part)
        if self.workers is not None:
            self.workers.kill()
        return parts, work


@contextmanager
def begun(
    do: Callable[[list[_Task]], tuple[_Part, dict[str, int]]],
    tasks: list[_Task],
    *,
    jobs: int,
    group: Callable[[_Task], Any] | None = None,
) -> Iterator[Begun[_Task, _Part]]:
    """Begin with tasks in `jobs` - 1 worker processes, which end with the block; what they leave is done here.

    do: takes some tasks in a worker, and returns what they gave and the work, flattened. With one job or task there is
    no worker. group: neighbours for which it gives the same are done together, as a chunk of their own; without it
    tasks are divided evenly.
    """
    if jobs == 1 or len(tasks) == 1:
        yield Begun([tasks], [Future()], None)  # nobody begins with it, so it is done here
        return
    if group is None:
        pieces = np.array_split(np.arange(len(tasks)), min(len(tasks), _CHUNKS * jobs))
        chunks = [[tasks[i] for i in piece] for piece in pieces]
    else:
        chunks = [list(alike) for _, alike in groupby(tasks, key=group)]
    with worker_processes(max(1, min(jobs, len(chunks)) - 1)) as workers:
        yield Begun(chunks, [workers.submit(do, chunk) for chunk in chunks], workers)
