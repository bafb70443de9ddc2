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
from tactsim.estimators.filters.coarse_kernels import Coarse, Placed, best_bins
from tactsim.estimators.filters.grid import StateGrid

# Nats; bins that are as near to the last one listed are listed too.
_ROUNDING = 1e-6
# Of so many terms, each of one reading and angle, it is kept where bins look them up: 80 bytes each.
_PLACED = 2**17


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
        self._slices = field.slices(np.array([x[0], y[0]]), grid.spacing[:2])
        tables = field.tables
        # Without skipping nothing is bounded.
        nodes = tables.nodes if skip else np.zeros_like(tables.nodes, shape=(1, 1, *tables.phases))
        self._levels = levels_of(nodes, tables.unit, tables.phases)
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        inside = bins_of_tiles(grid)
        tiles = len(field.labels), grid.angle, *inside.shape[:2]
        self._blank = np.where(inside, 0, -np.inf)
        self._coarse = Coarse(
            log_p=np.zeros((*tiles, TALL * LANES)),
            upper=np.zeros((*tiles, TALL * LANES), dtype=np.float32),
            seen=np.zeros(tiles, dtype=np.int64),
            bound=np.zeros(tiles),
            bins=inside.sum(axis=2),
            size=np.array([grid.y, grid.x]),
        )
        self._placed = _room_to_place(1, grid.angle, 0)
        self.evaluated = self.left_alone = self.bounded = 0
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        self._coarse.log_p[:] = self._blank
        self._coarse.upper[:] = self._blank
        self._coarse.seen[:] = 0
        self._coarse.bound[:] = 0
        self._taken_in = self._oldest = 0
        self.listed = np.zeros(1, dtype=np.int64), np.zeros(1)

    def take_in(self, keep: int, within: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Multiply the belief by the likelihood of the field's new readings, one at least (eq. 13), in logs.

        Returns all bins at most `within` nats below the best, and in any case the best `keep` and one more: flat
        indices into (letters, angles, rows, columns), and log-beliefs.
        """
        field, count = self._field, len(self._field)
        if field.longest > self._placed.offset.shape[2]:
            slots = max(1, _PLACED // (self._grid.angle * field.longest))
            self._placed = _room_to_place(slots, self._grid.angle, field.longest)
            self._oldest = self._taken_in
        self._oldest = max(self._oldest, count - len(self._placed.offset) + 1)
        flat, log_p, evaluated = best_bins(
            self._coarse, self._levels, self._slices, field.terms, self._turns, self._placed, self._oldest,
            self._taken_in, count, self._skip, keep, within, _ROUNDING,
        )  # fmt: skip
        every = len(field.labels) * self._grid.bins * (count - self._taken_in)
        self.evaluated += evaluated
        self.left_alone += every - evaluated
        self.bounded += every if self._skip and count > 1 else 0
        self._taken_in, self.listed = count, (flat, log_p)
        return self.listed

    def certificate(self) -> Certificate:
        """Give the best bin, and how far below it the bins that were left alone are at least."""
        waits = self._coarse.seen != len(self._field)
        others = float(self._coarse.bound[waits].max(initial=-math.inf))
        return Certificate.of(self._field.labels, self._grid, *self.listed, others)


def _room_to_place(slots: int, angles: int, longest: int) -> Placed:
    """Make room for the terms of so many readings, and of one more, for every angle."""
    shape = slots + 1, angles, longest, 4
    return Placed(
        np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.int64)
    )
