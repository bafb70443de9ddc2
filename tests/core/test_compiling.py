"""What was compiled is used again only for the same source and processor, and wherever it can be kept."""

import os
import shutil
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

    def run(environment=None, **changed):
        for name, (old, new) in changed.items():
            path = package / f"{name}.py"
            before = path.stat()
            path.write_text(path.read_text().replace(old, new))
            # As old and as long as before: only the content tells.
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        words = {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"} | (environment or {})
        done = subprocess.run(
            [sys.executable, "-c", ASK], env=os.environ | words, capture_output=True, text=True, check=True
        )
        run.said = done.stderr
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


def without(folder):
    """Let nothing be written to a folder, not even by root: a file is in its place."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.write_text("a file\n")


def test_another_processor_has_machine_code_of_its_own(ask):
    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert ask() == (21, False)
    assert ask(environment=other) == (21, False)
    assert ask(environment=other) == (21, True)
    assert ask() == (21, True)


def test_a_damaged_file_is_compiled_again(ask, tmp_path):
    ask()
    (kept,) = (tmp_path / "inner_loops" / "__pycache__").glob("caller.*.kernel")
    whole = kept.read_bytes()
    for content in (whole[:100], whole[:-1], b"", bytes(64) + whole[64:]):
        kept.write_bytes(content)
        assert ask() == (21, False)
        assert kept.read_bytes()[:32] == whole[:32]


def test_an_installation_that_cannot_be_written_uses_the_cache_folder(ask, tmp_path):
    without(tmp_path / "inner_loops" / "__pycache__")
    cache = {"TACTSIM_CACHE_DIR": str(tmp_path / "cache")}
    assert ask(environment=cache) == (21, False)
    assert ask(environment=cache) == (21, True)
    assert list((tmp_path / "cache").rglob("caller.*.kernel"))


def test_what_was_compiled_is_used_where_nothing_can_be_written(ask, tmp_path):
    without(tmp_path / "cache")
    cache = {"TACTSIM_CACHE_DIR": str(tmp_path / "cache" / "below")}
    ask(environment=cache)
    assert ask(environment=cache) == (21, True)
    without(tmp_path / "inner_loops" / "__pycache__")
    assert ask(environment=cache) == (21, False)
    assert "each time" in ask.said


def test_a_users_function_still_finds_its_blas():
    code = """
import numpy as np, numba
import tactsim.core.compiling
print(numba.njit(lambda a: np.dot(a, a))(np.eye(2)).sum())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "2.0\n"
