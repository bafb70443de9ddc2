"""The histogram filter (paper, section III-C), which touches only the bins that can still matter."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from estimators.base import Estimate, Options
from estimators.filter import MapFilter
from estimators.grid import StateGrid, state_grid
from estimators.history import History
from estimators.kernels import advance, summarise
from estimators.likelihood import Evidence
from estimators.options import FilterOptions
from estimators.tables import Tables, tabulate
from tactsim.poses import FloatArray

# Bins that are left alone hold together at most this share of the belief.
_NEGLIGIBLE = 1e-8


class HistogramOptions(FilterOptions):
    """Options of the histogram filter."""

    bins: int = Field(10_000, description="n_H per letter; Table I's 100, 1000, 10000 split as printed")
    split: str | None = Field(None, description="bins in x, y and angle such as 16x16x36, instead of bins")
    skip: bool = Field(True, description="leave bins alone that cannot matter; the answer is the same")


class HistogramFilter(MapFilter):
    """Histogram filter over letter, x, y and angle (paper, eq. 13 to 16), in logs."""

    options_type: ClassVar[type[Options]] = HistogramOptions
    options: HistogramOptions
    grid: StateGrid
    tables: Tables

    def __init__(self, options: HistogramOptions) -> None:
        super().__init__(options)
        self.grid = state_grid(options.bins, options.split, options.reach)
        self._evaluated = self._skipped = 0

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        return self.grid.describe()

    def prepare(self) -> None:
        """Tabulate the likelihood so that neighbouring bins read neighbouring table nodes."""
        dx, dy, _ = self.grid.spacing
        x, y, angle = self.grid.centres
        self.tables = tabulate(self.likelihood, self.labels, (dx, dy), self.options.cell)
        corner = np.array([x[0], y[0]]) - self.tables.origin
        self._lattice = np.concatenate([corner, self.tables.step])
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        shape = (len(self.labels), self.grid.angle, self.grid.y, self.grid.x)
        self._belief = np.zeros(shape)
        self._top = np.zeros(shape[:3])
        self._seen = np.zeros(shape[:3], dtype=np.int64)
        self._margin = math.log(self._belief.size / _NEGLIGIBLE) if self.options.skip else math.inf
        self._history = History(self.tables)
        self._leader = 0

    def restart(self, rng: np.random.Generator) -> None:
        """Make all bins of all letters equally probable."""
        self._history.clear()
        self._top[:] = 0
        self._seen[:] = 0
        self._leader = 0

    def take(self, evidence: Evidence, xy: FloatArray) -> None:
        """Multiply the belief by the likelihood of one reading (eq. 13), in logs."""
        history = self._history
        history.append(evidence, xy)
        rows, self._leader = advance(
            self._belief, self._top, self._seen, self.tables.values, self._lattice, self._turns,
            history.start, history.kind, history.xy, history.weight, history.constant, history.ceiling,
            len(history), history.most, self._margin, self._leader,
        )  # fmt: skip
        self._evaluated += rows * self.grid.x
        self._skipped += self._belief.size - rows * self.grid.x

    def answer(self) -> Estimate:
        """Sum the bins of each letter (eq. 14); take the mode (eq. 15, 16) within the best letter."""
        mass, mode = np.zeros(len(self.labels)), np.zeros(len(self.labels), dtype=np.int64)
        summarise(self._belief, self._top, self._seen, len(self._history), self._margin, mass, mode)
        best = int(mass.argmax())
        angle, row, column = np.unravel_index(mode[best], self._belief.shape[1:])
        x, y, theta = self.grid.centres
        probabilities = (mass / mass.sum()).tolist()
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probabilities, strict=True)),
            robot_in_object=np.array([x[column], y[row], theta[angle]]),
        )

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin in a reading each, made and skipped since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {"bins": self._skipped}}
