"""Bins, and the halving of the best, for a measurement model that is any function: in NumPy, and no bin waits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.plain_field import PlainField
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.binned import BinnedBelief
from tactsim.estimators.filters.cells import Cells, Limits, least_chosen
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.states import Weights, pose_samples


class PlainBins:
    """log p(letter, bin | readings) of all bins, not normalised (paper, eq. 13); it can be asked as `BinnedBelief` can.

    A reading that is impossible in every bin leaves the belief as it was, and is counted.
    """

    def __init__(self, field: PlainField, grid: StateGrid) -> None:
        self._field, self._grid = field, grid
        self._letter = np.repeat(np.arange(len(field.labels)), grid.bins)
        self._state = grid.states(np.arange(len(self._letter)))
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        self._taken_in, self._log_p = 0, np.zeros(len(self._letter))
        self._least = -math.inf

    def update(self, within: float, keep: int = 0) -> tuple[int, int]:
        """Multiply the belief by the likelihood of the field's new readings (eq. 13); see `BinnedBelief.update`."""
        new = len(self._field) - self._taken_in
        for reading in range(self._taken_in, self._taken_in + new):
            log_p = self._log_p + self._field.log_p(self._letter, self._state, reading, reading + 1)
            if np.isneginf(log_p).all():
                self._field.ignore_last()
            else:
                self._log_p = log_p
        self._taken_in += new
        kept = least_chosen(self._log_p, keep + 1) if keep else math.inf
        self._least = min(float(self._log_p.max()) - within, kept)
        return new * len(self._log_p), 0

    @property
    def listed(self) -> tuple[NDArray[np.int64], FloatArray]:
        """List the bins that `update` was asked for: flat indices into (letters, angles, y, x), and log-beliefs."""
        flat = np.flatnonzero((self._log_p >= self._least) & (self._log_p > -np.inf))
        return flat, self._log_p[flat]

    def summary(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """Sum the bins of each letter (eq. 14), and find its mode (eq. 15): (letters,) each."""
        each = self._log_p.reshape(len(self._field.labels), -1)
        return np.exp(each - each.max()).sum(axis=1), each.argmax(axis=1)

    def samples(self, letter: int, within: float) -> PoseSamples:
        """Give the bins of a letter that are at most `within` nats below the best bin."""
        flat = np.flatnonzero((self._letter == letter) & (self._log_p >= self._log_p.max() - within))
        size = np.repeat(np.array(self._grid.spacing)[:, None], len(flat), axis=1)
        return pose_samples(self._grid.states(flat), Weights(self._log_p[flat]), size)

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns)."""
        return self._log_p.reshape(len(self._field.labels), self._grid.angle, self._grid.y, self._grid.x)

    def best_of_letters(self) -> tuple[FloatArray, int]:
        """Give the log-belief of the best bin of each letter (letters,); it takes in no reading."""
        return self._log_p.reshape(len(self._field.labels), -1).max(axis=1), 0


def bins_on(field: LikelihoodField, grid: StateGrid, *, skip: bool) -> BinnedBelief | PlainBins:
    """Keep the bins of a grid up to date with a field; those of tables may wait if `skip`."""
    if isinstance(field, TableField):
        return BinnedBelief(field, grid, skip=skip)
    assert isinstance(field, PlainField)
    return PlainBins(field, grid)


def halve_best(
    cell: NDArray[np.int64],
    log_p: FloatArray,
    limits: Limits,
    weight: float,
    field: LikelihoodField,
    grid: StateGrid,
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray, int]:
    """Do as `cells.refine` does, all readings replayed in every half: where sizes end, cells, log-beliefs, work."""
    left, left_log_p, end, evaluated = [], [], [], 0
    for times in range(limits.most + 1):
        enough = times >= limits.least and Weights(weight * log_p).ess > limits.enough
        least = least_chosen(log_p, limits.cells)
        best = (log_p > least) | (least == -np.inf)
        if enough or times == limits.most:
            best[:] = False
        halves = Cells(grid, np.full(8 * best.sum(), times + 1), _halves(np.sort(cell[best]), times, grid))
        of_halves = field.log_p(halves.letter, halves.states)
        evaluated += len(of_halves) * len(field)
        if np.isneginf(of_halves).all():  # none, or all impossible: then the cells stay as they are
            best[:] = False
        left.append(cell[~best])
        left_log_p.append(log_p[~best])
        end.append(len(left[-1]))
        if not best.any():
            break
        cell, log_p = halves.index, of_halves
    return np.cumsum(end), np.concatenate(left), np.concatenate(left_log_p), evaluated


def _halves(cell: NDArray[np.int64], times: int, grid: StateGrid) -> NDArray[np.int64]:
    """Find the eight halves of cells (n,) of a grid halved `times` times: (8 n,) of the grid halved once more."""
    sides = grid.angle << times, grid.y << times, grid.x << times
    letter, *place = np.unravel_index(cell, (int(cell.max(initial=0)) // math.prod(sides) + 1, *sides))
    parts = np.indices((2, 2, 2)).reshape(3, 1, 8)
    angle, row, column = (2 * axis[:, None] + part for axis, part in zip(place, parts, strict=True))
    index = ((letter[:, None] * 2 * sides[0] + angle) * 2 * sides[1] + row) * 2 * sides[2] + column
    return np.asarray(index.ravel(), dtype=np.int64)
