"""The bins of the histogram filter: how x, y and the angle of T_R^O are divided (paper, Table I)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.errors import InputError
from tactsim.poses import FloatArray

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

    @property
    def centres(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give the bins' centroids along x, y (mm) and angle (rad, in [-pi, pi))."""
        dx, dy, da = self.spacing
        x = np.arange(0.5, self.x) * dx - self.reach
        y = np.arange(0.5, self.y) * dy - self.reach
        return x, y, np.arange(0.5, self.angle) * da - np.pi

    def halved(self, times: int) -> StateGrid:
        """Halve the bins in x, y and angle, so many times."""
        return replace(self, x=self.x << times, y=self.y << times, angle=self.angle << times)

    def places(self, bins: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
        """Split flat indices (n,) into (letters, angles, rows, columns): these four, (n,) each."""
        rest, column = np.divmod(bins, self.x)
        rest, row = np.divmod(rest, self.y)
        letter, angle = np.divmod(rest, self.angle)
        return letter, angle, row, column

    def states(self, bins: NDArray[np.int64]) -> tuple[NDArray[np.int64], FloatArray]:
        """Give letter (n,) and T_R^O (3, n), mm, mm, rad, of the centres of bins, given as in `places`."""
        letter, angle, row, column = self.places(bins)
        dx, dy, da = self.spacing
        half = np.array([[self.reach], [self.reach], [np.pi]])
        return letter, (np.stack([column, row, angle]) + 0.5) * [[dx], [dy], [da]] - half

    def halves(self, bins: NDArray[np.int64]) -> NDArray[np.int64]:
        """Give the eight bins (n, 8) of `halved(1)` in each bin (n,), all given as in `places`."""
        letter, angle, row, column = (place[:, None] for place in self.places(bins))
        part = np.arange(8)
        angles = 2 * (letter * self.angle + angle) + (part >> 2)
        return (angles * 2 * self.y + 2 * row + (part >> 1 & 1)) * 2 * self.x + 2 * column + (part & 1)

    def describe(self) -> str:
        """Say the split in one line."""
        dx, dy, da = self.spacing
        return (
            f"{self.x} x {self.y} x {self.angle} = {self.bins:,} bins a letter, "
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
