"""Cells of different sizes, against the grids that are divided as often."""

import numpy as np
import pytest

from tactsim.estimators.filters.cells import Cells
from tactsim.estimators.filters.grid import StateGrid


def test_cells_lie_where_the_grid_divided_as_often_has_its_bins():
    grid = StateGrid(3, 4, 5, reach=7.0)
    for times in range(3):
        fine = StateGrid(3 << times, 4 << times, 5 << times, reach=7.0)
        index = np.arange(2 * fine.bins)
        cells = Cells(grid, np.full(len(index), times), index)
        letter, angle, row, column = np.unravel_index(index, (2, fine.angle, fine.y, fine.x))
        x, y, theta = fine.centres
        assert (cells.letter == letter).all()
        assert cells.states == pytest.approx(np.stack([x[column], y[row], theta[angle]]))
        for inner, outer in zip((angle, row, column), cells.bins(), strict=True):
            assert (inner >> times == outer).all()
    mixed = Cells(grid, np.array([0, 2]), np.array([17, 3000]))
    apart = [Cells(grid, np.array([times]), np.array([k])).states for times, k in ((0, 17), (2, 3000))]
    assert mixed.states == pytest.approx(np.hstack(apart))
