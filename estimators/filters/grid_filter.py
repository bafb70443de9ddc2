"""What the filters whose poses are the bins of a grid share: the grid, and that it follows the pad."""

from __future__ import annotations

from dataclasses import replace

from tactsim.estimators.filters.grid import StateGrid, state_grid
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.options import FilterOptions, reach_of


class GridFilter(MapFilter):
    """A filter on maps over the bins of `grid`, which options say by `bins`, or by `split`."""

    budget = "bins"
    draws = False
    grid: StateGrid

    def __init__(self, options: FilterOptions, bins: int, split: str | None) -> None:
        super().__init__(options)
        self.grid = state_grid(bins, split, reach_of(options.reach))
        if split is not None:
            self.budget = "split"

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        return self.grid.describe()

    @property
    def _spacing(self) -> tuple[float, float]:
        return self.grid.spacing[:2]

    def _reach_to(self, reach: float) -> None:
        super()._reach_to(reach)
        self.grid = replace(self.grid, reach=reach)
