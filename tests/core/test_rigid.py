"""Poses in space against SciPy's rotations and the laws of a group."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from tactsim.core import rigid
from tactsim.core.errors import InputError

seeds = st.integers(0, 2**32 - 1)


def poses(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(0, 20, (count, 3)), rigid.random_rotations(count, rng)], axis=1)


@given(seeds)
def test_composed_maps_points_as_one_after_the_other(seed: int) -> None:
    outer, inner = poses(seed, 2)
    points = np.random.default_rng(seed).normal(0, 10, (5, 3))
    both = rigid.transform(rigid.compose(outer, inner), points)
    np.testing.assert_allclose(both, rigid.transform(outer, rigid.transform(inner, points)), atol=1e-10)


@given(seeds)
def test_inverse_leaves_points_where_they_are(seed: int) -> None:
    pose = poses(seed, 1)[0]
    still = rigid.compose(pose, rigid.invert(pose))
    np.testing.assert_allclose(still[:3], 0, atol=1e-10)
    assert rigid.angle_between(still[3:], rigid.IDENTITY[3:]) < 1e-7


@given(seeds)
def test_agrees_with_scipy(seed: int) -> None:
    q = poses(seed, 3)[:, 3:]
    theirs = Rotation.from_quat(q, scalar_first=True)
    np.testing.assert_allclose(rigid.matrix(q), theirs.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rigid.to_vector(q), theirs.as_rotvec(), atol=1e-9)
    again = rigid.from_vector(rigid.to_vector(q))
    assert rigid.angle_between(again, q).max() < 1e-7
    np.testing.assert_allclose(
        rigid.angle_between(q[0], q[1]), (theirs[0].inv() * theirs[1]).magnitude(), atol=1e-9
    )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi])
def test_matrix_and_back_at_half_turns(axis: int, angle: float) -> None:
    q = rigid.from_vector(angle * np.eye(3)[axis])
    assert rigid.angle_between(rigid.quaternion(rigid.matrix(q)), q) < 1e-7


@given(seeds)
def test_turn_from_z_ends_there(seed: int) -> None:
    direction = np.random.default_rng(seed).normal(size=(4, 3))
    direction[:2] = (0, 0, 1), (0, 0, -1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_allclose(rigid.turned(rigid.turn_from_z(direction), [0, 0, 1]), direction, atol=1e-12)


def test_random_rotations_are_even() -> None:
    turned = rigid.turned(rigid.random_rotations(20_000, np.random.default_rng(0)), [1.0, 0, 0])
    # Means of an even direction vanish within 4 standard errors, its squares are 1/3.
    assert np.abs(turned.mean(axis=0)).max() < 4 / np.sqrt(3 * 20_000)
    assert np.abs((turned**2).mean(axis=0) - 1 / 3).max() < 0.01


def test_nearest_rotation_is_that_of_least_angle() -> None:
    among = rigid.random_rotations(50, np.random.default_rng(1))
    angle, which = rigid.nearest_rotation(rigid.multiply(among[7], rigid.from_vector([1e-3, 0, 0])), among)
    assert which == 7
    assert angle == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("given_pose", "says"),
    [([0, 0, 0, 1, 0, 0], "shape"), ([0, 0, 0, 1, 1, 0, 0], "length 1"),
     ([np.nan, 0, 0, 1, 0, 0, 0], "finite|NaN|nan")],
)  # fmt: skip
def test_no_pose(given_pose: list[float], says: str) -> None:
    with pytest.raises(InputError, match=says):
        rigid.checked_poses(given_pose, "the hand's pose")


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e-4, 1.0, 3.1]))
def test_exp_is_the_exponential_of_the_matrix_and_log_undoes_it(seed: int, turn: float) -> None:
    vector = np.random.default_rng(seed).normal(size=6)
    vector[3:] *= turn / np.linalg.norm(vector[3:])
    (x, y, z), (a, b, c) = vector[:3], vector[3:]
    matrix = expm(np.array([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]]))
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    moved = (matrix @ np.column_stack([points, np.ones(2)]).T)[:3].T
    assert rigid.transform(rigid.exp(vector), points) == pytest.approx(moved, abs=1e-7)
    assert rigid.log(rigid.exp(vector)) == pytest.approx(vector, abs=1e-7)
