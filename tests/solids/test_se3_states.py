"""The mean about the mode that holds the most."""

import numpy as np

from tactsim.core import rigid
from tactsim.solids.particles import mean_around

PLACES = np.array([[3.0, -2.0, 1.0], [-25.0, 10.0, 4.0]])


def two_modes(counts, rng):
    """Poses about two places, by `counts`, 0.3 mm and 0.03 rad wide."""
    vector = np.repeat([[0.4, 0.1, -0.8], [2.0, -1.0, 0.3]], counts, axis=0)
    turn = rigid.multiply(
        rigid.from_vector(0.03 * rng.standard_normal((sum(counts), 3))), rigid.from_vector(vector)
    )
    place = np.repeat(PLACES, counts, axis=0) + 0.3 * rng.standard_normal((sum(counts), 3))
    return np.concatenate([place, turn], axis=1)


def test_the_heavier_mode_is_averaged_and_not_the_one_of_the_heaviest_state():
    rng = np.random.default_rng(0)
    poses, weights = two_modes((200, 100), rng), np.full(300, 1.0)
    weights[250] = 60.0  # one heavy state of the mode that holds less
    mean = mean_around(poses, weights / weights.sum())
    assert np.linalg.norm(mean[:3] - PLACES[0]) < 0.1
    assert rigid.angle_between(mean[3:], rigid.from_vector(np.array([0.4, 0.1, -0.8]))) < 0.02
    weights[250] = 400.0
    assert np.linalg.norm(mean_around(poses, weights / weights.sum())[:3] - PLACES[1]) < 1.0


def test_the_mean_is_that_of_the_states_near_by():
    poses = two_modes((3, 1), np.random.default_rng(1))
    weights = np.array([0.2, 0.3, 0.1, 0.4])
    mean = mean_around(poses, weights)
    np.testing.assert_allclose(mean[:3], np.array([0.2, 0.3, 0.1]) @ poses[:3, :3] / 0.6)


def test_a_rotation_and_its_negative_quaternion_are_one():
    poses = two_modes((40, 0), np.random.default_rng(3))
    other = poses.copy()
    other[::2, 3:] *= -1
    first, second = (mean_around(those, np.full(40, 1 / 40)) for those in (poses, other))
    assert rigid.angle_between(first[3:], second[3:]) < 1e-6
