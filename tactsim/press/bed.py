"""The bed of springs that carries a letter's face: one spring for each grid cell that the face covers.

The bed is an elastic (Winkler) foundation: the pressure at a point is proportional to the depth there.
Under a flat face, tilted or not, the depth is linear over a cell. One spring at the centroid of the
part that touches, with a stiffness proportional to the part's area, then carries exactly the force of
that part. `clip` gives areas and centroids exactly.

A face that is not flat is described by levels: flat regions, each at its own gap behind the foremost one.
`levels` lists those of a letter: its face, or the levels of a rounded edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, invert
from tactsim.models.letter import Letter
from tactsim.press.clip import EVEN_MOMENTS, cell_moments, edges_of

if TYPE_CHECKING:
    from tactsim.press.scan_options import PressOptions

MM = 1e-3  # m
# A cell's force is proportional to its covered area. A cell with less than this share of the whole contact is
# left out: its force would be far below the balance of forces that is promised (1e-4).
SMALLEST_PART = 1e-8
# Cells of all presses that are clipped at a time, so that their moments stay in the processor's cache.
_BLOCK = 1 << 17
SMALLEST_CONTACT = 1e-9  # mm^2; what touches less than this does not touch
ROUNDING_LEVELS = 16  # levels of a rounded edge; more change none by 0.3 % of the largest, up to 1 mm


@dataclass(frozen=True, eq=False)
class Level:
    """A flat region of a face.

    edges: (n, 2, 2) mm, of its closed contours (`clip.edges_of`). gap: mm by which it lies behind the foremost region.
    """

    edges: FloatArray
    gap: float = 0.0


def levels(letter: Letter, options: PressOptions) -> list[Level]:
    """List the flat regions that a press can touch, the foremost first.

    A rounded edge is a quarter circle, cut into levels at equal angles; each lies at its mean gap.
    Raises InputError if the letter has relief.
    """
    if has_relief(letter, options):
        raise InputError(
            f"{letter.name!r} has relief, which is pressed at rest alone; give dynamics = equilibrium, engine = auto"
        )
    return _rounded(letter) if letter.rounding else [Level(edges_of(letter.contours))]


def has_relief(letter: Letter, options: PressOptions) -> bool:
    """Tell whether a press may feel more of a letter than a flat face or the rounded edge of one.

    Only the layer's thickness matters, because a layer never gives way by more.
    """
    return letter.relief is not None and letter.flat_depth < options.thickness


def _rounded(letter: Letter) -> list[Level]:
    from tactsim.models.parts import inset

    radius = letter.rounding
    angle = np.linspace(0, np.pi / 2, ROUNDING_LEVELS + 1)  # from the flat of the face to its side
    outlines = [
        inset(letter.contours, distance) if distance > 0 else list(letter.contours)
        for distance in radius * (1 - np.sin(angle))
    ]
    # The mean of the gap, radius (1 - cos), over an inset that grows as sin.
    integral = np.sin(angle) - angle / 2 - np.sin(2 * angle) / 4
    gaps = radius * np.diff(integral) / np.diff(np.sin(angle))
    return [Level(edges_of(outlines[0]))] + [
        Level(edges_of([*outer, *(contour[::-1] for contour in inner)]), float(gap))
        for inner, outer, gap in zip(outlines[:-1], outlines[1:], gaps, strict=True)
    ]


class Springs(NamedTuple):
    """The springs of one press.

    rows: which rows of the bed they are. position: (n, 3) m in the sensor frame, z along the press: where the
    letter meets each. share: (n,) each spring's area over the largest one's, by which its stiffness is
    scaled. area: mm^2, of all. largest: mm^2, of the largest.
    """

    rows: slice
    position: FloatArray
    share: FloatArray
    area: float
    largest: float


@dataclass(frozen=True, eq=False)
class Bed:
    """The covered cells of many presses, one row per contact, ordered by press, level and cell.

    level: (contacts,) index of the level that touches. cell: (contacts,) row * columns + column in the grid of cells.
    centre: (contacts, 2) mm, of the cell in the sensor frame. centroid: (contacts, 2) mm, of the part that touches.
    area: (contacts,) mm^2, of that part. gap: (contacts,) mm. moments: (EVEN_MOMENTS or MOMENTS, contacts) of the part
    about the cell's centre (`clip.POWERS`). start: (presses + 1,) where each press's rows begin.
    """

    level: NDArray[np.intp]
    cell: NDArray[np.intp]
    centre: FloatArray
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
    def area_of_presses(self) -> FloatArray:
        """Sum the areas of each press's contacts, (presses,) mm^2."""
        return np.asarray(np.bincount(self.press, self.area, len(self.start) - 1), dtype=float)

    @cached_property
    def springs(self) -> list[Springs]:
        """Describe the springs of each press."""
        presses = len(self.start) - 1
        largest = np.zeros(presses)
        some = np.diff(self.start) > 0
        if some.any():
            largest[some] = np.maximum.reduceat(self.area, self.start[:-1][some])
        share = self.area / largest[self.press]
        position = np.column_stack([self.centroid, self.gap]) * MM
        rows = [slice(*pair) for pair in pairwise(self.start.tolist())]
        return [
            Springs(here, position[here], share[here], area, most)
            for here, area, most in zip(rows, self.area_of_presses.tolist(), largest.tolist(), strict=True)
        ]

    def among(self, presses: NDArray[np.intp], count: int) -> Bed:
        """Say that its presses are `presses`, rising, out of `count`."""
        return replace(self, start=np.searchsorted(presses[self.press], np.arange(count + 1)))

    def repeat(self, times: int) -> Bed:
        """List the contacts of a bed of one press `times` over, as if pressed again at the same pose."""
        rows = np.tile(np.arange(len(self.area)), times)
        return Bed(
            level=self.level[rows], cell=self.cell[rows], centre=self.centre[rows], centroid=self.centroid[rows],
            area=self.area[rows], gap=self.gap[rows], moments=self.moments[:, rows],
            start=len(self.area) * np.arange(times + 1),
        )  # fmt: skip


def lay_bed(
    levels: Sequence[Level],
    poses: FloatArray,
    x_lines: FloatArray,
    y_lines: FloatArray,
    *,
    tilts: FloatArray | None = None,
    depths: FloatArray | None = None,
    moments: int = EVEN_MOMENTS,
) -> Bed:
    """Find the contacts of a face at `poses` (n, 3) sensor_in_object with a grid of cells, mm.

    x_lines (columns + 1,), y_lines (rows + 1,): the edges of the cells in the sensor frame. tilts: (n, 2)
    rad about the pad's x and y, by which the face is turned about the pad's middle. depths: (n,) mm, how
    deep the foremost level is at the pad's middle; what is not below the pad's surface then has no contact.
    Without `depths` all that lies over the pad has one. moments: how many, as in `clip.cell_moments`.
    """
    rows, columns = len(y_lines) - 1, len(x_lines) - 1
    object_in_sensor = invert(poses)
    plane = surface = None
    if tilts is not None:
        # The plane map of a face turned by its tilt about the pad's middle, seen along z.
        (cos_x, cos_y), (sin_x, sin_y) = np.cos(tilts.T), np.sin(tilts.T)
        across = np.stack([cos_y, np.zeros_like(cos_y)], axis=1)
        plane = np.stack([across, np.stack([sin_x * sin_y, cos_x], axis=1)], axis=1)
    if depths is not None:
        slope = slopes(tilts) if tilts is not None else np.zeros((len(poses), 2))
        surface = np.column_stack([depths, slope])
    block = max(1, _BLOCK // (rows * columns))
    found = []
    for first in range(0, max(len(poses), 1), block):
        these = slice(first, first + block)
        of_levels = [
            cell_moments(
                level.edges, object_in_sensor[these], x_lines, y_lines,
                plane=None if plane is None else plane[these],
                depth=None if surface is None else surface[these] - (level.gap, 0.0, 0.0),
                moments=moments,
            )
            for level in levels
        ]  # fmt: skip
        every = np.stack([some.reshape(*some.shape[:2], rows * columns) for some in of_levels], axis=2)
        area = every[0]
        whole = area.sum(axis=(1, 2), keepdims=True)
        covered = (area > SMALLEST_PART * whole) & (whole > SMALLEST_CONTACT)
        press, *level_and_cell = np.nonzero(covered)
        found.append((press + first, *level_and_cell, every[:, covered]))
    press, level_index, cell, kept = (np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True))
    area = kept[0]
    row, column = np.divmod(cell, columns)
    centre = np.stack(
        [((x_lines[:-1] + x_lines[1:]) / 2)[column], ((y_lines[:-1] + y_lines[1:]) / 2)[row]], axis=1
    )
    offset = kept[1:3] / area
    return Bed(
        level=level_index,
        cell=cell,
        centre=centre,
        centroid=centre + offset.T,
        area=area,
        gap=np.array([level.gap for level in levels])[level_index],
        moments=kept,
        start=np.searchsorted(press, np.arange(len(poses) + 1)),
    )


def slopes(tilts: FloatArray) -> FloatArray:
    """Give how fast a tilted face gets deeper along the pad's x and y: (n, 2) from tilts (n, 2) rad.

    The face is turned by Rx(tilt_x) Ry(tilt_y).
    """
    x, y = tilts.T
    return np.stack([-np.tan(y) / np.cos(x), np.tan(x)], axis=1)
