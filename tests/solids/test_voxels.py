"""Distances on sparse voxels, and rays through them, against a sphere's in closed form."""

import numpy as np
import pytest
from numba import njit
from toy_solids import distances

from tactsim.core import rigid
from tactsim.solids.feeling_kernels import feel_all
from tactsim.solids.voxels import INSIDE, OUTSIDE, UNKNOWN, first_hit, redistance, settle, sparse

RADIUS, CELL = 12.0, 0.8


def dense():
    axis = np.arange(-18.0, 18.1, CELL)
    return np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij")), axis=0) - RADIUS


@pytest.fixture(scope="module")
def ball():
    return sparse(np.full(3, -18.0), CELL, dense().astype(np.float32), 3.0)


@pytest.mark.long
def test_distances_are_the_spheres_near_it_and_bounds_far_away(ball):
    points = np.random.default_rng(0).uniform(-40, 40, (20_000, 3))
    true, found = np.linalg.norm(points, axis=1) - RADIUS, distances(ball, points)
    near = np.abs(true) < 3 - 2 * CELL
    np.testing.assert_allclose(found[near], true[near], atol=0.02)
    assert (np.abs(found) <= np.abs(true) + CELL).all()
    assert (np.sign(found) == np.sign(true))[np.abs(true) > 0.1].all()
    assert len(ball.nodes) < ball.block.size  # blocks far from the surface hold nothing


def test_distances_are_made_of_any_values_with_the_same_zeros():
    true = dense().astype(np.float32)
    level = np.clip(3 * true, -1, 1).astype(np.float32)
    found = np.empty_like(level)
    redistance(found, level, CELL)
    off = (found - true)[np.abs(true) < 4]
    assert np.abs(off).max() < 0.3 * CELL
    assert np.abs(off).mean() < 0.1 * CELL


def test_what_is_unknown_takes_the_nearest_side():
    side = np.full((9, 3, 3), UNKNOWN, dtype=np.int8)
    side[0], side[8] = INSIDE, OUTSIDE
    settle(side)
    assert (side[:4] == INSIDE).all()
    assert (side[5:] == OUTSIDE).all()


def test_rays_meet_the_sphere_where_it_is(ball):
    rng = np.random.default_rng(1)
    turns = rigid.matrix(rigid.random_rotations(500, rng))
    aside, depth = rng.uniform(-5, 5, (500, 2)), rng.uniform(-0.5, 2.5, 500)
    along = np.sqrt(RADIUS**2 - (aside**2).sum(axis=1))
    local = np.column_stack([aside, depth - along])  # so deep is the surface over the middle of the pad
    places = np.ascontiguousarray(np.einsum("nij,nj->ni", turns, local))
    found = np.empty((500, 1))
    feel_all(ball, np.zeros((1, 3)), places, np.ascontiguousarray(turns), 3.0, 1.0, found)
    pressed = depth > 0
    np.testing.assert_allclose(found[pressed, 0], depth[pressed], atol=0.06)
    # Ahead of the pad the distance counts, which is no more than the way along the ray.
    assert (found[~pressed, 0] >= depth[~pressed] - 0.05).all()
    assert (found[~pressed, 0] <= 0).all()


def test_a_ray_that_meets_nothing_ends(ball):
    @njit
    def hit(voxels, x, begin, end):
        return first_hit(voxels, x, 0.0, -30.0, 0.0, 0.0, 1.0, begin, end)

    assert hit(ball, 0.0, 0.0, 50.0) == pytest.approx(30 - RADIUS, abs=0.02)
    assert hit(ball, 13.0, 0.0, 50.0) == 50.0
    assert hit(ball, 0.0, 25.0, 50.0) == 25.0  # begins inside
