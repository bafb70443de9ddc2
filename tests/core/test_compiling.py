"""What was compiled is used again only while all the source that it was made from is as it was."""

import os
import subprocess
import sys

import pytest

CALLEE = """
from numba import int64
from tactsim.core.compiling import compiled
STEP = 1

@compiled(int64(int64), called_from_python=False)
def callee(x):
    return x + 1
"""
BETWEEN = "from inner_loops.callee import STEP, callee\n"
CALLER = """
from numba import int64
from inner_loops.between import STEP, callee
from tactsim.core.compiling import compiled

@compiled(int64(int64))
def caller(x):
    return 10 * callee(x) + STEP
"""
ASK = "from inner_loops.caller import caller; print(caller(1), sum(caller.stats.cache_hits.values()))"


@pytest.fixture
def ask(tmp_path):
    package = tmp_path / "inner_loops"
    package.mkdir()
    for name, text in (("__init__", ""), ("callee", CALLEE), ("between", BETWEEN), ("caller", CALLER)):
        (package / f"{name}.py").write_text(text)

    def run(**changed):
        for name, (old, new) in changed.items():
            path = package / f"{name}.py"
            before = path.stat()
            path.write_text(path.read_text().replace(old, new))
            # As old and as long as before: only the content tells.
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        environment = os.environ | {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", ASK], env=environment, capture_output=True, text=True, check=True
        )
        value, hits = map(int, done.stdout.split())
        return value, hits == 1

    return run


def test_a_caller_is_compiled_again_when_what_it_calls_changes(ask):
    assert ask() == (21, False)
    assert ask() == (21, True)
    assert ask(callee=("x + 1", "x + 2")) == (31, False)
    assert ask() == (31, True)


def test_a_constant_of_an_imported_file_counts_too(ask):
    assert ask() == (21, False)
    assert ask(callee=("STEP = 1", "STEP = 7")) == (27, False)


def test_the_own_file_counts(ask):
    assert ask() == (21, False)
    assert ask(caller=("10 * ", "20 * ")) == (41, False)
