"""The coarse bins of a coarse-to-fine filter: the best of them after every reading, whichever letter's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.table_levels import levels_of
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.binned import Certificate, bins_of_tiles
from tactsim.estimators.filters.coarse_bounds import Coarse
from tactsim.estimators.filters.coarse_kernels import best_bins
from tactsim.estimators.filters.grid import StateGrid

# Nats; bins that are as near to the last one listed are listed too.
_ROUNDING = 1e-6


class CoarseBins:
    """log p(letter, bin | readings) of the bins that may be among the best (paper, eq. 13), not normalised.

    With `skip` the others wait: their upper bounds take in every reading, they themselves only when a bound comes
    within what is asked for. What is listed is the same.

    evaluated, left_alone: how many times a bin took in a reading, and how many times it need not. bounded: how many
    times its bound did. listed: what `take_in` returned last.
    """

    def __init__(self, field: LikelihoodField, grid: StateGrid, skip: bool) -> None:
        self._field, self._grid, self._skip = field, grid, skip
        x, y, angle = grid.centres
        self._layout = field.layout(np.array([x[0], y[0]]), grid.spacing[:2])
        tables = field.tables
        # Without skipping nothing is bounded.
        nodes = tables.nodes if skip else np.zeros_like(tables.nodes, shape=(1, 1, *tables.phases))
        self._levels = levels_of(nodes, tables.unit, tables.phases)
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        inside = bins_of_tiles(grid)
        tiles = len(field.labels) * grid.angle * inside.shape[0] * inside.shape[1]
        self._blank = np.where(inside, np.float32(0), np.float32(-np.inf)).reshape(-1, TALL * LANES)
        self._coarse = Coarse(
            upper=np.zeros((tiles, TALL * LANES), dtype=np.float32),
            bound=np.zeros(tiles),
            log_p=np.zeros((tiles, TALL * LANES)),
            seen=np.zeros((tiles, TALL * LANES), dtype=np.int32),
            counts=np.array([grid.x, grid.y, grid.angle]),
            spacing=np.array(grid.spacing),
        )
        self.evaluated = self.left_alone = self.bounded = 0
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        self._coarse.upper.reshape(-1, *self._blank.shape)[:] = self._blank
        self._coarse.bound[:] = 0
        self._coarse.log_p[:] = 0
        self._coarse.seen[:] = 0
        self._taken_in, self._waits = 0, -math.inf
        self._likely = np.zeros(0, dtype=np.int64)
        self.listed = np.zeros(1, dtype=np.int64), np.zeros(1)

    def take_in(self, keep: int, within: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Multiply the belief by the likelihood of the field's new readings, one at least (eq. 13), in logs.

        Returns all bins at most `within` nats below the best, and in any case the best `keep` and one more: flat
        indices into (letters, angles, rows, columns), and log-beliefs.
        """
        field, count = self._field, len(self._field)
        flat, log_p, self._waits, evaluated, self._likely = best_bins(
            self._coarse, self._levels, self._layout, field.terms, field.tables.sampled, self._turns,
            self._taken_in, count, self._skip, keep, within, _ROUNDING, self._likely,
        )  # fmt: skip
        every = len(field.labels) * self._grid.bins * (count - self._taken_in)
        self.evaluated += evaluated
        self.left_alone += every - evaluated
        self.bounded += every if self._skip else 0
        self._taken_in, self.listed = count, (flat, log_p)
        return self.listed

    def certificate(self) -> Certificate:
        """Give the best bin, and how far below it the bins that were left alone are at least."""
        return Certificate.of(self._field.labels, self._grid, *self.listed, self._waits)
