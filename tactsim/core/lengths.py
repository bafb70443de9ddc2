"""The lengths of a pad, which what is stated in mm for the default pad follows: its pitch and its size."""

from __future__ import annotations

import math

import numpy as np

from tactsim.core.poses import FloatArray

OFFSET = 10.0  # mm: an object is hidden with x and y of T_R^O in [-OFFSET, OFFSET] (paper, section IV)
_SIZE = math.sqrt(11.7 * 11.4)  # mm, of the paper's pad by `size`
_ALIKE = (
    0.03  # pads whose sizes differ by less are taken as equal: of one, a row may be masked or a seam narrower
)


def pitch(taxel_xy: FloatArray) -> float:
    """Give the distance between neighbouring taxels at taxel_xy (taxels, 2) mm: the median to the nearest one.

    A single taxel has none: 0.
    """
    if len(taxel_xy) < 2:
        return 0.0
    nearest = np.full(len(taxel_xy), np.inf)
    for taxel, place in enumerate(taxel_xy):
        away = np.hypot(*(taxel_xy - place).T)
        away[taxel] = np.inf
        nearest[taxel] = away.min()
    return float(np.median(nearest))


def size(taxel_xy: FloatArray) -> float:
    """Give the side, mm, of a square as large as the rectangle that taxels at (taxels, 2) mm cover; 0 for one taxel."""
    width, height = np.ptp(taxel_xy, axis=0) + pitch(taxel_xy)
    return math.sqrt(width * height)


def relative_size(taxel_xy: FloatArray) -> float:
    """Give the size of a pad with taxels at (taxels, 2) mm beside that of the paper's pad; 1 for a single taxel."""
    ratio = size(taxel_xy) / _SIZE
    return 1.0 if ratio == 0 or abs(ratio - 1) < _ALIKE else ratio


def offsets(taxel_xy: FloatArray) -> float:
    """Give the range of an object's place, mm: x and y of T_R^O are in plus and minus this, for a pad of any size.

    It is the paper's 10 mm for the paper's pad, and grows with the pad.
    """
    return OFFSET * relative_size(taxel_xy)
