from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tactsim.core import Scan, compose
from tactsim.core.origins import object_origin, object_origins, seen_from
from tactsim.press.scan_poses import grid_poses, random_poses

AWAY = np.array([400.0, 0.0])
_far = st.floats(-1e4, 1e4)


def scan_at(poses, meta=None):
    count = len(poses)
    return Scan(
        np.ones((count, 4)), poses, np.full(count, "A"), np.full(count, "train"), np.eye(4, 2), meta or {}
    )


def test_poses_on_the_grid_stay_as_they_are():
    scan = scan_at(grid_poses())
    assert_array_equal(object_origin(scan), [0, 0])
    assert seen_from(scan, object_origins(scan)) is scan


@given(x=_far, y=_far)
def test_a_grid_is_found_wherever_it_lies(x, y):
    far = scan_at(grid_poses() + [x, y, 0])
    brought = seen_from(far, object_origins(far))
    assert_allclose(brought.poses, grid_poses(), rtol=0, atol=2e-6)
    assert_allclose(object_origin(brought), [0, 0], atol=2e-6)


@pytest.mark.parametrize("away", [(500.0, 0.0), (-3000.0, 120.0)])
def test_uneven_poses_say_about_where_the_object_is(away):
    poses = random_poses(np.random.default_rng(3), 30)
    assert_array_equal(object_origin(scan_at(poses)), [0, 0])
    far = scan_at(poses + [*away, 0])
    assert_array_equal(object_origin(far), away)
    assert_allclose(seen_from(far, object_origins(far)).poses, poses, atol=1e-8)


@pytest.mark.parametrize("drawn", [grid_poses(), random_poses(np.random.default_rng(3), 30)])
def test_each_object_in_a_frame_of_its_own_is_looked_at_from_its_own_centre(drawn):
    """However the frame of one is moved and turned, its poses lie about 0 as they did."""
    moved = compose([33.3, -7.1, 0.4], drawn)
    scan = replace(scan_at(np.concatenate([drawn, moved])), labels=np.repeat(["A", "B"], len(drawn)))
    brought = seen_from(scan, object_origins(scan))
    one, other = (brought.where(label=label).poses for label in "AB")
    assert_allclose(compose([0, 0, 0.4], one), other, atol=1e-8)
    assert set(brought.meta["object_origin"]) == {"A", "B"}
    again = seen_from(brought, dict.fromkeys("AB", np.array([1.0, 0])))
    assert again.meta["object_origin"]["B"] == [
        brought.meta["object_origin"]["B"][0] + 1,
        *again.meta["object_origin"]["B"][1:],
    ]


def test_objects_that_were_pressed_at_random_places_of_one_frame_stay_in_it():
    rng = np.random.default_rng(0)
    scan = replace(scan_at(random_poses(rng, 40)), labels=np.repeat(list("ABCD"), 10))
    assert seen_from(scan, object_origins(scan)) is scan


def test_the_centre_of_an_object_moves_along_unless_it_is_that_of_a_drawing():
    facts = {"symmetry": 1, "inertia_over_mass": 50.0}
    meta = {
        "objects": {
            "here": {**facts, "centre": [401.0, 2.0]},
            "drawn": {**facts, "centre": [1.0, 2.0]},
            "bare": facts,
        }
    }
    brought = seen_from(
        scan_at(grid_poses() + [400, 0, 0], meta), dict.fromkeys(["A", *meta["objects"]], AWAY)
    )
    assert brought.meta["objects"]["here"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["drawn"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["bare"] == facts
    assert brought.meta["object_origin"] == [400.0, 0.0]
    assert seen_from(brought, {"A": np.array([0.5, 0])}).meta["object_origin"] == [400.5, 0.0]
