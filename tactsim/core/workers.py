"""Worker processes that end with the work, whatever ends it: a result, Ctrl-C, or the death of one."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """Start `count` processes; Ctrl-C is left to their parent.

    They are done when the block is; after an exception in it they are killed, and work not begun is
    dropped. A worker that dies raises concurrent.futures.BrokenExecutor where a result is asked for.
    """
    executor = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_leave_interrupts)
    try:
        yield executor
    except BaseException:
        # CPython may start a worker while it tidies up after another's death. It forgets that one, which then
        # holds up the shutdown for ever.
        workers = list((executor._processes or {}).values())
        executor.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.kill()
        raise
    finally:
        executor.shutdown()


def _leave_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
