"""What tests of all folders share. What is called and not given is in `tests/support`."""

import gc
import os
import subprocess
import sys

import pytest
from command_line import Bench
from hypothesis import settings
from level_world import at_few_angles
from processor_time import ProcessorTime

from tactsim.bench.cli.app import run_app
from tactsim.core.cache_folder import cache_folder

# Kernels are compiled once for all tests, whatever cache a test has for itself.
os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder() / "kernels"))

# Some hundred processes import the same files. Where what Python compiled of them may not stay beside them, it is kept
# beside the kernels, since otherwise each process compiles all of it again.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = str(cache_folder() / "bytecode")
    sys.dont_write_bytecode = False

# A busy machine fails no test.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")


def pytest_addoption(parser):
    parser.addoption(
        "--soak-minutes", type=float, default=30.0, help="how long `make soak` reads its devices"
    )
    parser.addoption(
        "--dearest", type=int, default=0, help="how many tests to list that took most processor time"
    )


def pytest_configure(config):
    config.pluginmanager.register(ProcessorTime())


def pytest_ignore_collect(collection_path, config):
    """Import no benchmarks where none are asked for; they hold no tests."""
    if collection_path.name.startswith("bench_") and "not benchmark" in config.option.markexpr:
        return True
    return None


def pytest_collection_finish():
    """Spare later searches for garbage what was imported, which takes most of their time and is never garbage."""
    gc.collect()
    gc.freeze()


def pytest_sessionfinish():
    """Let what was imported be taken apart at the end as usual."""
    gc.unfreeze()


@pytest.fixture
def soak_minutes(request):
    """Say for how long the long soak reads."""
    return request.config.getoption("--soak-minutes")


@pytest.fixture(scope="session", autouse=True)
def shared_cache(tmp_path_factory):
    """Keep tests from the user's cache; what one test has pressed another finds, also in another process."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shared-cache"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTSIM_CACHE_DIR", str(folder))
        yield folder


@pytest.fixture
def own_cache(tmp_path_factory, monkeypatch):
    """Give a test a cache of its own, empty."""
    folder = tmp_path_factory.mktemp("own-cache")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(folder))
    return folder


@pytest.fixture(autouse=True)
def _own_cache_where_presses_are_counted(request):
    """Keep tests of these rooms from each other's cache too."""
    if request.path.parent.name in ("press", "solids", "attach"):
        request.getfixturevalue("own_cache")


@pytest.fixture
def few_angles():
    """Press at fewer angles than a scan has."""
    with at_few_angles():
        yield


@pytest.fixture
def bench(tmp_path, shared_cache):
    """Give the installed command in an empty folder, with the cache that all tests share."""
    return Bench(tmp_path, shared_cache)


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Call the command line in this process, where another one would prove nothing more."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["bench", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            run_app()
        return subprocess.CompletedProcess(words, ended.value.code, *capsys.readouterr())

    return call


@pytest.fixture(scope="session")
def scan_file(tmp_path_factory, shared_cache):
    """Write the scan of two letters, I and O, with the command line."""
    folder = tmp_path_factory.mktemp("scan")
    assert Bench(folder, shared_cache)("scan", "--out", "two.npz", "--letters", "IO").returncode == 0
    return folder / "two.npz"
