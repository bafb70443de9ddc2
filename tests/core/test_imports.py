"""What is imported when: the data types must stay light for those who need nothing else."""

import subprocess
import sys

import pytest

from tactsim.press import ScanOptions, scan_letters

HEAVY = ("mujoco", "numba", "trimesh", "pydantic", "scipy", "matplotlib", "serial")


def imported(code, *more):
    """Run code in a fresh interpreter and say which of the heavy modules, and of `more`, it brought."""
    script = f"{code}\nimport sys; print('', *[name for name in {HEAVY + more} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.splitlines()[-1].split())


def test_the_data_types_bring_nothing_heavy():
    assert not imported("import tactsim; tactsim.Scan; tactsim.compose")


def test_describing_a_scan_brings_no_physics():
    assert imported("from tactsim import Pad, ScanOptions; ScanOptions()") == {"pydantic"}


def test_a_scan_from_the_cache_brings_no_physics(own_cache):
    scan_letters(ScanOptions(letters=("I",)))
    code = 'from tactsim import ScanOptions, scan_letters; scan_letters(ScanOptions(letters=("I",)))'
    assert "mujoco" not in imported(code)


def test_a_name_that_is_not_there_is_said():
    import tactsim

    with pytest.raises(AttributeError, match="nothing"):
        tactsim.nothing  # noqa: B018


def test_help_brings_neither_numpy_nor_a_configuration():
    assert not imported(
        "from tactsim.bench.cli.app import app; app(['--help'], standalone_mode=False)", "numpy"
    )


@pytest.mark.long
def test_a_run_from_the_cache_brings_no_physics(here, own_cache):
    small = ("--bins", "100", "--letters", "I", "--trials", "1", "--readings", "2", "--json")
    words = ["run", "--estimator", "histogram", *small, "--out"]
    assert here(*words, "first").returncode == 0
    script = f"""
from tactsim.bench.cli.app import app
app({[*words, "second"]!r}, standalone_mode=False)
"""
    assert not {"mujoco", "trimesh"} & imported(script)


def test_a_default_run_brings_no_room_that_it_does_not_need(tmp_path):
    words = [
        "run",
        "--letters",
        "I",
        "--trials",
        "1",
        "--readings",
        "2",
        "--bins",
        "1000",
        "--out",
        str(tmp_path / "run"),
    ]
    script = f"""
import sys
from tactsim.bench.cli.app import app
app({words!r}, standalone_mode=False)
print('', *[name for name in sys.modules if name.startswith("tactsim.bench.")])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    rooms = {name.split(".")[2] for name in done.stdout.splitlines()[-1].split()}
    assert not rooms & {
        "bound",
        "report",
        "space",
        "leaderboard",
        "tasks",
        "stress",
        "formats",
        "watching",
        "pad",
    }
