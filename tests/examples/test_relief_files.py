"""The relief of the suite `sequence`: the files are those that the script makes."""

import subprocess
import sys
from pathlib import Path

import numpy as np

RELIEF = Path(__file__).parents[2] / "examples" / "relief"
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])


def facets(path):
    return np.frombuffer(path.read_bytes()[84:], dtype=_FACET)  # behind the header of a binary STL


def make(*words):
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, check=False)


def test_the_script_makes_the_files_that_are_pressed(tmp_path):
    made = make(RELIEF / "make.py", tmp_path / "made")
    assert (made.returncode, made.stderr) == (0, "")
    names = sorted(path.name for path in RELIEF.glob("*.stl"))
    assert names == sorted(path.name for path in (tmp_path / "made").iterdir())
    for name in names:
        own, kept = facets(tmp_path / "made" / name), facets(RELIEF / name)
        np.testing.assert_array_equal(own["corners"], kept["corners"], name)
        np.testing.assert_allclose(own["normal"], kept["normal"], atol=1e-6, err_msg=name)
        lengths = np.abs(own["corners"])
        assert not ((lengths > 0) & (lengths < 1e-6)).any(), name
