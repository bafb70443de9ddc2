"""The log-belief of all bins of a grid, kept up to date with a field; bins that cannot matter may wait."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.bin_sums import pick, posterior
from tactsim.estimators.filters.branch_and_bound import Belief, advance
from tactsim.estimators.filters.every_bin import take_in
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.states import CORNERS, SPREAD

# mm, about the side of a block of bins that is left alone or looked at together.
_BLOCK = 4.0
# Nats that rounding may move the highest log-belief of a block of bins.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Certificate:
    """The best bin of a grid, whichever letter's, and the proof that it is.

    label: its letter. robot_in_object: its middle, [x, y, theta]. lead: nats that it is above the upper bound of
    every bin that was left alone, infinite if none was. It is positive: no bin of the grid is better.
    """

    label: str
    robot_in_object: FloatArray
    lead: float

    @classmethod
    def of(
        cls, labels: Sequence[str], grid: StateGrid, flat: NDArray[np.int64], log_p: FloatArray, others: float
    ) -> Certificate:
        """Find the best of bins, flat indices (n,) into (letters, angles, rows, columns), with log-beliefs (n,).

        others: the upper bound of every bin that was left alone.
        """
        shape, (x, y, theta) = (len(labels), grid.angle, grid.y, grid.x), grid.centres
        letter, angle, row, column = np.unravel_index(flat[log_p.argmax()], shape)
        middle = np.array([x[column], y[row], theta[angle]])
        return cls(labels[letter], middle, float(log_p.max()) - others)


class BinnedBelief:
    """log p(letter, bin | readings) of all bins, not normalised (paper, eq. 13).

    With `negligible`, blocks of bins that hold together at most this share of the belief are left alone. Without,
    every bin is up to date after every reading.
    """

    def __init__(self, field: LikelihoodField, grid: StateGrid, negligible: float | None = None) -> None:
        letters = len(field.labels)
        self._field, self._grid = field, grid
        x, y, angle = self._axes = grid.centres
        first, spacing = np.array([x[0], y[0]]), grid.spacing[:2]
        wide, tall = _block(grid)
        self._bins = field.slices(first, spacing)
        # Where no bin is left alone nothing is bounded: the tables of blocks are not looked at.
        self._blocks = self._bins if negligible is None else field.slices(first, spacing, wide, tall)
        self._margin = math.inf if negligible is None else math.log(letters * grid.bins / negligible)
        self._belief = _blank_belief(letters, grid, wide, tall)
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        self._incumbent = 0

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        self._belief.upper[:] = 0
        self._belief.summit[:] = 0
        self._belief.seen[:] = 0
        self._belief.bounded[:] = 0
        self._incumbent = 0

    def update(self) -> tuple[int, int]:
        """Multiply the belief by the likelihood of the field's last reading (eq. 13), in logs.

        Returns how many times a bin took in a reading, and how many times a block's upper bound did.
        """
        field = self._field
        if self._margin == math.inf:
            take_in(self._belief, self._bins, field.terms, self._turns, len(field), field.longest)
            self._incumbent = int(self._belief.upper.argmax())
            return len(field.labels) * self._grid.bins, 0
        bins, blocks, self._incumbent = advance(
            self._belief, self._bins, self._blocks, field.terms, self._turns, len(field), field.longest,
            self._margin, self._incumbent,
        )  # fmt: skip
        return bins, blocks

    def of_last_reading(self) -> tuple[FloatArray, int]:
        """Give log p(last reading | bin) of all bins, and how many bins took it in; earlier readings are forgotten.

        No bin may have been left alone. Returns (letters, angles, rows, columns), and a count.
        """
        self._belief.log_p[:] = self._belief.edge
        bins, _ = self.update()
        return self.log_belief(), bins

    def summary(self, within: float) -> tuple[FloatArray, NDArray[np.int64], PoseSamples]:
        """Sum the bins of each letter (eq. 14), relative to the best bin, and find its mode (eq. 15): (letters,) each.

        A mode is a flat index into (angles, rows, columns). The samples are the bins of the letter that holds most,
        less than `within` nats below the best bin.
        """
        mass, mode, poses, weights = posterior(
            self._belief, self._field.terms.upper, len(self._field), self._margin, self._incumbent, within,
            *self._axes, np.array(self._grid.spacing), CORNERS, SPREAD,
        )  # fmt: skip
        return mass, mode, PoseSamples(poses, weights)

    def certificate(self) -> Certificate:
        """Give the best bin, and how far below it the bins that were left alone are at least."""
        any_state, waits = self._field.terms.upper[len(self._field)], self._belief.seen != len(self._field)
        best = self._belief.upper.ravel()[self._incumbent] + any_state
        flat, log_p = self._room
        found = pick(self._belief, any_state, len(self._field), best - _ROUNDING, flat, log_p)
        others = float(self._belief.upper[waits].max(initial=-math.inf)) + any_state
        return Certificate.of(self._field.labels, self._grid, flat[:found], log_p[:found], others)

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns); of those left alone -inf."""
        belief, count = self._belief, len(self._field)
        letters, angles, tile_rows, tile_columns, _ = belief.log_p.shape
        tiles = belief.log_p.reshape(letters, angles, tile_rows, tile_columns, TALL, LANES)
        bins = tiles.transpose(0, 1, 2, 4, 3, 5).reshape(letters, angles, tile_rows * TALL, -1)
        rows, columns, tall, wide = belief.size
        current = (belief.seen == count).repeat(tall, axis=2).repeat(wide, axis=3)[:, :, :rows, :columns]
        return np.where(current, bins[:, :, :rows, :columns] if count else 0.0, -np.inf)

    def upper_bounds(self) -> FloatArray:
        """Give a bound that no bin is above: of the block of each bin, (letters, angles, rows, columns)."""
        bound = self._belief.upper + self._field.terms.upper[len(self._field)]
        rows, columns, tall, wide = self._belief.size
        return bound.repeat(tall, axis=2).repeat(wide, axis=3)[:, :, :rows, :columns]

    @cached_property
    def _room(self) -> tuple[NDArray[np.int64], FloatArray]:
        bins = len(self._field.labels) * self._grid.bins
        return np.empty(bins, dtype=np.int64), np.empty(bins)


def _block(grid: StateGrid) -> tuple[int, int]:
    """Choose how many bins wide and tall a block is: whole tiles, or a tile cut into equal columns."""
    dx, dy, _ = grid.spacing
    wide = LANES * max(1, round(_BLOCK / dx / LANES))
    if _BLOCK / dx < LANES:
        wide = min(LANES, 2 ** max(0, round(math.log2(_BLOCK / dx))))
    return wide, TALL * max(1, round(_BLOCK / dy / TALL))


def bins_of_tiles(grid: StateGrid) -> NDArray[np.bool_]:
    """Tell which places of the tiles of one angle are bins: (tile rows, tile columns, TALL * LANES)."""
    rows, columns = -(-grid.y // TALL), -(-grid.x // LANES)
    row = np.arange(rows * TALL).reshape(rows, 1, TALL, 1)
    column = np.arange(columns * LANES).reshape(1, columns, 1, LANES)
    return ((row < grid.y) & (column < grid.x)).reshape(rows, columns, -1)


def _blank_belief(letters: int, grid: StateGrid, wide: int, tall: int) -> Belief:
    """Make room for the log-belief of all bins, in tiles, and for the upper bounds of its blocks."""
    inside = bins_of_tiles(grid)
    tiles = inside.shape[:2]
    blocks = (letters, grid.angle, -(-grid.y // tall), -(-grid.x // wide))
    return Belief(
        log_p=np.zeros((letters, grid.angle, *tiles, TALL * LANES)),
        edge=np.where(inside, 0, -np.inf),
        upper=np.zeros(blocks),
        seen=np.zeros(blocks, dtype=np.int64),
        bounded=np.zeros(blocks, dtype=np.int64),
        summit=np.zeros(blocks[:2]),
        size=np.array([grid.y, grid.x, tall, wide]),
    )
