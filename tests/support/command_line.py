"""The command line as a user calls it: the installed command `bench`, in a folder of its own."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

BENCH = Path(sys.executable).parent / "bench"


class Bench:
    """The installed command in a folder, with a cache; `folder / "cache"` unless another is given."""

    def __init__(self, folder, cache=None):
        self.folder = folder
        self.environment = os.environ | {
            "TACTSIM_CACHE_DIR": str(cache or folder / "cache"), "COLUMNS": "120", "NO_COLOR": "1",
        }  # fmt: skip

    def start(self, *words, **options):
        """Start `bench` in a session of its own, so that all its processes can be killed together."""
        return subprocess.Popen(
            [BENCH, *map(str, words)], cwd=self.folder, env=self.environment, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, **options,
        )  # fmt: skip

    def __call__(self, *words, **options):
        """Call `bench` and wait for its end; gives its status and what it said."""
        process = self.start(*words, **options)
        output, errors = process.communicate(timeout=240)
        return subprocess.CompletedProcess(words, process.returncode, output, errors)


@contextmanager
def emulated(bench, *words):
    """Run `bench emulate` as long as a `with` goes on; gives the name of the port that it prints."""
    process = bench.start("emulate", *words)
    try:
        yield process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 130


def wait_until(process, condition, seconds=90):
    """Wait until something holds while a command is at work."""
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)


def refused(result, *parts):
    """Check for exit status 2, one line on standard error that says each of `parts`, no traceback."""
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("bench")]
    assert len(lines) == 1, result.stderr
    for part in parts:
        assert part in lines[0], lines[0]
