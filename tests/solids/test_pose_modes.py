"""Modes and the particles drawn about them, against Gaussians whose masses are known."""

import numpy as np
import pytest

from tactsim.core import rigid
from tactsim.solids.particles import draw, evidence, find_modes, squares_away

BOX = 20.0  # mm
TRUE = np.stack(
    [
        [3.0, -2.0, 1.0, *rigid.from_vector([0.3, -0.2, 0.9])],
        [-6.0, 4.0, 2.0, *rigid.from_vector([-1.3, 0.4, 0.2])],
    ]
)
SHARP = np.stack(
    [np.diag([1 / 0.2**2] * 3 + [1 / 0.02**2] * 3), np.diag([1 / 0.4**2] * 3 + [1 / 0.01**2] * 3)]
)
HEIGHT = np.array([-3.0, -1.0])  # log p at the modes


class Gaussians:
    """A field with one mode for each object; climbing ends there."""

    labels = ("one", "two")

    def log_p(self, label, pose):
        relative = rigid.compose(rigid.invert(TRUE[label]), pose)
        off = np.concatenate([relative[:, :3], rigid.to_vector(relative[:, 3:])], axis=1)
        return HEIGHT[label] - 0.5 * np.einsum("ni,ij,nj->n", off, SHARP[label], off)

    def climb(self, label, pose, steps):
        there = np.repeat(TRUE[label][None], len(pose), axis=0)
        return there, np.repeat(SHARP[label][None], len(pose), axis=0), self.log_p(label, there)


def masses():
    """What each mode holds of the prior times the likelihood: the integral of a Gaussian in six dimensions."""
    determinant = np.linalg.slogdet(SHARP)[1]
    prior = -3 * np.log(2 * BOX) - np.log(8 * np.pi**2)
    return prior + HEIGHT + 3 * np.log(2 * np.pi) - 0.5 * determinant


@pytest.fixture(scope="module")
def modes():
    rng = np.random.default_rng(0)
    label = np.repeat([0, 1], 20)
    pose = np.concatenate([rng.uniform(-5, 5, (40, 3)), rigid.random_rotations(40, rng)], axis=1)
    return find_modes(Gaussians(), label, pose, BOX)


def test_a_place_that_many_reach_is_one_mode(modes):
    assert sorted(modes.label.tolist()) == [0, 1]
    np.testing.assert_allclose(modes.pose, TRUE[modes.label])


def test_a_mode_outside_of_the_prior_is_none():
    label = np.array([0, 1])
    inside = find_modes(Gaussians(), label, TRUE, 5.0)
    assert inside.label.tolist() == [0]  # the other is 6 mm off


def test_what_is_drawn_holds_the_mass_of_the_modes(modes):
    label, pose, held = draw(modes, 4000, BOX, np.random.default_rng(1))
    field = Gaussians()
    log_p = np.empty(len(label))
    for one in (0, 1):
        log_p[label == one] = field.log_p(one, pose[label == one])
    for one in (0, 1):
        assert evidence((held + log_p)[label == one]) == pytest.approx(masses()[one], abs=0.06)


def test_how_far_poses_are_from_modes():
    rng = np.random.default_rng(7)
    pose = rigid.compose(
        TRUE[0],
        np.concatenate([rng.normal(0, 3, (50, 3)), rigid.from_vector(rng.normal(0, 1, (50, 3)))], axis=1),
    )
    pose[::2, 3:] *= -1  # the same rotations
    root = rng.standard_normal((2, 6, 8))
    factor = np.linalg.cholesky(root @ np.swapaxes(root, 1, 2))
    away = np.empty((2, 50))
    squares_away(TRUE, factor, pose, away)
    for mode in range(2):
        relative = rigid.compose(rigid.invert(TRUE[mode]), pose)
        off = np.concatenate([relative[:, :3], rigid.to_vector(relative[:, 3:])], axis=1)
        np.testing.assert_allclose(away[mode], ((off @ factor[mode]) ** 2).sum(axis=1))
