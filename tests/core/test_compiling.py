"""What was compiled is used again only for the same source, wherever it can be kept; what is imported; what fits."""

import ast
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof

import tactsim
from tactsim.bench.compile_kernels import modules_with_kernels
from tactsim.core import InputError, memory
from tactsim.core.compiling import Ints1D, Reals, Reals2D, numba_type

CALLEE = """
from tactsim.core.compiling import compiled
STEP = 1

@compiled(called_from_python=False)
def callee(x: int) -> int:
    return x + 1
"""
CALLER = """
from inner_loops.callee import STEP, callee
from tactsim.core.compiling import compiled

@compiled()
def caller(x: int) -> int:
    return 10 * callee(x) + STEP
"""
# Answers each question in a process of its own, forked before anything is compiled: numba is imported once.
ASKED = """
import json, os, sys, tempfile
import tactsim.core.compiling
for line in sys.stdin:
    folder, environment = json.loads(line)
    child = os.fork()
    if not child:
        os.environ.update(environment)
        tempfile.tempdir = environment.get("TMPDIR")
        sys.path.insert(0, folder)
        os.dup2(os.open(folder + "/answer", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(os.open(folder + "/said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        from inner_loops.caller import caller
        print(caller(1), sum(caller.stats.cache_hits.values()), flush=True)
        os._exit(0)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Weighted(NamedTuple):
    matrix: Reals2D
    weight: float


def test_annotations_name_the_types_of_what_is_passed_and_of_arrays_the_dimensions():
    assert numba_type(Weighted) == typeof(Weighted(np.eye(3), 1.0))
    assert numba_type(tuple[bool, Ints1D]) == typeof((True, np.arange(3)))
    with pytest.raises(TypeError, match="no compiled function can take"):
        numba_type(Reals)


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
    for name, text in (("__init__", ""), ("callee", CALLEE), ("caller", CALLER)):
        (package / f"{name}.py").write_text(text)

    def run(environment=None, **changed):
        for name, (old, new) in changed.items():
            path = package / f"{name}.py"
            before = path.stat()
            path.write_text(path.read_text().replace(old, new))
            # As old and as long as before: only the content tells.
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        own = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
        print(json.dumps([str(tmp_path), own | (environment or {})]), file=asked.stdin, flush=True)
        assert asked.stdout.readline() == "0\n", (tmp_path / "said").read_text()
        run.said = (tmp_path / "said").read_text()
        value, hits = map(int, (tmp_path / "answer").read_text().split())
        return value, hits == 1

    return run


@pytest.mark.long
def test_a_caller_is_compiled_again_when_what_it_calls_in_another_file_changes(ask):
    assert ask() == (21, False)
    assert "kept for later runs" in ask.said
    assert ask() == (21, True)
    assert ask.said == ""
    assert ask(callee=("x + 1", "x + 2")) == (31, False)
    assert ask() == (31, True)
    assert ask(callee=("STEP = 1", "STEP = 7")) == (37, False)  # a constant counts too


@pytest.mark.long
def test_damaged_files_are_compiled_again(ask, tmp_path):
    ask()
    for content in (b"", bytes(64)):
        for kept in tmp_path.glob("numba/*/*/caller.*"):
            kept.write_bytes(content)
        assert ask()[0] == 21
        assert ask() == (21, False)
    assert ask() == (21, True)


@pytest.mark.long
def test_folders_of_the_source_used_last_stay_and_older_ones_go(ask, tmp_path):
    ask()
    (used,) = (tmp_path / "numba").iterdir()
    for age in range(1, 15):
        other = used.with_name(f"inner_loops-{age:016x}")
        other.mkdir()
        os.utime(other, (1e9 - age, 1e9 - age))
    ask(callee=("STEP = 1", "STEP = 7"))
    left = {folder.name for folder in used.parent.iterdir()}
    assert len(left) == 10
    assert {used.name, *(f"inner_loops-{age:016x}" for age in range(1, 9))} < left


def without(folder):
    """Let nothing be written to a folder, not even by root: a file is in its place."""
    folder.write_text("a file\n")
    return str(folder / "below")


@pytest.mark.long
def test_where_the_named_folder_cannot_be_written_the_cache_folder_takes_it(ask, tmp_path):
    elsewhere = {
        "NUMBA_CACHE_DIR": without(tmp_path / "named"),
        "TACTSIM_CACHE_DIR": str(tmp_path / "cache"),
    }
    assert ask(environment=elsewhere) == (21, False)
    assert ask(environment=elsewhere) == (21, True)
    assert list((tmp_path / "cache" / "kernels").rglob("caller.*"))


@pytest.mark.long
def test_where_nothing_can_be_written_it_is_compiled_each_time_and_said_once(ask, tmp_path):
    nowhere = dict.fromkeys(("NUMBA_CACHE_DIR", "TACTSIM_CACHE_DIR", "TMPDIR"), without(tmp_path / "file"))
    for _ in range(2):
        assert ask(environment=nowhere) == (21, False)
        assert ask.said.count("each time") == len(ask.said.splitlines()) == 1


def test_kernels_take_their_constants_from_files_that_hold_kernels():
    """What is kept of a kernel holds its constants, and only changes of such files are seen."""
    homes, wrong = set(modules_with_kernels()), []
    for home in homes:
        path = Path(tactsim.__file__).parents[1] / f"{home.replace('.', '/')}.py"
        tree = ast.parse(path.read_text())
        imported = {
            one.asname or one.name: node.module
            for node in tree.body
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactsim")
            for one in node.names
        }
        for kernel in tree.body:
            if isinstance(kernel, ast.FunctionDef) and "compiled" in map(called, kernel.decorator_list):
                used = {
                    node.id for part in kernel.body for node in ast.walk(part) if isinstance(node, ast.Name)
                }
                wrong += [(home, name) for name in used & imported.keys() if imported[name] not in homes]
    assert "tactsim.estimators.field.kernels" in homes
    assert not wrong


def called(decorator):
    """Name the function that a decorator calls."""
    return getattr(getattr(decorator, "func", None), "id", None)


HEAVY = ("mujoco", "numba", "trimesh", "pydantic", "scipy", "matplotlib", "serial")


def imported(code, *more):
    """Run code in a fresh interpreter and say which of the heavy modules, and of `more`, it brought."""
    script = f"{code}\nimport sys; print('', *[name for name in {HEAVY + more} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.splitlines()[-1].split())


def test_help_brings_neither_numpy_nor_a_configuration():
    assert not imported(
        "from tactsim.bench.cli.app import app; app(['--help'], standalone_mode=False)", "numpy"
    )


def test_what_fits_passes_and_what_does_not_is_refused_in_one_line_with_the_estimate(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 4e9)
    memory.require(4e9, "5 letters", "choose fewer")
    with pytest.raises(
        InputError, match=r"5 letters would take about 12\.8 GB .* 4\.0 GB are free; choose"
    ) as caught:
        memory.require(12.8e9, "5 letters", "choose fewer")
    assert "\n" not in str(caught.value)


def test_the_least_of_all_limits_counts(monkeypatch):
    free = memory.free_memory()
    assert 0 < free < float("inf")
    used = memory._text(memory.Path("/proc/self/statm")).split()[0]
    limit = int(used) * resource.getpagesize() + 1_000_000
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    assert 0 <= memory.free_memory() <= 1_000_000
