"""What is imported when: the data types must stay light for those who need nothing else."""

import subprocess
import sys

import pytest

from tactsim.press import ScanOptions, scan_letters


def imported(code):
    """Run code in a fresh interpreter and say which of the heavy modules it brought."""
    heavy = ("mujoco", "numba", "trimesh", "pydantic", "scipy", "matplotlib")
    script = f"{code}\nimport sys; print(*[name for name in {heavy} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


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
