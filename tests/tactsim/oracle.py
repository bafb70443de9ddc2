"""What a press should read, worked out another way: the reference of the accuracy tests.

Clips the footprint with the whole pad by manifold3d, takes F / area as the pressure, and integrates each
element's response over the clipped region along its boundary with 40-point Gauss quadrature. It shares
no code with the press: no cells, no moments, no MuJoCo.
"""

from itertools import pairwise

import numpy as np
from manifold3d import CrossSection
from scipy.special import erf

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(40)


def overlap(footprint, pose, pad):
    """Clip the footprint with the pad's surface in the sensor frame: a CrossSection, mm."""
    left, right, low, high = pad.load_bounds
    surface = CrossSection.square((right - left, high - low)).translate((left, low))
    return footprint.translate((-pose[0], -pose[1])).rotate(-np.degrees(pose[2])) ^ surface


def expected_reading(footprint, pose, pad, force, sigma):
    """Return the exact reading (taxels,) kPa of a uniform pressure, and the contact area in mm^2."""
    region = overlap(footprint, pose, pad)
    area = region.area()
    reading = np.zeros((pad.rows, pad.columns))
    if area < 1e-9:
        return reading.ravel(), area
    for contour in region.to_polygons():
        for start, end in zip(contour, np.roll(contour, -1, axis=0), strict=True):
            pieces = max(1, int(np.hypot(*(end - start)) / 2))
            cuts = start + (end - start) * (np.arange(pieces + 1) / pieces)[:, None]
            for a, b in pairwise(cuts):
                x, y = (a + (b - a) * ((_POINTS + 1) / 2)[:, None]).T
                # Green's theorem: the integral of f(x) g(y) is that of F(x) g(y) dy round the boundary.
                columns = np.array([_integral(x, *edge, sigma) for edge in pad.column_edges])
                rows = np.array([_response(y, *edge, sigma) for edge in pad.row_edges])
                reading += np.einsum("rp,cp,p->rc", rows, columns, _WEIGHTS / 2) * (b[1] - a[1])
    element = pad.element_x * pad.element_y
    return reading.ravel() * (1e3 * force / area / element), area


def _cdf(z):
    return (1 + erf(z / np.sqrt(2))) / 2


def _response(x, low, high, sigma):
    return _cdf((high - x) / sigma) - _cdf((low - x) / sigma)


def _integral(x, low, high, sigma):
    """Integrate `_response` from minus infinity to x."""

    def part(edge):
        z = (edge - x) / sigma
        return -sigma * (z * _cdf(z) + np.exp(-z * z / 2) / np.sqrt(2 * np.pi))

    return part(high) - part(low) + (high - low)
