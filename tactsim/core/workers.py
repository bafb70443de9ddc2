"""Worker processes: those of concurrent.futures, started anew, that end with the work and with their parent."""

from __future__ import annotations

import os
import pickle
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import pairwise
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from tactsim.core.errors import InputError

_GUARD = (
    "worker processes import the script that starts them: put the call under `if __name__ == '__main__':`, "
    "or use jobs=1"
)
_GUARDED = re.compile(r"^\s*if\b.*\b__name__\b", re.MULTILINE)

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """Give an executor of `count` processes; Ctrl-C is left to their parent.

    The processes end with the block, and with their parent. After an exception in the block they are killed, and work
    that has not begun is dropped. If a worker dies, asking for any result that is missing raises
    concurrent.futures.BrokenExecutor. Raises InputError where a process cannot import the script that called, or the
    system gives no semaphores.
    """
    _check_script()
    others = set(active_children())
    try:
        made = _Pool(count, mp_context=get_context("spawn"), initializer=_begin)
    except OSError as error:  # semaphores are files of /dev/shm
        raise InputError(
            f"worker processes cannot share semaphores ({error}); make room in /dev/shm and let it be written, or use "
            "--jobs 1 (in Python jobs=1)"
        ) from error
    with made as pool:
        try:
            yield pool
        except BaseException:  # without its processes the pool gives up all that is left
            for process in set(active_children()) - others:
                process.kill()
            raise


@contextmanager
def process_map(count: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Give a `map` that keeps the order of its results, over `count` processes if these are several."""
    if count < 2:
        yield map
        return
    with worker_processes(count) as executor:
        yield executor.map


def batches(tasks: Sequence[T], most: int) -> list[list[T]]:
    """Divide tasks evenly, in their order, into at most so many batches, of which none is empty."""
    count = min(len(tasks), most)
    ends = [len(tasks) * k // count for k in range(count + 1)]
    return [list(tasks[first:end]) for first, end in pairwise(ends)]


def wait_for(sent: Sequence[tuple[int, Future[T]]], report: Callable[[int, int], None]) -> list[T]:
    """Wait for the results of batches, each with the number of its tasks; returns them in their order.

    report(done, total) is called with the number of tasks as batches end. Raises what a batch raised, as soon as it
    did, and BrokenExecutor if a worker died.
    """
    sizes = {future: size for size, future in sent}
    done, total = 0, sum(sizes.values())
    report(0, total)
    for future in as_completed(sizes):
        future.result()
        done += sizes[future]
        report(done, total)
    return [future.result() for _, future in sent]


class _Pool(ProcessPoolExecutor):
    """Processes whose tasks' errors come back whatever they are; one that cannot be read would break the pool."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Let a process call fn, which it must be able to import. Raises BrokenProcessPool if one has died."""
        try:
            return super().submit(_call, fn, args, kwargs)
        except OSError as error:
            # Python starts a further process while a thread gives up the pool, whose queue is closed by then.
            if str(error) != "handle is closed":
                raise
            raise BrokenProcessPool("a process died while others were started") from error


def _call(fn: Callable[..., Any], args: Any, kwargs: Any) -> Any:
    """Call a function in a worker. Its error is one that the parent can read, or a RuntimeError in words."""
    try:
        return fn(*args, **kwargs)
    except BaseException as error:
        place = f"In a worker process:\n{traceback.format_exc()}"
        if isinstance(error, Exception):  # an interrupt or an exit would end the parent
            error.add_note(place)
            try:
                pickle.loads(pickle.dumps(error))
            except Exception:
                pass
            else:
                raise
        in_words = RuntimeError("".join(traceback.format_exception_only(error)).strip().partition("\n")[0])
        in_words.add_note(place)
        raise in_words from None


def _begin() -> None:
    """Prepare a worker process: it ignores Ctrl-C, and ends when its parent has ended, even within a task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _check_script() -> None:
    """Raise InputError if a process cannot import the script that is run, or would start processes by importing it."""
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    # What `python -m package` runs is not imported by them; what `python -m module` runs is, as a script is.
    if not script or getattr(getattr(main, "__spec__", None), "name", "").endswith("__main__"):
        return
    path = Path(script)
    if not path.exists():
        raise InputError(
            f"worker processes cannot import {script}, which is no file; use jobs=1 or write a script"
        )
    if path.suffix == ".py" and not _GUARDED.search(path.read_text(encoding="utf-8", errors="replace")):
        raise InputError(_GUARD)
