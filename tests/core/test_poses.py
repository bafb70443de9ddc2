import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from tactsim.core.poses import compose, exp, invert, log, spread_out, transform, wrap_angle

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
