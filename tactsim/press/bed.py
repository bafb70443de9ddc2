"""The bed of springs that carries a letter's face: one spring for each grid cell that the face covers.

The bed is an elastic (Winkler) foundation: the pressure at a point is proportional to the depth there.
Under a flat face, tilted or not, the depth is linear over a cell. One spring at the centroid of the
covered part, with a stiffness proportional to the part's area, then carries exactly the force of that
part. `clip` gives areas and centroids exactly.

A face that is not flat is described by levels: flat regions, each at its own gap behind the foremost one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray, invert
from tactsim.press.clip import EVEN_MOMENTS, cell_moments

MM = 1e-3  # m
# A cell's force is proportional to its covered area. A cell with less than this share of the whole contact is
# left out: its force would be far below the balance of forces that is promised (1e-4).
SMALLEST_PART = 1e-8
SMALLEST_CONTACT = 1e-9  # mm^2; what touches less than this does not touch


@dataclass(frozen=True, eq=False)
class Level:
    """A flat region of a face.

    edges: (n, 2, 2) mm, of its closed contours (`clip.edges_of`). gap: mm by which it lies behind the
    foremost region.
    """

    edges: FloatArray
    gap: float = 0.0


class Springs(NamedTuple):
    """The springs of one press.

    rows: which rows of the bed they are. position: (n, 3) m in the sensor frame, z along the press: where the
    letter meets each. share: (n,) each spring's area over the largest one's, by which its stiffness is
    scaled. A spring without area, which nothing can touch, has share 1, so that a fault which touches it
    shows in the forces. level: (n,) index of the level, or of the letter's part, that each one carries.
    area: mm^2, of all. largest: mm^2, of the largest. flat: whether no spring of the whole bed has a gap.
    """

    rows: slice
    position: FloatArray
    share: FloatArray
    level: NDArray[np.intp]
    area: float
    largest: float
    flat: bool


@dataclass(frozen=True, eq=False)
class Bed:
    """The covered cells of many presses, one row per contact, ordered by press, level and cell.

    level: (contacts,) index of the level (or part) that touches. cell: (contacts,) row * columns +
    column in the grid of cells. centroid: (contacts, 2) mm in the sensor frame. area: (contacts,) mm^2.
    gap: (contacts,) mm. moments: (6, contacts) about the cell's centre (`clip.MOMENTS`).
    start: (presses + 1,) where each press's rows begin.
    """

    level: NDArray[np.intp]
    cell: NDArray[np.intp]
    centroid: FloatArray
    area: FloatArray
    gap: FloatArray
    moments: FloatArray
    start: NDArray[np.intp]

    @cached_property
    def press(self) -> NDArray[np.intp]:
        """Index of each contact's press, (contacts,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    @cached_property
    def springs(self) -> list[Springs]:
        """Describe the springs of each press."""
        presses = len(self.start) - 1
        # Added one by one, springs without area do not change a bit of the sum.
        total = np.bincount(self.press, self.area, presses)
        largest = np.zeros(presses)
        some = np.diff(self.start) > 0
        if some.any():
            largest[some] = np.maximum.reduceat(self.area, self.start[:-1][some])
        share = np.divide(self.area, largest[self.press], out=np.ones_like(self.area), where=self.area > 0)
        position = np.column_stack([self.centroid, self.gap]) * MM
        flat = not self.gap.any()
        rows = [slice(*pair) for pair in pairwise(self.start.tolist())]
        return [
            Springs(here, position[here], share[here], self.level[here], area, most, flat)
            for here, area, most in zip(rows, total.tolist(), largest.tolist(), strict=True)
        ]

    def repeat(self, times: int) -> Bed:
        """List the contacts of a bed of one press `times` over, as if pressed again at the same pose."""
        return Bed(
            level=np.tile(self.level, times),
            cell=np.tile(self.cell, times),
            centroid=np.tile(self.centroid, (times, 1)),
            area=np.tile(self.area, times),
            gap=np.tile(self.gap, times),
            moments=np.tile(self.moments, times),
            start=len(self.area) * np.arange(times + 1),
        )


def lay_bed(
    levels: Sequence[Level],
    poses: FloatArray,
    x_lines: FloatArray,
    y_lines: FloatArray,
    *,
    skip_empty: bool = True,
) -> Bed:
    """Find the contacts of a face at `poses` (n, 3) sensor_in_object with a grid of cells, mm.

    x_lines (columns + 1,), y_lines (rows + 1,): the edges of the cells in the sensor frame.
    Without `skip_empty` a cell that a level does not cover gets a spring too, at the cell's centre; such a
    spring has no area and nothing touches it.
    """
    rows, columns = len(y_lines) - 1, len(x_lines) - 1
    object_in_sensor = invert(poses)
    every = np.empty((EVEN_MOMENTS, len(poses), len(levels), rows * columns))
    for index, level in enumerate(levels):
        moments = cell_moments(level.edges, object_in_sensor, x_lines, y_lines)
        every[:, :, index] = moments.reshape(EVEN_MOMENTS, len(poses), rows * columns)
    area = every[0]
    whole = area.sum(axis=(1, 2), keepdims=True)
    covered = (area > SMALLEST_PART * whole) & (whole > SMALLEST_CONTACT)
    if not skip_empty:
        every *= covered
        covered = np.ones_like(covered)
    press, of_level, cell = np.nonzero(covered)
    moments = every[:, covered]
    area = moments[0]
    row, column = np.divmod(cell, columns)
    middle = ((x_lines[:-1] + x_lines[1:])[column] / 2, (y_lines[:-1] + y_lines[1:])[row] / 2)
    offset = np.divide(moments[1:3], area, out=np.zeros((2, len(area))), where=area > 0)
    return Bed(
        level=of_level,
        cell=cell,
        centroid=np.stack(middle + offset, axis=1),
        area=area,
        gap=np.array([level.gap for level in levels])[of_level],
        moments=moments,
        start=np.searchsorted(press, np.arange(len(poses) + 1)),
    )
