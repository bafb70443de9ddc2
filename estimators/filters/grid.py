"""The bins of a grid filter: how x, y and the angle of T_R^O are divided (paper, Table I)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

# Table I; its totals are bins per letter.
TABLE_I = {100: (5, 5, 4), 1_000: (10, 10, 10), 10_000: (25, 25, 16)}
_LARGEST = 20_000_000
# mm, radius of gyration of a letter of 25 mm: an angle of 1 rad moves its points by as much, rms.
_GYRATION = 9.0


@dataclass(frozen=True)
class StateGrid:
    """Equal bins over T_R^O of one letter: x and y in [-reach, reach] mm, the angle on the circle."""

    x: int
    y: int
    angle: int
    reach: float = 10.0

    @property
    def bins(self) -> int:
        """Count the bins of one letter."""
        return self.x * self.y * self.angle

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Give the size of a bin: mm, mm, rad."""
        return 2 * self.reach / self.x, 2 * self.reach / self.y, 2 * math.pi / self.angle

    @cached_property
    def centres(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give the bins' centroids along x, y (mm) and angle (rad, in [-pi, pi))."""
        dx, dy, da = self.spacing
        x = np.arange(0.5, self.x) * dx - self.reach
        y = np.arange(0.5, self.y) * dy - self.reach
        return x, y, np.arange(0.5, self.angle) * da - np.pi

    def states(self, flat: NDArray[np.int64]) -> FloatArray:
        """Give T_R^O (3, n), mm, mm, rad, in the middle of bins: flat indices (n,) into (letters, angles, y, x)."""
        x, y, angle = self.centres
        rest, column = np.divmod(flat, self.x)
        rest, row = np.divmod(rest, self.y)
        return np.stack([x[column], y[row], angle[rest % self.angle]])

    def reaching(self, reach: float, usual: float, most: int) -> StateGrid:
        """Give a grid for x and y in [-reach, reach] mm, with bins as wide as this one's are for `usual` mm.

        Nearer than that, it has as many bins. most: bins that a letter may have; with more they are wider.
        """
        farther = min(max(1.0, reach / usual), max(1.0, math.sqrt(most / self.bins)))
        return replace(self, x=int(self.x * farther), y=int(self.y * farther), reach=reach)

    def describe(self) -> str:
        """Say the split in one line."""
        dx, dy, da = self.spacing
        return (
            f"{self.x} x {self.y} x {self.angle} = {self.bins:,} bins an object, "
            f"each {dx:.3g} mm x {dy:.3g} mm x {math.degrees(da):.3g} deg"
        )


def state_grid(bins: int, split: str | None = None, reach: float = 10.0) -> StateGrid:
    """Divide the states of a letter into about `bins` bins, or as `split` ("16x16x36") says.

    Table I's totals are split as printed there. Any other count is split into n x n x m of at most
    that many bins, so that the rms distance from a point of a 25 mm letter to where the bin's
    centroid puts it is least. Raises InputError if a split is not three counts from 1.
    """
    if split is not None:
        counts = re.fullmatch(r"(\d{1,6})[x,](\d{1,6})[x,](\d{1,6})", split.replace(" ", ""))
        grid = StateGrid(int(counts[1]), int(counts[2]), int(counts[3]), reach) if counts else None
        if grid is None or not 1 <= grid.bins <= _LARGEST:
            raise InputError(
                f"split {split!r} is not three counts like 16x16x36 with at most {_LARGEST:,} bins in all"
            )
        return grid
    if not 1 <= bins <= _LARGEST:
        raise InputError(f"bins is {bins}; it must be from 1 to {_LARGEST:,}")
    if bins in TABLE_I:
        return StateGrid(*TABLE_I[bins], reach)
    return min(
        (StateGrid(n, n, bins // n**2, reach) for n in range(1, math.isqrt(bins) + 1)), key=_mean_square
    )


def _mean_square(grid: StateGrid) -> float:
    """Expect the square of the distance (mm) from a uniform state to its bin's centroid."""
    dx, dy, da = grid.spacing
    return (dx**2 + dy**2) / 12 + 2 * _GYRATION**2 * (1 - math.sin(da / 2) / (da / 2))
