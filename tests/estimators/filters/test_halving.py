"""The halves of cells, against the grid that is divided as often."""

import numpy as np
import pytest

from tactsim.estimators.filters.grid import Cells, StateGrid
from tactsim.estimators.filters.halving import halve


@pytest.mark.parametrize("times", [0, 1, 3])
def test_halves_lie_where_the_finer_grid_has_them(times):
    grid = StateGrid(3, 4, 5, reach=7.0)
    rng = np.random.default_rng(times)
    cell = np.sort(rng.permutation(3 * grid.bins << 3 * times)[:40])
    which = np.setdiff1d(np.arange(40), [0, 17, 39])
    half, state, letter = np.full((40, 8), -1), np.full((3, 296), np.nan), np.full(296, -1)
    halve(half, state, letter, cell, which, np.array([3, 4, 5]) << times, np.array(grid.spacing) / 2**times)
    assert (half[[0, 17, 39]] == -1).all()
    half, cell = half[which], cell[which]
    inner = Cells(grid, np.full(296, times + 1), half.ravel())
    outer = Cells(grid, np.full(37, times), cell)
    assert len(set(half.ravel())) == 296
    assert (letter == inner.letter).all()
    assert (inner.letter.reshape(-1, 8) == outer.letter[:, None]).all()
    assert state == pytest.approx(inner.states())
    away = np.abs(state.reshape(3, 37, 8) - outer.states()[:, :, None])
    assert away == pytest.approx(np.broadcast_to(inner.size.reshape(3, 37, 8) / 2, away.shape))
