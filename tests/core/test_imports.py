"""What is imported when: the data types must stay light for those who need nothing else."""

import subprocess
import sys

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
