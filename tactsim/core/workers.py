"""Start worker processes that end with the work, also after Ctrl-C or the death of a worker.

Each process has a pipe of its own and a thread here that waits for it. So a process that dies, at any moment, is
the end of its own pipe and of nothing else. concurrent.futures' ProcessPoolExecutor shares its two pipes and their
locks among all processes: it hangs if one dies while another starts, or while it sends a large result.
"""

from __future__ import annotations

import os
import pickle
import signal
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """Start `count` processes; Ctrl-C is left to their parent.

    The processes end with the block. After an exception in the block they are killed, and work that has not
    begun is dropped. If a worker dies, asking for the result of what it did, or was to do, raises
    concurrent.futures.BrokenExecutor.
    """
    threads = _Threads(count)
    processes: list[SpawnProcess] = []
    try:
        for _ in range(count):
            processes.append(threads.start_process())
        yield threads
        threads.shutdown()
    except BaseException:
        threads.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        threads.shutdown()
        raise
    finally:
        threads.close_pipes()
        for process in processes:
            process.join()


class _Threads(ThreadPoolExecutor):
    """Threads that each hand a task to an idle process and wait for its answer."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self._pipes: list[Connection] = []
        self._idle: SimpleQueue[Connection] = SimpleQueue()

    def start_process(self) -> SpawnProcess:
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        with theirs:  # open in the worker alone, so that the worker's death closes it
            process = context.Process(target=_work, args=(theirs,))
            process.start()
        self._pipes.append(ours)
        self._idle.put(ours)
        return process

    def close_pipes(self) -> None:
        for pipe in self._pipes:
            pipe.close()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        return super().submit(self._hand_over, fn, args, kwargs)

    def _hand_over(self, *task: Any) -> Any:
        message = pickle.dumps(task)
        pipe = self._idle.get()
        try:
            pipe.send_bytes(message)
            answer = pipe.recv_bytes()
        except (EOFError, OSError) as error:
            raise BrokenExecutor("a worker process died") from error
        finally:
            self._idle.put(pipe)
        result, failure = pickle.loads(answer)
        if failure is not None:
            raise failure
        return result


def _work(pipe: Connection) -> None:
    """Do one task after another until the parent closes the pipe or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            message = pipe.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)  # freeing every object first takes half a second
        try:
            fn, args, kwargs = pickle.loads(message)
            answer = pickle.dumps((fn(*args, **kwargs), None))
        except Exception as error:
            error.add_note(f"In a worker process:\n{traceback.format_exc()}")
            answer = pickle.dumps((None, error))
        try:
            pipe.send_bytes(answer)
        except OSError:
            os._exit(0)
