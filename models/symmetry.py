"""Find the rotational symmetry of a footprint from its shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from manifold3d import CrossSection

FloatArray = NDArray[np.float64]

TOLERANCE = 0.05  # mm: an outline that moves by less is where it was; a sensor element has 1.8 mm
_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47)


def rotational_order(contours: Sequence[FloatArray], tolerance: float = TOLERANCE) -> int | float:
    """Find the largest n for which a turn by 2 pi / n about the origin leaves the region as it is.

    contours: (k, 2) mm each, the origin at the centre of area. The region counts as unchanged when no
    point of it or of its turned copy lies further than `tolerance` (mm) outside the other. Returns math.inf
    when every contour is a circle round the origin within the tolerance: a fine regular polygon is one.
    """
    from manifold3d import CrossSection

    if all(_is_circle(contour, tolerance) for contour in contours):
        return math.inf
    region = CrossSection(list(contours))
    grown = region.offset(tolerance)
    order = 1
    for prime in _PRIMES:
        while _unchanged(region, grown, order * prime):
            order *= prime
    return order


def _is_circle(contour: FloatArray, tolerance: float) -> bool:
    """Tell whether a closed polygon stays between two circles about the origin, `tolerance` mm apart."""
    along = np.roll(contour, -1, axis=0) - contour
    place = np.clip(-np.sum(contour * along, axis=1) / np.sum(along**2, axis=1), 0, 1)
    nearest = np.hypot(*(contour + place[:, None] * along).T)
    return bool(np.hypot(*contour.T).max() - nearest.min() <= tolerance)


def _unchanged(region: CrossSection, grown: CrossSection, order: int) -> bool:
    degrees = 360 / order
    # The second difference, turned back, is what of the region lies outside the grown turned copy.
    return bool((region.rotate(degrees) - grown).is_empty() and (region.rotate(-degrees) - grown).is_empty())
