"""kill -9 at random moments: nothing half-written is taken for whole, and the next command works."""

import os
import random
import signal
import subprocess
import time

import pytest

from bench import results
from tactsim import Scan

SWEEP = """
[defaults]
letters = "IO"
trials = 60
readings = 3

[[run]]
estimator = "histogram"
bins = [100, 1000]
"""


def kill_at(process, moment, folder, while_writing):
    """Kill all of a command's processes after `moment` s, or as soon as it has a file half-written.

    Returns whether it was still at work.
    """
    deadline = time.monotonic() + moment
    while time.monotonic() < deadline and process.poll() is None:
        if while_writing and any(folder.rglob("*.part")):
            break
        time.sleep(0.001)
    at_work = process.poll() is None
    if at_work:
        os.killpg(process.pid, signal.SIGKILL)
    try:
        process.communicate(timeout=30)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return at_work


def whole(folder):
    """Read all that a command left under final names and that must not differ between two of it."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in name.parts)
        if path.is_file() and not hidden and not path.name.startswith("times."):
            found[str(name)] = path.read_bytes()
    return found


def check_scan(out):
    if out.exists():
        assert len(Scan.load(out)) == 768


def check_run(out):
    if out.exists():
        assert results.load(out).trials.label.shape == (8, 4)


def check_sweep(out):
    for place in (out / "runs").glob("[!.]*"):
        assert results.load(place).trials.label.shape == (120, 3)


COMMANDS = {
    "scan": (["scan", "--letters", "IO", "--out", "out"], check_scan),
    "run": (["run", "--letters", "IO", "--trials", "4", "--readings", "4", "--bins", "100", "--out", "out"], check_run),
    "sweep": (["sweep", "s.toml", "--jobs", "1", "--out", "out"], check_sweep),
}  # fmt: skip


def kill_again_and_again(bench, name, kills, seed):
    words, check = COMMANDS[name]
    (bench.folder / "s.toml").write_text(SWEEP)
    out, kept = bench.folder / "out", bench.folder / "kept"
    start = time.monotonic()
    assert bench(*words, "--no-cache").returncode == 0
    duration = time.monotonic() - start
    out.rename(kept)
    expected = whole(kept) if kept.is_dir() else kept.read_bytes()

    chance = random.Random(seed)
    struck = reported = 0
    for number in range(kills):
        while_writing = number % 2 == 1
        moment = duration * (2 if while_writing else chance.uniform(0.1, 1.0))
        struck += kill_at(bench.start(*words), moment, bench.folder, while_writing)
        check(out)
        if name == "sweep":  # what was done once stays done
            done = sum(1 for _ in (out / "runs").glob("[!.]*"))
            assert done >= reported
            reported = done
            if done == 2:  # nothing is left to be killed: begin anew
                out.rename(bench.folder / f"done{number}")
                reported = 0
        elif out.is_dir():
            out.rename(bench.folder / f"done{number}")
        else:
            out.unlink(missing_ok=True)
    assert struck >= kills / 3, "too few commands were still at work when they were killed"

    result = bench(*words)
    assert result.returncode == 0, result.stderr
    assert (whole(out) if out.is_dir() else out.read_bytes()) == expected


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_again_and_again_it_ends_with_the_same_bytes(bench, name):
    kill_again_and_again(bench, name, kills=4, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_many_moments_it_ends_with_the_same_bytes(bench, name):
    kill_again_and_again(bench, name, kills=20, seed=2)
