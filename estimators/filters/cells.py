"""Cells of different sizes: bins of a grid that were halved in x, y and angle, some more often than others."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.halving import middles


@dataclass(frozen=True, eq=False)
class Cells:
    """Some cells. times: (n,) how often bins of `grid` were halved for them.

    index: (n,) flat, into the (letters, angles, rows, columns) of the grid so halved.
    """

    grid: StateGrid
    times: NDArray[np.int64]
    index: NDArray[np.int64]

    def of(self, chosen: NDArray[np.intp]) -> Cells:
        """Keep some cells."""
        return Cells(self.grid, self.times[chosen], self.index[chosen])

    @cached_property
    def letter(self) -> NDArray[np.int64]:
        """Give the number of each cell's letter (n,)."""
        letter: NDArray[np.int64] = self.index // (self.grid.bins << 3 * self.times)
        return letter

    @cached_property
    def states(self) -> FloatArray:
        """Give T_R^O (3, n), mm, mm, rad, of the cells' centroids."""
        grid, letter, state = self.grid, np.empty_like(self.index), np.empty((3, len(self.index)))
        counts = np.array([grid.x, grid.y, grid.angle])
        middles(state, letter, self.times, self.index, counts, np.array(grid.spacing))
        return state

    @property
    def size(self) -> FloatArray:
        """Give each cell's size in x, y and angle (3, n), mm, mm, rad."""
        return np.array(self.grid.spacing)[:, None] * 0.5**self.times

    def bins(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Find the angle, row and column (n,) of the grid's bin in which each cell lies."""
        first = np.array([[axis[0]] for axis in self.grid.centres])
        column, row, angle = np.rint((self.states - first) / np.array(self.grid.spacing)[:, None]).astype(
            np.int64
        )
        return angle, row, column
