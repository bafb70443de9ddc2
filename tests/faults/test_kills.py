"""kill -9 at random moments: nothing half-written is taken for whole, and the next command works."""

import os
import random
import shutil
import signal
import subprocess
import time

import pytest

from tactsim.bench.runs.saved import load
from tactsim.core import Scan
from tactsim.hardware.recording import Kind, RecordReader, check_whole


def sweep_of(scan, trials):
    """Write the sweep of two runs over the readings of a file."""
    return (
        f'[defaults]\nscan = "{scan}"\ntrials = {trials}\nreadings = 3\n'
        '[[run]]\nestimator = "histogram"\nbins = [100, 1000]\n'
    )


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


def check_sweep(out):
    for place in (out / "runs").glob("[!.]*"):
        assert load(place).trials.label.shape == (60, 3)


COMMANDS = {
    "scan": (["scan", "--letters", "IO", "--out", "out.npz"], check_scan),
    "sweep": (["sweep", "s.toml", "--jobs", "1", "--out", "out"], check_sweep),
}


# A run is written as those of a sweep are.
@pytest.mark.long
@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_again_and_again_it_ends_with_the_same_bytes(bench, scan_file, name, kills):
    words, check = COMMANDS[name]
    shutil.copy(scan_file, bench.folder / "two.npz")
    (bench.folder / "s.toml").write_text(sweep_of("two.npz", trials=30))
    out, kept = bench.folder / words[words.index("--out") + 1], bench.folder / "kept"
    start = time.monotonic()
    assert bench(*words, "--no-cache").returncode == 0
    duration = time.monotonic() - start
    out.rename(kept)
    expected = whole(kept) if kept.is_dir() else kept.read_bytes()

    chance = random.Random(kills)
    struck = reported = 0
    for number in range(6 * kills):
        if struck == kills:
            break
        while_writing = number % 2 == 1
        moment = duration * (2 if while_writing else chance.uniform(0.1, 1.0))
        at_work = kill_at(bench.start(*words), moment, bench.folder, while_writing)
        struck += at_work
        if not at_work and not while_writing:
            duration = 0.7 * moment  # faster than when it was measured
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
    assert struck == kills, "too few commands were still at work when they were killed"

    words = ["2" if word == "1" else word for word in words]  # what one process began two may end
    result = bench(*words)
    assert result.returncode == 0, result.stderr
    assert (whole(out) if out.is_dir() else out.read_bytes()) == expected


@pytest.mark.long
@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_a_recording_killed_again_and_again_loses_nothing(bench, kills):
    presses = 2 * kills
    words = [
        "record", "--port", "pad", "--letter", "I", "--out", "I.npz", "--frames", "5", "--poses", f"random:{presses}",
        "--patience", "1", "--calibration", "cal.toml",
    ]  # fmt: skip
    journal, out = bench.folder / "I.tactrec", bench.folder / "I.npz"
    pad = ["--port", "pty:pad", "--follow", "I.tactrec", "--rate", "200", "--hold", "0.5", "--lift", "0.05"]
    emulator = bench.start("emulate", *pad)
    try:
        emulator.stdout.readline()
        assert bench("tare", "--port", "pad", "--out", "cal.toml").returncode == 0
        chance = random.Random(3)
        kept, marks = b"", 0
        for _ in range(kills):
            resume = ["--resume"] if journal.exists() else []
            process = bench.start(*words, *resume)
            kill_at(process, 2.0 + chance.uniform(0, 2), bench.folder, while_writing=False)
            if out.exists():
                break
            if journal.exists():
                content = journal.read_bytes()
                assert content.startswith(kept), "what was recorded once stays"
                kept = content[: check_whole(journal).whole_bytes]
                done = sum(record.kind is Kind.MARK for record in RecordReader(journal))
                assert done >= marks
                marks = done
        if not out.exists():
            result = bench(*words, *(["--resume"] if journal.exists() else []))
            assert result.returncode == 0, result.stderr
    finally:
        os.killpg(emulator.pid, signal.SIGKILL)
        emulator.communicate(timeout=30)
    assert len(Scan.load(out)) == presses
    assert check_whole(journal).finished
    again = bench("replay", "I.tactrec", "--scan", "again.npz")
    assert again.returncode == 0, again.stderr
    assert Scan.load(bench.folder / "again.npz").digest == Scan.load(out).digest
