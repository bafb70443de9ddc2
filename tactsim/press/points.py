"""`lattice`, a pad's fixed points of contact, and `Points`, the forces on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.scan_options import ScanOptions
from tactsim.press.spread import felt_along

# rad, from the pad's x axis to the lattice's densest rows. A straight edge errs most where it runs along rows, which a
# hexagonal lattice has at every multiple of 30 degrees. Turned by 7.5 degrees they lie farthest from all multiples
# of 15 degrees from the pad's axes, at which edges often meet it.
_TURN = math.pi / 24
_ORIGIN = (0.618, 0.382)  # of the pad's middle in the lattice's cell; off its symmetric points
_SECOND_MOMENT = 5 / (
    36 * math.sqrt(3)
)  # of a regular hexagon about a line through its middle, per area squared
_KPA = 1e3  # kPa in a N/mm^2


@dataclass(frozen=True, eq=False)
class Points:
    """Forces on points of the pad's lattice.

    presses: how many presses there are. press: (k,) index of the press that each force belongs to, ascending.
    point: (k,) index of the point in `lattice`. force: (k,) N along the pad's normal. A point that two
    parts of the letter touch stands there twice.
    """

    presses: int
    press: NDArray[np.intp]
    point: NDArray[np.intp]
    force: FloatArray

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the forces over the taxels: (n, taxels) kPa without imperfections.

        A point's force lies evenly on its share of the pad, a hexagon. A Gaussian with the hexagon's second
        moment stands for it, and convolved with the point spread it is a Gaussian again.
        """
        pad, per_taxel = options.pad, options.press.points_per_taxel
        columns, rows = _felt(pad, per_taxel, options.sensor.psf_sigma)
        start = np.searchsorted(self.press, np.arange(self.presses + 1))
        result = np.empty((self.presses, pad.rows, pad.columns))
        for index in range(self.presses):
            here = slice(start[index], start[index + 1])
            point = self.point[here]
            result[index] = (rows[point] * self.force[here, None]).T @ columns[point]
        return _KPA / (pad.taxel_width * pad.taxel_height) * result.reshape(self.presses, pad.taxels)


@lru_cache(maxsize=4)
def lattice(pad: Pad, points_per_taxel: int) -> FloatArray:
    """Lay a hexagonal lattice over the surface that carries load: (n, 2) mm in the sensor frame.

    Each point stands for `share` of the surface.
    """
    spacing = math.sqrt(share(pad, points_per_taxel) * 2 / math.sqrt(3))
    left, right, low, high = pad.load_bounds
    far = math.ceil(2 * math.hypot(right - left, high - low) / spacing)
    index = np.arange(-far, far + 1)
    i, j = (along.ravel() for along in np.meshgrid(index, index))
    first = spacing * np.array([math.cos(_TURN), math.sin(_TURN)])
    second = spacing * np.array([math.cos(_TURN + math.pi / 3), math.sin(_TURN + math.pi / 3)])
    points = (i + _ORIGIN[0])[:, None] * first + (j + _ORIGIN[1])[:, None] * second
    x, y = points.T
    points = points[(left <= x) & (x <= right) & (low <= y) & (y <= high)]
    points.setflags(write=False)
    return points


def share(pad: Pad, points_per_taxel: int) -> float:
    """Give the part of the pad's surface that each point of its lattice stands for, mm^2."""
    return pad.pitch_x * pad.pitch_y / points_per_taxel


@lru_cache(maxsize=4)
def _felt(pad: Pad, points_per_taxel: int, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Work out what each column (n, columns) and row (n, rows) feels of a unit force on each point."""
    wide = math.hypot(sigma, math.sqrt(_SECOND_MOMENT * share(pad, points_per_taxel)))
    x, y = lattice(pad, points_per_taxel).T
    return felt_along(x, pad.column_edges, wide), felt_along(y, pad.row_edges, wide)
