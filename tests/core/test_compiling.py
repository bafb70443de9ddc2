"""What was compiled is used again only for the same source and processor, and wherever it can be kept."""

import json
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
# Answers each question in a process of its own, forked before anything is compiled: numba is imported once.
ASKED = """
import json, os, sys
import numba.core.config
import tactsim.core.compiling
for line in sys.stdin:
    folder, environment = json.loads(line)
    child = os.fork()
    if not child:
        os.environ.update(environment)
        numba.core.config.reload_config()
        sys.path.insert(0, folder)
        os.dup2(os.open(folder + "/answer", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(os.open(folder + "/said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        from inner_loops.caller import caller
        print(caller(1), sum(caller.stats.cache_hits.values()), flush=True)
        os._exit(0)
    print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.fixture(scope="module")
def asked():
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", ASKED], env=environment, **pipes) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def ask(tmp_path, asked):
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
        print(json.dumps([str(tmp_path), environment or {}]), file=asked.stdin, flush=True)
        assert asked.stdout.readline() == "0\n"
        run.said = (tmp_path / "said").read_text()
        value, hits = map(int, (tmp_path / "answer").read_text().split())
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


@pytest.mark.long
def test_an_installation_that_cannot_be_written_uses_the_cache_folder(ask, tmp_path):
    without(tmp_path / "inner_loops" / "__pycache__")
    cache = {"TACTSIM_CACHE_DIR": str(tmp_path / "cache")}
    assert ask(environment=cache) == (21, False)
    assert ask(environment=cache) == (21, True)
    assert list((tmp_path / "cache").rglob("caller.*.kernel"))


@pytest.mark.long
def test_what_was_compiled_is_used_where_nothing_can_be_written(ask, tmp_path):
    without(tmp_path / "cache")
    cache = {"TACTSIM_CACHE_DIR": str(tmp_path / "cache" / "below")}
    ask(environment=cache)
    assert ask(environment=cache) == (21, True)
    without(tmp_path / "inner_loops" / "__pycache__")
    assert ask(environment=cache) == (21, False)
    assert "each time" in ask.said


@pytest.mark.long
def test_a_users_function_still_finds_its_blas():
    code = """
import numpy as np, numba
import tactsim.core.compiling
print(numba.njit(lambda a: np.dot(a, a))(np.eye(2)).sum())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "2.0\n"
