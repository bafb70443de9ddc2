"""Start worker processes that end with the work, also after Ctrl-C or the death of a worker."""

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

    The processes end with the block. After an exception in the block they are killed, and work that has not
    begun is dropped. If a worker dies, asking for a result raises concurrent.futures.BrokenExecutor.
    """
    executor = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_leave_interrupts)
    try:
        yield executor
    except BaseException:
        # CPython may start a worker while it tidies up after another's death. It forgets the new worker, which
        # then blocks the shutdown for ever. So all workers are listed here and killed below.
        workers = list((executor._processes or {}).values())
        manager: Any = executor._executor_manager_thread
        executor.shutdown(wait=False, cancel_futures=True)
        # Before 3.13, CPython's manager thread tells every pending task that its worker died, and fails at a
        # cancelled task. So the workers live until the thread has dropped the cancelled tasks.
        while manager is not None and manager.is_alive() and executor._cancel_pending_futures:
            time.sleep(1e-3)
        for worker in workers:
            worker.kill()
        raise
    finally:
        executor.shutdown()


def _leave_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
