import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(sys.executable).parent / "bench"


class Bench:
    """The installed command in a folder of its own, with a cache of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.environment = os.environ | {
            "TACTSIM_CACHE_DIR": str(folder / "cache"), "COLUMNS": "120", "NO_COLOR": "1",
        }  # fmt: skip

    def start(self, *words, **options):
        """Start `bench` in a session of its own, so that all its processes can be killed together."""
        return subprocess.Popen(
            [BENCH, *map(str, words)], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, **options,
        )  # fmt: skip

    def __call__(self, *words, **options):
        process = self.start(*words, **options)
        output, errors = process.communicate(timeout=240)
        return subprocess.CompletedProcess(words, process.returncode, output, errors)


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


@pytest.fixture(scope="session")
def scan_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scan")
    assert Bench(folder)("scan", "--out", "two.npz", "--letters", "IO").returncode == 0
    return folder / "two.npz"


def refused(result, *parts):
    """Check for exit status 2, one line on standard error that says each of `parts`, no traceback."""
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("bench")]
    assert len(lines) == 1, result.stderr
    for part in parts:
        assert part in lines[0], lines[0]
