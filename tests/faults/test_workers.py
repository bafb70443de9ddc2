"""A worker process that dies: a run says so in one line, a sweep sends its trials out again."""

import os
import signal
import time
from pathlib import Path

import pytest
from test_kills import SWEEP, whole


def workers_of(process):
    """List the processes that a command has started to do its work."""
    found = []
    for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        with_words = Path(f"/proc/{child}/cmdline").read_bytes()
        if b"spawn_main" in with_words:
            found.append(int(child))
    return found


def wait_until(process, true):
    deadline = time.monotonic() + 60
    while not true():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)


def kill_one_worker(process, wait=0.0):
    wait_until(process, lambda: workers_of(process))
    time.sleep(wait)
    os.kill(workers_of(process)[0], signal.SIGKILL)


@pytest.mark.parametrize("wait", [0.0, pytest.param(2.0, marks=pytest.mark.slow)])
def test_a_run_whose_worker_dies_says_so_and_leaves_nothing(bench, wait):
    words = ["run", "--letters", "IO", "--trials", "2000", "--readings", "30", "--out", "out"]
    process = bench.start(*words, "--jobs", "2")
    kill_one_worker(process, wait)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "Traceback" not in errors
    assert "bench: a worker process died" in errors
    assert not (bench.folder / "out").exists()
    assert bench(*words[:4], "4", *words[5:]).returncode == 0


def test_a_sweep_whose_worker_dies_loses_nothing(bench):
    (bench.folder / "s.toml").write_text(SWEEP.replace("trials = 60", "trials = 400"))
    process = bench.start("sweep", "s.toml", "--jobs", "2", "--out", "out")
    wait_until(process, lambda: any((bench.folder / "out" / "chunks").glob("*.npz")))  # 1 of 80
    kill_one_worker(process)
    _, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    assert bench("sweep", "s.toml", "--jobs", "1", "--out", "again").returncode == 0
    assert whole(bench.folder / "out") == whole(bench.folder / "again")
