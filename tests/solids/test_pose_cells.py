"""Cells of rotations and poses: they part the prior, halves add up, and what is thinned keeps its sum."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import rigid
from tactsim.solids.pose_search import CellSizes, PoseCells, every_cell, thinned, volumes

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
