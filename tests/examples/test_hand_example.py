"""The example of a hand with five pads: it holds what it grasps, no sum is wrong, and picture and film are written."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "hand" / "grasp.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("grasp", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def forces_on(model, data, tip):
    """Add MuJoCo's contact forces on a geom: the normal ones, N, and the friction on it in the world, (3,) N."""
    geom, normal, friction, force = model.geom(tip).id, 0.0, np.zeros(3), np.zeros(6)
    for number, contact in enumerate(data.contact):
        if geom in contact.geom:
            mujoco.mj_contactForce(model, data, number, force)
            normal += force[0]
            friction += (-1 if contact.geom[0] == geom else 1) * (
                force[1:3] @ contact.frame.reshape(3, 3)[1:]
            )
    return normal, friction


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("ball", 2.0), ("egg", 2.0), pytest.param("letter", 10.0, marks=pytest.mark.long)],
)
def test_an_object_is_lifted_and_at_no_moment_is_a_sum_wrong(example, name, seconds):
    """Without a point spread and without gaps, what the taxels feel and what lies beside them is MuJoCo's force."""
    area = 2 * 3 / 1e3  # N for a kPa on a taxel
    loaded = 0
    for model, data, readings in example.grasp(name, seconds, psf_sigma=0):
        for tip, reading in zip(example.TIPS, readings, strict=True):
            normal, friction = forces_on(model, data, tip)
            felt = area * reading.kpa.sum()
            assert felt + reading.outside == pytest.approx(normal, rel=1e-9, abs=1e-12)
            assert np.linalg.norm(reading.shear) == pytest.approx(
                np.linalg.norm(friction), rel=1e-9, abs=1e-12
            )
            if reading.outside < 1e-9:
                np.testing.assert_allclose(area * reading.shear_kpa.sum(axis=0), reading.shear[:2], atol=1e-9)
            loaded += felt > 0.1
    lifted = data.body(name).xpos[2] - {"ball": 0.033, "egg": 0.03, "letter": 0.026}[name]
    assert lifted > (0.04 if seconds > 3 else 0.005)
    assert loaded > 100


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
