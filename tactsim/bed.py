"""The bed of springs that carries a letter's face: one contact for each cell that the face covers.

An elastic (Winkler) foundation answers every point of the face with a pressure proportional to its
depth. A flat face has a depth that is linear over a cell, tilted or not, so one spring at the
centroid of the covered part, as stiff as that part is large, carries exactly the force of the whole
part. All error of a bed is in where it thinks that the outline lies; the clip is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.clip import cell_moments
from tactsim.poses import FloatArray, invert

# A cell carries in proportion to what is covered of it. Below this part of the press's whole contact
# it is rounding, or lighter than the force balance that is promised (1e-4).
SMALLEST_PART = 1e-8
SMALLEST_CONTACT = 1e-9  # mm^2; what touches less than this does not touch


@dataclass(frozen=True, eq=False)
class Bed:
    """The covered cells of many presses, one row per contact, ordered by press.

    press: (contacts,) which press. cell: (contacts,) row * columns + column in the grid of cells.
    centroid: (contacts, 2) mm in the sensor frame. area: (contacts,) mm^2. moments: (contacts, 6)
    about the cell's centre (`clip.MOMENTS`). start: (presses + 1,) where each press's rows begin.
    """

    press: NDArray[np.intp]
    cell: NDArray[np.intp]
    centroid: FloatArray
    area: FloatArray
    moments: FloatArray
    start: NDArray[np.intp]


def lay_bed(edges: FloatArray, poses: FloatArray, x_lines: FloatArray, y_lines: FloatArray) -> Bed:
    """Find the contacts of a flat face with outline `edges` at `poses` (n, 3) sensor_in_object."""
    moments = cell_moments(edges, invert(poses), x_lines, y_lines)
    rows, columns = len(y_lines) - 1, len(x_lines) - 1
    moments = moments.reshape(len(poses), rows * columns, -1)
    area = moments[..., 0]
    whole = area.sum(axis=1, keepdims=True)
    press, cell = np.nonzero((area > SMALLEST_PART * whole) & (whole > SMALLEST_CONTACT))
    moments = moments[press, cell]
    area = moments[:, 0]
    row, column = np.divmod(cell, columns)
    centre = np.stack([(x_lines[column] + x_lines[column + 1]) / 2, (y_lines[row] + y_lines[row + 1]) / 2])
    centroid = (centre + moments[:, 1:3].T / area).T
    start = np.searchsorted(press, np.arange(len(poses) + 1))
    return Bed(press, cell, centroid, area, moments, start)
