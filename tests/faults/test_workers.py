"""A worker process that dies: a run says so in one line, a sweep sends its trials out again."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest
from command_line import wait_until
from test_kills import sweep_of, whole

from tactsim.bench import experiment, sweep
from tactsim.core import InputError
from tactsim.core.workers import batches, wait_for, worker_processes


def workers_of(process):
    """List the processes that a command has started to do its work."""
    found = []
    for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        with_words = Path(f"/proc/{child}/cmdline").read_bytes()
        if b"spawn_main" in with_words:
            found.append(int(child))
    return found


def kill_one_worker(process):
    wait_until(process, lambda: workers_of(process))
    os.kill(workers_of(process)[0], signal.SIGKILL)


def at_work(pid):
    """Say whether a process exists and has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")")[-1].split()[0] != "Z"
    except OSError:
        return False


def refuse(value):
    raise InputError(f"{value} is wrong")


RUN = ["run", "--estimator", "histogram", "--bins", "100", "--readings", "30", "--out", "out", "--scan"]


@pytest.mark.long
def test_a_run_whose_worker_dies_at_its_start_says_so_and_leaves_nothing(bench, here, scan_file):
    process = bench.start(*RUN, scan_file, "--trials", "2000", "--jobs", "2")
    kill_one_worker(process)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "Traceback" not in errors
    assert "bench: a worker process died" in errors
    assert not (bench.folder / "out").exists()
    assert here(*RUN, scan_file, "--trials", "2").returncode == 0


@pytest.mark.long
def test_workers_end_with_a_run_that_is_killed(bench, scan_file):
    process = bench.start(*RUN, scan_file, "--trials", "2000", "--jobs", "3")
    wait_until(process, lambda: len(workers_of(process)) == 3)
    workers = workers_of(process)
    process.kill()  # it alone
    process.communicate(timeout=120)
    deadline = time.monotonic() + 60
    while any(map(at_work, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_an_exception_in_the_block_ends_work_that_would_last():
    with pytest.raises(KeyboardInterrupt), worker_processes(2) as pool:
        futures = [pool.submit(time.sleep, 600) for _ in range(8)]
        raise KeyboardInterrupt
    assert all(future.done() for future in futures)


def test_a_process_that_cannot_be_started_as_another_has_died_is_a_broken_pool():
    """Whoever gives up a pool closes its queue, perhaps while the next process is started."""
    with pytest.raises(BrokenExecutor), worker_processes(2) as pool:
        pool._call_queue._reader.close()
        pool.submit(refuse, 3)


class Locked(Exception):
    """It cannot be pickled."""

    def __init__(self):
        super().__init__("a lock")
        self.lock = threading.Lock()


def raise_locked():
    raise Locked


def raise_interrupt():
    raise KeyboardInterrupt


def test_an_error_of_a_task_comes_back_with_its_place_or_in_words_and_the_worker_lives_on():
    with worker_processes(1) as pool:
        error = pool.submit(refuse, 3).exception(timeout=60)
        assert isinstance(error, InputError)
        assert str(error) == "3 is wrong"
        assert "in refuse" in error.__notes__[0]
        with pytest.raises(AttributeError, match="local"):
            pool.submit(lambda: None).result(timeout=60)
        for task, said in ((raise_locked, "a lock"), (raise_interrupt, "KeyboardInterrupt")):
            error = pool.submit(task).exception(timeout=60)
            assert isinstance(error, RuntimeError)
            assert said in str(error)
            assert f"in {task.__name__}" in error.__notes__[0]
        assert list(pool.map(abs, [-1, 2])) == [1, 2]


def test_batches_hold_every_task_once_in_its_order_and_never_differ_by_more_than_one():
    for count in (1, 2, 7, 100):
        parts = batches(list(range(count)), 24)
        assert [task for part in parts for task in part] == list(range(count))
        assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.long
def test_an_error_of_a_worker_ends_the_work_at_once():
    """Otherwise a user would read of a mistake when all other trials are done."""
    began = time.monotonic()
    with pytest.raises(InputError, match="3 is wrong"), worker_processes(2) as pool:
        wait_for([(1, pool.submit(time.sleep, 600)), (1, pool.submit(refuse, 3))], lambda *word: None)
    assert time.monotonic() - began < 300


CALL = "with worker_processes(1) as pool: print(pool.submit(abs, -1).result())\n"
NO_SEMAPHORES = """
from tactsim.core.workers import process_map, worker_processes
with process_map(1) as each: print(*each(abs, [-1]), flush=True)
with worker_processes(2): pass
"""
GUARDED = "if __name__ == '__main__':\n    " + CALL


@pytest.mark.parametrize(
    ("words", "call", "said"),
    [
        (["script.py"], CALL, "put the call under `if __name__ == '__main__':`, or use jobs=1"),
        (["-m", "script"], CALL, "put the call under `if __name__ == '__main__':`, or use jobs=1"),
        (["script.py"], "print(__name__)\n" + CALL,
         "put the call under `if __name__ == '__main__':`, or use jobs=1"),
        (["script.py"], GUARDED, "1"),
        (["-m", "script"], GUARDED, "1"),
        (["-c", "from tactsim.core.workers import worker_processes\n" + CALL], "", "1"),
    ],
)  # fmt: skip
def test_a_script_that_workers_cannot_import_is_told_what_to_write(words, call, said, tmp_path):
    (tmp_path / "script.py").write_text("from tactsim.core.workers import worker_processes\n" + call)
    ended = subprocess.run(
        [sys.executable, *words], cwd=tmp_path, text=True, capture_output=True, timeout=120
    )
    assert said in (ended.stdout + ended.stderr).splitlines()[-1]
    assert ended.stderr.count("Traceback") == ended.returncode


@pytest.mark.parametrize("options", ["size=4k", "ro"])
def test_where_there_are_no_semaphores_it_is_said_and_one_process_needs_none(options):
    without = f"mount -t tmpfs -o {options} tmpfs /dev/shm && exec {sys.executable} -c '{NO_SEMAPHORES}'"
    ended = subprocess.run(
        ["unshare", "-rm", "sh", "-c", without], text=True, capture_output=True, timeout=120
    )
    if "unshare:" in ended.stderr or "mount:" in ended.stderr:
        pytest.skip("this machine lets nobody mount")
    assert "worker processes cannot share semaphores" in ended.stderr.splitlines()[-1]
    assert ended.stdout == "1\n"


@pytest.mark.long
def test_a_sweep_whose_workers_die_loses_nothing(bench, scan_file):
    (bench.folder / "s.toml").write_text(sweep_of(scan_file, trials=600))
    process = bench.start("sweep", "s.toml", "--jobs", "2", "--out", "out")
    kill_one_worker(process)
    wait_until(process, lambda: any((bench.folder / "out" / "runs").glob("[!.]*")))  # 1 of 2
    kill_one_worker(process)
    _, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    again = bench.folder / "again"
    again.mkdir()
    configs = sweep.read(str(bench.folder / "s.toml"))[1]
    sweep.perform(configs, again, jobs=1, progress=experiment.silent)
    assert whole(bench.folder / "out") == whole(again)
