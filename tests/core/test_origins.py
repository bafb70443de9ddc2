import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tactsim.core import Scan
from tactsim.core.origins import object_origin, seen_from
from tactsim.press.scan_poses import grid_poses, random_poses

_far = st.floats(-1e4, 1e4)


def scan_at(poses, meta=None):
    count = len(poses)
    return Scan(
        np.ones((count, 4)), poses, np.full(count, "A"), np.full(count, "train"), np.eye(4, 2), meta or {}
    )


def test_poses_on_the_grid_stay_as_they_are():
    scan = scan_at(grid_poses())
    assert_array_equal(object_origin(scan), [0, 0])
    assert seen_from(scan, object_origin(scan)) is scan


@given(x=_far, y=_far)
def test_a_grid_is_found_wherever_it_lies(x, y):
    far = scan_at(grid_poses() + [x, y, 0])
    brought = seen_from(far, object_origin(far))
    assert_allclose(brought.poses, grid_poses(), rtol=0, atol=2e-6)
    assert_allclose(object_origin(brought), [0, 0], atol=2e-6)


@pytest.mark.parametrize("away", [(500.0, 0.0), (-3000.0, 120.0)])
def test_uneven_poses_say_about_where_the_object_is(away):
    poses = random_poses(np.random.default_rng(3), 30)
    assert_array_equal(object_origin(scan_at(poses)), [0, 0])
    far = scan_at(poses + [*away, 0])
    assert_array_equal(object_origin(far), away)
    assert_allclose(seen_from(far, object_origin(far)).poses, poses, atol=1e-8)


def test_the_centre_of_an_object_moves_along_unless_it_is_that_of_a_drawing():
    facts = {"symmetry": 1, "inertia_over_mass": 50.0}
    meta = {
        "objects": {
            "here": {**facts, "centre": [401.0, 2.0]},
            "drawn": {**facts, "centre": [1.0, 2.0]},
            "bare": facts,
        }
    }
    brought = seen_from(scan_at(grid_poses() + [400, 0, 0], meta), np.array([400.0, 0.0]))
    assert brought.meta["objects"]["here"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["drawn"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["bare"] == facts
    assert brought.meta["object_origin"] == [400.0, 0.0]
    assert seen_from(brought, np.array([0.5, 0])).meta["object_origin"] == [400.5, 0.0]
