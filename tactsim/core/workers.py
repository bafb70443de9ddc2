"""Worker processes that end with the work, whatever ends it: a result, Ctrl-C, or the death of one."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any


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
        manager: Any = executor._executor_manager_thread
        executor.shutdown(wait=False, cancel_futures=True)
        # CPython before 3.13 tells every pending task that its worker died, and its thread fails at a cancelled
        # one. It drops those first, unless the workers die before it gets to that.
        while manager is not None and manager.is_alive() and executor._cancel_pending_futures:
            time.sleep(1e-3)
        for worker in workers:
            worker.kill()
        raise
    finally:
        executor.shutdown()


def _leave_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
