"""Find the rotational symmetry of a footprint from its shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from manifold3d import CrossSection

TOLERANCE = 0.05  # mm: an outline that moves by less counts as unchanged; a taxel measures 1.8 mm
LARGEST_ORDER = 64  # the turn of a higher order moves an outline hardly more than the tolerance
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)


def rotational_order(contours: Sequence[FloatArray], tolerance: float = TOLERANCE) -> int | float:
    """Find the largest n up to LARGEST_ORDER for which turns by 2 pi / n leave the region as it is.

    contours: (k, 2) mm each; the turns are about the origin, the centre of area. The region counts as unchanged when no
    point of it or of its turned copy lies further than `tolerance` (mm) outside the other. Returns math.inf
    when every contour is a circle round the origin within the tolerance: a fine regular polygon is one.
    """
    from manifold3d import CrossSection

    if all(_is_circle(contour, tolerance) for contour in contours):
        return math.inf
    region = CrossSection(list(contours))
    grown = region.offset(tolerance)
    order = 1
    for prime in PRIMES:
        while order * prime <= LARGEST_ORDER and _unchanged(region, grown, order * prime):
            order *= prime
    return order


def _is_circle(contour: FloatArray, tolerance: float) -> bool:
    """Tell whether a closed polygon stays between two circles about the origin, `tolerance` mm apart."""
    along = np.roll(contour, -1, axis=0) - contour
    place = np.clip(-np.sum(contour * along, axis=1) / np.sum(along**2, axis=1), 0, 1)
    nearest = np.hypot(*(contour + place[:, None] * along).T)
    return bool(np.hypot(*contour.T).max() - nearest.min() <= tolerance)


def _unchanged(region: CrossSection, grown: CrossSection, order: int) -> bool:
    """Tell whether every turn by a multiple of 2 pi / order keeps the region inside its grown self."""
    # A turn by +angle tests whether the copy sticks out of the region; a turn by -angle tests the reverse.
    # All multiples are tried, because one small turn moves no point far.
    turns = (sign * 360 * k / order for k in range(1, order // 2 + 1) for sign in (1, -1))
    return all((region.rotate(degrees) - grown).is_empty() for degrees in turns)
