"""The histogram filter (paper, section III-C), which touches only the bins that can still matter."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.field.history import History
from tactsim.estimators.field.kernels import LANES, TALL, Belief, Slices, advance, slices_of, summarise
from tactsim.estimators.field.tables import Tables, pooled, tabulate
from tactsim.estimators.filters.grid import StateGrid, state_grid
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.resampling import systematic
from tactsim.estimators.likelihoods.likelihood import Evidence
from tactsim.estimators.options import FilterOptions

# Bins that are left alone hold together at most this share of the belief.
_NEGLIGIBLE = 1e-8
# mm, about the side of a block of bins that is left alone or looked at together.
_BLOCK = 4.0


class HistogramOptions(FilterOptions):
    """Options of the histogram filter."""

    bins: int = Field(10_000, description="n_H per letter; Table I's 100, 1000, 10000 split as printed")
    split: str | None = Field(None, description="bins in x, y and angle such as 16x16x36, instead of bins")
    skip: bool = Field(True, description="leave bins alone that cannot matter; the answer is the same")


class HistogramFilter(MapFilter):
    """Histogram filter over letter, x, y and angle (paper, eq. 13 to 16), in logs."""

    options_type: ClassVar[type[Options]] = HistogramOptions
    budget = "bins"
    draws = False
    options: HistogramOptions
    grid: StateGrid
    tables: Tables

    def __init__(self, options: HistogramOptions) -> None:
        super().__init__(options)
        self.grid = state_grid(options.bins, options.split, options.reach)
        if options.split is not None:
            self.budget = "split"
        self._evaluated = self._bounds = self._skipped = 0

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        return self.grid.describe()

    def prepare(self) -> None:
        """Tabulate the likelihood so that neighbouring bins read neighbouring table nodes."""
        grid, letters = self.grid, len(self.labels)
        self.tables = tabulate(self.likelihood, self.labels, grid.spacing[:2], self.options.cell)
        self._bins = self._slices(self.tables, 1, 1)
        wide, tall = _block(grid)
        # Without bounds the kernels do not look at the blocks' tables.
        bounds = self._slices(pooled(self.tables, wide, tall), wide, tall) if self._leaves_bins else None
        self._blocks = bounds or self._bins
        self._belief = _blank_belief(letters, grid, wide, tall)
        self._centres = grid.centres
        angle = self._centres[2]
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        self._margin = math.log(letters * grid.bins / _NEGLIGIBLE) if self._leaves_bins else math.inf
        self._history = History(self.tables, self.taxel_xy)
        self._leader = 0

    @property
    def _leaves_bins(self) -> bool:
        """Tell whether bins are left alone that cannot matter."""
        return self.options.skip

    def _slices(self, tables: Tables, wide: int, tall: int) -> Slices:
        dx, dy, _ = self.grid.spacing
        corner = np.array([dx, dy]) / 2 - self.grid.reach - tables.origin
        return slices_of(tables.values, np.concatenate([corner, [wide * dx, tall * dy]]))

    def restart(self, rng: np.random.Generator) -> None:
        """Make all bins of all letters equally probable."""
        self._history.clear()
        self._belief.upper[:] = 0
        self._belief.summit[:] = 0
        self._belief.seen[:] = 0
        self._belief.bounded[:] = 0
        self._leader = 0

    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Multiply the belief by the likelihood of one reading (eq. 13), in logs."""
        history = self._history
        history.append(evidence, sensor_in_robot)
        bins, blocks, self._leader = advance(
            self._belief, self._bins, self._blocks, history.terms, self._turns, len(history), history.most,
            self._margin, self._leader,
        )  # fmt: skip
        self._evaluated += bins
        self._bounds += blocks
        self._skipped += len(self.labels) * self.grid.bins - bins

    def answer(self) -> Estimate:
        """Sum the bins of each letter (eq. 14); take the mode (eq. 15, 16) within the best letter."""
        history = self._history
        mass, mode = np.zeros(len(self.labels)), np.zeros(len(self.labels), dtype=np.int64)
        summarise(self._belief, history.terms.ceiling, len(history), self._margin, self._leader, mass, mode)
        best = int(mass.argmax())
        angle, row, column = np.unravel_index(mode[best], (self.grid.angle, self.grid.y, self.grid.x))
        x, y, theta = self._centres
        probabilities = (mass / mass.sum()).tolist()
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probabilities, strict=True)),
            robot_in_object=np.array([x[column], y[row], theta[angle]]),
        )

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns), not normalised.

        Bins that were left alone, because they cannot matter, have -inf.
        """
        belief, count = self._belief, len(self._history)
        letters, angles, tile_rows, tile_columns, _ = belief.log_p.shape
        tiles = belief.log_p.reshape(letters, angles, tile_rows, tile_columns, TALL, LANES)
        bins = tiles.transpose(0, 1, 2, 4, 3, 5).reshape(letters, angles, tile_rows * TALL, -1)
        rows, columns, tall, wide = belief.size
        current = (belief.seen == count).repeat(tall, axis=2).repeat(wide, axis=3)[:, :, :rows, :columns]
        return np.where(current, bins[:, :, :rows, :columns] if count else 0.0, -np.inf)

    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw bins by their belief, and a place in each."""
        log_p, grid = self.log_belief(), self.grid
        chosen = systematic(np.exp(log_p - log_p.max()).ravel(), count, rng)
        letter, angle, row, column = np.unravel_index(chosen, log_p.shape)
        x, y, theta = self._centres
        within = rng.uniform(-0.5, 0.5, (3, count)) * np.array(grid.spacing)[:, None]
        return letter.copy(), np.stack([x[column], y[row], theta[angle]]) + within

    def belief_over_plane(self) -> PlaneBelief:
        """Sum the belief over the angle."""
        log_p = self.log_belief()
        probability = np.exp(log_p - log_p.max()).sum(axis=1)
        x, y, _ = self._centres
        return PlaneBelief(self.labels, x, y, probability / probability.sum())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin in a reading each, made and skipped since the estimator was made.

        bound_evaluations: of blocks of bins, made in order to skip bins.
        """
        return {
            "likelihood_evaluations": self._evaluated,
            "bound_evaluations": self._bounds,
            "skipped": {"bins": self._skipped},
        }


def _block(grid: StateGrid) -> tuple[int, int]:
    """Choose how many bins wide and tall a block is: whole tiles, or a tile cut into equal columns."""
    dx, dy, _ = grid.spacing
    wide = LANES * max(1, round(_BLOCK / dx / LANES))
    if _BLOCK / dx < LANES:
        wide = min(LANES, 2 ** max(0, round(math.log2(_BLOCK / dx))))
    return wide, TALL * max(1, round(_BLOCK / dy / TALL))


def _blank_belief(letters: int, grid: StateGrid, wide: int, tall: int) -> Belief:
    """Make room for the log-belief of all bins, in tiles, and for the bounds of its blocks."""
    tiles = (-(-grid.y // TALL), -(-grid.x // LANES))
    row = np.arange(tiles[0] * TALL).reshape(tiles[0], 1, TALL, 1)
    column = np.arange(tiles[1] * LANES).reshape(1, tiles[1], 1, LANES)
    edge = np.where((row < grid.y) & (column < grid.x), 0, -np.inf)
    blocks = (letters, grid.angle, -(-grid.y // tall), -(-grid.x // wide))
    return Belief(
        log_p=np.zeros((letters, grid.angle, *tiles, TALL * LANES)),
        edge=edge.reshape(*tiles, TALL * LANES),
        upper=np.zeros(blocks),
        seen=np.zeros(blocks, dtype=np.int64),
        bounded=np.zeros(blocks, dtype=np.int64),
        summit=np.zeros(blocks[:2]),
        size=np.array([grid.y, grid.x, tall, wide]),
    )
