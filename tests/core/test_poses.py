"""Poses in the plane, and what lies in which object's frame."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from tactsim.core import Scan
from tactsim.core.making import spread_out
from tactsim.core.origins import object_origin, object_origins, seen_from
from tactsim.core.poses import compose, exp, invert, log, transform, wrap_angle
from tactsim.press.scan_poses import grid_poses, random_poses

coordinates = st.floats(-100, 100)
poses = arrays(float, 3, elements=coordinates)
points = arrays(float, (5, 2), elements=coordinates)


def same_pose(a, b, atol=1e-9):
    return np.allclose(a[:2], b[:2], atol=atol) and abs(wrap_angle(a[2] - b[2])) < atol


@given(poses)
def test_a_pose_times_its_inverse_is_the_identity(pose):
    assert same_pose(compose(pose, invert(pose)), np.zeros(3))
    assert same_pose(compose(invert(pose), pose), np.zeros(3))


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert same_pose(compose(a, compose(b, c)), compose(compose(a, b), c))


@given(poses)
def test_a_pose_is_the_matrix_that_it_stands_for(pose):
    x, y, angle = pose
    matrix = np.array([[np.cos(angle), -np.sin(angle), x], [np.sin(angle), np.cos(angle), y], [0, 0, 1]])
    assert np.allclose(transform(pose, [[3.0, -2.0]])[0], (matrix @ [3.0, -2.0, 1])[:2])


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction_and_lands_in_one_turn(angle):
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.cos(wrapped), np.cos(angle), atol=1e-8)
    assert np.isclose(np.sin(wrapped), np.sin(angle), atol=1e-8)


@pytest.mark.parametrize("turns", [-3, 0])
def test_no_angle_is_wrapped_to_plus_pi(turns):
    seam = np.pi * (2 * turns + 1)
    for angle in (seam, np.nextafter(seam, 9), np.nextafter(seam, -9), -np.pi - 1e-17, -np.pi - 1e-15):
        assert -np.pi <= wrap_angle(angle) < np.pi


@pytest.mark.parametrize("angle", [np.pi, -np.pi, -40.0])
def test_products_and_inverses_have_their_angle_in_one_turn(angle):
    for pose in (invert([1.0, 2.0, angle]), compose([1.0, 2.0, angle], [3.0, 4.0, 0.5])):
        assert -np.pi <= pose[2] < np.pi


def test_poses_broadcast():
    many = np.arange(12.0).reshape(4, 3)
    one = np.array([1.0, 2.0, 0.3])
    assert np.allclose(compose(one, many), [compose(one, pose) for pose in many])
    assert np.allclose(compose(many, one), [compose(pose, one) for pose in many])
    assert np.allclose(invert(many), [invert(pose) for pose in many])
    assert transform(many, np.zeros((7, 2))).shape == (4, 7, 2)


@given(st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_poses_that_are_spread_out_lie_at_least_as_far_apart_as_any_pose_lies_from_them(count, seed):
    rng = np.random.default_rng(seed)
    poses = rng.uniform((-10, -10, -np.pi), (10, 10, np.pi), (30, 3)).round(1)
    chosen = spread_out(poses, count)
    assert chosen[0] == 0
    assert len(set(chosen.tolist())) == count
    points = np.column_stack([poses[:, :2], 3 * np.cos(poses[:, 2]), 3 * np.sin(poses[:, 2])])
    apart = np.linalg.norm(points[:, None] - points[None, chosen], axis=2)
    left = np.setdiff1d(np.arange(30), chosen)
    between = apart[chosen][~np.eye(count, dtype=bool)]
    if count > 1 and len(left):
        assert apart[left].min(axis=1).max() <= between.min() + 1e-9
    assert np.array_equal(spread_out(poses, min(count + 1, 30))[:count], chosen)


def test_equal_poses_are_each_chosen_once():
    assert sorted(spread_out(np.zeros((5, 3)), 5)) == [0, 1, 2, 3, 4]


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e-4, 1.0, 3.1]))
def test_exp_is_the_exponential_of_the_matrix_and_log_undoes_it(seed, turn):
    x, y = np.random.default_rng(seed).normal(size=2) * 10
    vector = np.array([x, y, turn])
    matrix = expm(np.array([[0, -turn, x], [turn, 0, y], [0, 0, 0]]))
    assert transform(exp(vector), np.array([[0.0, 0.0], [1.0, 2.0]])) == pytest.approx(
        (matrix @ [[0, 1], [0, 2], [1, 1]])[:2].T, abs=1e-9
    )
    assert log(exp(vector)) == pytest.approx(vector, abs=1e-9)


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
        "objects": {"here": {**facts, "centre": [401.0, 2.0]}, "drawn": {**facts, "centre": [1.0, 2.0]},
                    "bare": facts}
    }  # fmt: skip
    brought = seen_from(
        scan_at(grid_poses() + [400, 0, 0], meta), dict.fromkeys(["A", *meta["objects"]], AWAY)
    )
    assert brought.meta["objects"]["here"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["drawn"]["centre"] == [1.0, 2.0]
    assert brought.meta["objects"]["bare"] == facts
    assert brought.meta["object_origin"] == [400.0, 0.0]
    assert seen_from(brought, {"A": np.array([0.5, 0])}).meta["object_origin"] == [400.5, 0.0]
