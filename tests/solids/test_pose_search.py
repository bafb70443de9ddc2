"""Cells of poses in space, and the quick look at a pose."""

import numpy as np
import pytest
import toy_solids as toy
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from tactsim.core import rigid
from tactsim.solids import screen_kernels
from tactsim.solids.particles import draw, evidence, find_modes, squares_away
from tactsim.solids.pose_search import CellSizes, PoseCells, every_cell, thinned, volumes
from tactsim.solids.screen_kernels import PadWay, Slack, TouchPoints, advance_about, screen, shortened, solve
from tactsim.solids.voxels import sparse

SIZES = CellSizes(side=4, voxel=4.0, reach=16.0, box=20.0)
ANCHOR = np.array([1.0, -2.0, 3.0])


def cell_of(rotation, side):
    """The cube and the place of rotations (n, 4): which cell of rotations they lie in."""
    cube = np.abs(rotation).argmax(axis=1)
    largest = np.take_along_axis(rotation, cube[:, None], axis=1)
    others = np.take_along_axis(rotation, (cube[:, None] + np.arange(1, 4)) % 4, axis=1) / largest
    return cube, np.minimum(((np.arctan(others) * 4 / np.pi + 1) / 2 * side).astype(int), side - 1)


def test_cells_hold_the_rotations_that_their_volumes_say():
    side, count = 4, 200_000
    cube, place = every_cell(side)
    expected = volumes(place, side)
    assert expected.sum() == pytest.approx(1, abs=0.03)
    found_cube, found_place = cell_of(rigid.random_rotations(count, np.random.default_rng(0)), side)
    hits = np.zeros((4, side, side, side))
    np.add.at(hits, (found_cube, *found_place.T), 1)
    share = hits[cube, *place.T] / count
    # A middle's density is not quite its cell's mean; the rest is chance.
    assert np.abs(share / expected - 1).max() < 0.25
    assert np.abs(share - expected).sum() < 0.06


def some_cells():
    rng = np.random.default_rng(1)
    return PoseCells(
        np.full(30, 3), rng.integers(4, size=30), rng.integers(4, size=(30, 3)), rng.integers(8, size=(30, 3))
    )


@pytest.mark.parametrize(
    ("halves", "sizes"),
    [(PoseCells.turned_halves, SIZES.turned()), (PoseCells.shifted_halves, SIZES.shifted())],
)
def test_halves_share_what_their_cell_holds(halves, sizes):
    cells = some_cells()
    parts = halves(cells)
    assert (parts.label == 3).all()
    counts = [
        len(np.unique(np.column_stack([some.cube, some.place, some.voxel]), axis=0))
        for some in (cells, parts)
    ]
    assert counts[1] == 8 * counts[0]
    whole = cells.log_prior(cells.poses(SIZES, ANCHOR), SIZES, 1e3)
    part = parts.log_prior(parts.poses(sizes, ANCHOR), sizes, 1e3).reshape(-1, 8)
    np.testing.assert_allclose(np.exp(part).sum(axis=1), np.exp(whole), rtol=0.05)


def test_outside_of_the_box_the_prior_is_zero():
    cells = some_cells()
    poses = cells.poses(SIZES, np.array([25.0, 0.0, 0.0]))
    held = cells.log_prior(poses, SIZES)
    assert ((held == -np.inf) == (np.abs(poses[:, :3]).max(axis=1) > 20)).all()
    assert (held == -np.inf).any()


@given(st.lists(st.floats(-40, 0) | st.just(-np.inf), min_size=1, max_size=60), st.integers(1, 70))
def test_what_is_thinned_keeps_its_sum(values, count):
    log_mass = np.array(values)
    which, factor = thinned(log_mass, count)
    assert len(which) <= count
    assert (np.diff(which) > 0).all()
    assert (factor >= -1e-9).all()  # none is made smaller
    kept = np.exp(log_mass[which] + factor).sum()
    assert kept == pytest.approx(np.exp(log_mass).sum(), rel=1e-9, abs=1e-300)


BLOCK = toy.Box((15.0, 10.0, 6.0))
WIDTH = 0.4
LATTICE = np.zeros((1, 2))


def charted(solid, cell=0.8, reach=30.0):
    axis = np.arange(-reach, reach + cell, cell)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    return sparse(np.full(3, -reach), cell, solid.distance(grid).astype(np.float32), 5.0)


@pytest.fixture(scope="module")
def block():
    return charted(BLOCK)


def points_on(solid, count, rng):
    """Six points on a surface for each of `count` touches, in a sensor's frame that is the object's."""
    points, _ = solid.surface(6 * count, rng)
    point = np.concatenate([points, np.full((6 * count, 1), 0.5)], axis=1).reshape(count, 6, 4)
    return TouchPoints(
        np.tile(rigid.IDENTITY, (count, 1)), np.ascontiguousarray(point), np.full(count, 6),
        np.zeros((count, 1, 3)), np.zeros(count, dtype=np.int64), np.full(count, 1e3),
    )  # fmt: skip


def looked(voxels, touches, poses, steps, turn=0.0, shift=0.0, least=-np.inf):
    poses, score = np.array(poses), np.zeros(len(poses))
    slack = Slack(np.zeros(3), turn, shift, WIDTH)
    screen(voxels, touches, PadWay(LATTICE, 20.0), poses, slack, steps, least, score)
    return poses, score


def test_a_look_without_steps_weighs_distances_and_moves_nothing(block):
    rng = np.random.default_rng(0)
    touches = points_on(BLOCK, 4, rng)
    at = np.concatenate(
        [rng.normal(0, 0.3, (30, 3)), rigid.from_vector(rng.normal(0, 0.02, (30, 3)))], axis=1
    )
    poses, score = looked(block, touches, at, 0, turn=0.05, shift=0.5)
    np.testing.assert_array_equal(poses, at)
    for n in range(30):
        places = rigid.transform(rigid.invert(at[n]), touches.point[:, :, :3].reshape(-1, 3)).reshape(4, 6, 3)
        center = rigid.transform(rigid.invert(at[n]), np.zeros((1, 3)))[0]
        variance = WIDTH**2 + 0.5**2 + 0.05**2 * ((places - center) ** 2).sum(-1)
        away = toy.distances(block, np.ascontiguousarray(places.reshape(-1, 3)))
        half = 0.5 * away.reshape(4, 6) ** 2 / variance
        lost = (0.5 * half / (1 + half / screen_kernels._BOUND)).sum(axis=1)
        assert score[n] == pytest.approx(-(lost / (1 + lost / screen_kernels._MOST)).sum())


def test_steps_bring_touched_points_onto_the_surface(block):
    rng = np.random.default_rng(1)
    touches = points_on(BLOCK, 8, rng)
    off = np.concatenate([rng.normal(0, 1.5, (200, 3)), rng.normal(0, 0.12, (200, 3))], axis=1)
    at = np.concatenate([off[:, :3], rigid.from_vector(off[:, 3:])], axis=1)
    before = looked(block, touches, at, 0)[1]
    poses, after = looked(block, touches, at, 6, turn=0.2, shift=2.5)
    reached = (np.linalg.norm(poses[:, :3], axis=1) < 0.3) & (
        rigid.angle_between(poses[:, 3:], rigid.IDENTITY[3:]) < 0.03
    )
    assert reached.mean() > 0.9
    assert np.median(before) < -30
    assert np.median(after) > -1


def test_steps_free_the_pads_way(block):
    """A pad whose way lies 1.5 mm inside of the block is moved out of it."""
    touches = TouchPoints(
        np.array([[0.0, 0, -30, 1, 0, 0, 0]]), np.zeros((1, 1, 4)), np.zeros(1, dtype=np.int64),
        np.array([[[16.0 - 1.5 - 1.0, 0.0, 30.0]]]), np.ones(1, dtype=np.int64), np.full(1, 1e3),
    )  # fmt: skip
    poses, _ = looked(block, touches, rigid.IDENTITY[None], 5, turn=0.05, shift=2.0)
    place = rigid.transform(rigid.invert(poses[0]), np.array([[13.5, 0.0, 0.0]]))
    assert BLOCK.distance(place)[0] > -0.3


@njit
def solved(matrix, vector):
    solve(matrix, vector)
    return vector


@njit
def advanced_about(pose, anchor, center, step, by):
    advance_about(pose, anchor, center, step, by)
    return pose


@njit
def part(step, shift, turn):
    return shortened(step, shift, turn)


def test_six_equations_are_solved():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 8))
    matrix, vector = root @ root.T, rng.standard_normal(6)
    np.testing.assert_allclose(solved(matrix.copy(), vector.copy()), np.linalg.solve(matrix, vector))


def test_a_step_about_a_place_keeps_it_where_it_is_but_for_its_shift():
    rng = np.random.default_rng(4)
    pose = np.concatenate([rng.normal(0, 9, 3), rigid.random_rotations(1, rng)[0]])
    center = rng.normal(0, 9, 3)
    anchor = rigid.transform(pose, center[None])[0]
    step = np.concatenate([rng.normal(0, 2, 3), rng.normal(0, 0.1, 3)])
    moved = advanced_about(pose.copy(), anchor, center, step, 0.5)
    np.testing.assert_allclose(rigid.transform(moved, (center - 0.5 * step[:3])[None])[0], anchor)
    assert rigid.angle_between(moved[3:], pose[3:]) == pytest.approx(0.5 * np.linalg.norm(step[3:]), rel=0.01)


@pytest.mark.parametrize(
    ("step", "by"), [([1, 0, 0, 0, 0, 0], 1.0), ([4, 0, 0, 0, 0, 0], 0.5), ([0, 0, 0, 0, 0.8, 0], 0.25)]
)
def test_a_long_step_is_shortened(step, by):
    assert part(np.array(step, dtype=float), 2.0, 0.2) == pytest.approx(by)


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
