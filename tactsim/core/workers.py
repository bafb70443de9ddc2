"""Start worker processes that end with the work, also after Ctrl-C or the death of a worker.

Each process has a pipe of its own and a thread here that waits for it. So a process that dies, at any moment, is
the end of its own pipe and of nothing else. concurrent.futures' ProcessPoolExecutor shares its two pipes and their
locks among all processes: it hangs if one dies while another starts, or while it sends a large result.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple, ParamSpec, TypeVar

from tactsim.core.errors import InputError

_UNGUARDED = 78  # the exit status of a worker whose import of the script would start workers again
_ENDING = 5.0  # seconds within which a process whose pipe is closed has ended
_GUARD = (
    "worker processes import the script that starts them: put the call under `if __name__ == '__main__':`, "
    "or use jobs=1"
)

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def worker_processes(count: int) -> Iterator[Workers]:
    """Start `count` processes; Ctrl-C is left to their parent.

    The processes end with the block, and with their parent. After an exception in the block they are killed, and work
    that has not begun is dropped. If a worker dies, asking for the result of what it did, or was to do, raises
    concurrent.futures.BrokenExecutor. Raises InputError where a process cannot import the script that called.
    """
    _check_script()
    workers = Workers(count)
    try:
        for _ in range(count):
            workers.start_process()
        yield workers
        workers.shutdown()
    except BaseException:
        workers.kill()
        workers.shutdown()
        raise
    finally:
        workers.leave()


class Workers(ThreadPoolExecutor):
    """Threads that each hand a task to an idle process and wait for its answer."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self._started: list[_Worker] = []
        self._idle: SimpleQueue[_Worker] = SimpleQueue()

    def start_process(self) -> None:
        """Start one more process."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        with theirs:  # open in the worker alone, so that the worker's death closes it
            process = context.Process(target=_work, args=(theirs,))
            process.start()
        self._started.append(_Worker(ours, process))
        self._idle.put(self._started[-1])

    def kill(self) -> None:
        """End all processes at once, whatever they do: their results are not needed."""
        self.shutdown(wait=False, cancel_futures=True)
        for worker in self._started:
            worker.process.kill()

    def leave(self) -> None:
        """Let the processes end, and wait until they have."""
        for worker in self._started:
            worker.pipe.close()
        for worker in self._started:
            worker.process.join()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Let a process call fn, which it must be able to import."""
        return super().submit(self._hand_over, fn, args, kwargs)

    def _hand_over(self, *task: Any) -> Any:
        message = pickle.dumps(task)
        worker = self._idle.get()
        try:
            worker.pipe.send_bytes(message)
            answer = worker.pipe.recv_bytes()
        except (EOFError, OSError) as error:
            worker.process.join(_ENDING)
            if worker.process.exitcode == _UNGUARDED:
                raise InputError(_GUARD) from None
            raise BrokenExecutor("a worker process died") from error
        finally:
            self._idle.put(worker)
        result, failure = pickle.loads(answer)
        if failure is not None:
            raise failure
        return result


class _Worker(NamedTuple):
    pipe: Connection
    process: SpawnProcess


def _check_script() -> None:
    """Raise InputError if a process cannot import what is run; end this process if it is one that only imports it."""
    if getattr(current_process(), "_inheriting", False):  # as `multiprocessing` itself knows it
        os._exit(_UNGUARDED)
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    if script and getattr(main, "__spec__", None) is None and not Path(script).exists():
        raise InputError(
            f"worker processes cannot import {script}, which is no file; use jobs=1 or write a script"
        )


def _work(pipe: Connection) -> None:
    """Do one task after another until the parent closes the pipe or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            message = pipe.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)  # freeing every object first takes half a second
        try:
            fn, args, kwargs = pickle.loads(message)
            answer = pickle.dumps((fn(*args, **kwargs), None))
        except BaseException as error:
            answer = _failure(error)
        try:
            pipe.send_bytes(answer)
        except OSError:
            os._exit(0)


def _end_with_parent() -> None:
    """End this process when its parent has ended, also in the middle of a task."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _failure(error: BaseException) -> bytes:
    """Write an error for the parent, with its place; one that cannot be sent, or would end the parent, in words."""
    place = f"In a worker process:\n{traceback.format_exc()}"
    if isinstance(error, Exception):
        error.add_note(place)
        try:
            answer = pickle.dumps((None, error))
            pickle.loads(answer)  # what cannot be read again would be another error there
            return answer
        except Exception:
            pass
    in_words = RuntimeError("".join(traceback.format_exception_only(error)).strip().partition("\n")[0])
    in_words.add_note(place)
    return pickle.dumps((None, in_words))
