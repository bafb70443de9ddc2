"""Cells of rotations and poses: they part the prior, halves add up, and what is thinned keeps its sum."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import InputError, rigid
from tactsim.estimators.space import pose_cells
from tactsim.estimators.space.pose_cells import CellSizes
from tactsim.estimators.space.rotation_cells import every_cell, volumes

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
    cube, place, voxel = (
        rng.integers(4, size=30),
        rng.integers(4, size=(30, 3)),
        rng.integers(8, size=(30, 3)),
    )
    return pose_cells.packed(3, cube, place, voxel)


@pytest.mark.parametrize(
    ("halves", "sizes"),
    [(pose_cells.turned_halves, SIZES.turned()), (pose_cells.shifted_halves, SIZES.shifted())],
)
def test_halves_share_what_their_cell_holds(halves, sizes):
    cells = some_cells()
    parts = halves(cells)
    assert (pose_cells.label_of(parts) == 3).all()
    assert len(np.unique(parts)) == 8 * len(np.unique(cells))
    whole = pose_cells.log_prior(cells, pose_cells.poses_of(cells, SIZES, ANCHOR), SIZES, 1e3)
    poses = pose_cells.poses_of(parts.ravel(), sizes, ANCHOR)
    part = pose_cells.log_prior(parts.ravel(), poses, sizes, 1e3).reshape(-1, 8)
    np.testing.assert_allclose(np.exp(part).sum(axis=1), np.exp(whole), rtol=0.05)


@pytest.mark.parametrize(
    ("labels", "sizes", "halvings", "said"),
    [
        ([0, 128], SIZES, 2, "129 objects"),
        ([0], CellSizes(8, 4.0, 16.0, 20.0), 6, "512 cells along a cube"),
        ([0], CellSizes(4, 1.0, 32.5, 20.0), 4, "1,040 voxels along"),
    ],
)
def test_more_cells_than_can_be_numbered_are_refused(labels, sizes, halvings, said):
    with pytest.raises(InputError, match=said):
        pose_cells.check_room(labels, sizes, halvings)
    pose_cells.check_room([0, 127], SIZES, 5)


def test_outside_of_the_box_the_prior_is_zero():
    cells = some_cells()
    poses = pose_cells.poses_of(cells, SIZES, np.array([25.0, 0.0, 0.0]))
    held = pose_cells.log_prior(cells, poses, SIZES)
    assert ((held == -np.inf) == (np.abs(poses[:, :3]).max(axis=1) > 20)).all()
    assert (held == -np.inf).any()


@given(st.lists(st.floats(-40, 0) | st.just(-np.inf), min_size=1, max_size=60), st.integers(1, 70))
def test_what_is_thinned_keeps_its_sum(values, count):
    log_mass = np.array(values)
    which, factor = pose_cells.thinned(log_mass, count)
    assert len(which) <= count
    assert (np.diff(which) > 0).all()
    assert (factor >= -1e-9).all()  # none is made smaller
    kept = np.exp(log_mass[which] + factor).sum()
    assert kept == pytest.approx(np.exp(log_mass).sum(), rel=1e-9, abs=1e-300)
