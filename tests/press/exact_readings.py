"""Compute the exact reading of a press of a flat, level face, as a reference for the press.

manifold3d clips the footprint with the whole pad. The pressure is F / area. Gauss quadrature along the boundary
of the clipped region integrates each taxel's response. This file shares no code with the press: no cells, no
moments, no MuJoCo.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection
from numpy.typing import ArrayLike
from scipy.special import erf

from tactsim.core import Pad
from tactsim.core.poses import FloatArray

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_LONGEST = 1.0  # mm, of a piece of the boundary: with 12 points exact to 1e-12 for a spread of 0.5 mm


def overlap(footprint: CrossSection, pose: ArrayLike, pad: Pad) -> CrossSection:
    """Clip the footprint with the pad's surface in the sensor frame: a CrossSection, mm."""
    x, y, angle = np.asarray(pose, dtype=float)
    left, right, low, high = pad.load_bounds
    surface = CrossSection.square((right - left, high - low)).translate((left, low))
    return footprint.translate((-x, -y)).rotate(-np.degrees(angle)) ^ surface


def expected_reading(
    footprint: CrossSection, pose: ArrayLike, pad: Pad, force: float = 2.0, sigma: float = 1.0
) -> tuple[FloatArray, float]:
    """Return the exact reading (taxels,) kPa of a uniform pressure, and the contact area in mm^2."""
    region = overlap(footprint, pose, pad)
    area = region.area()
    if area < 1e-9:
        return np.zeros(pad.taxels), area
    taxel = pad.taxel_width * pad.taxel_height
    return integral(region, pad, sigma) * (1e3 * force / area / taxel), area


def integral(region: CrossSection, pad: Pad, sigma: float) -> FloatArray:
    """Integrate every taxel's response over a region: (taxels,) mm^2."""
    starts, ends = [], []
    for contour in region.to_polygons():
        for a, b in zip(contour, np.roll(contour, -1, axis=0), strict=True):
            cuts = np.linspace(a, b, int(np.hypot(*(b - a)) / _LONGEST) + 2)
            starts.append(cuts[:-1])
            ends.append(cuts[1:])
    start, step = np.concatenate(starts), np.concatenate(ends) - np.concatenate(starts)
    points = start[:, None] + step[:, None] * ((_POINTS + 1) / 2)[:, None]
    x, y = points[..., 0].ravel(), points[..., 1].ravel()
    weights = (step[:, 1:] * _WEIGHTS / 2).ravel()
    # Green's theorem: the integral of f(x) g(y) is that of F(x) g(y) dy round the boundary, F' = f.
    columns = _accumulated(x, pad.column_edges, sigma)
    rows = _response(y, pad.row_edges, sigma)
    return np.einsum("rp,cp,p->rc", rows, columns, weights).ravel()


def _response(x: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    z = (edges[..., None] - x) / sigma / np.sqrt(2)
    return (erf(z[:, 1]) - erf(z[:, 0])) / 2


def _accumulated(x: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    """Integrate `_response` from minus infinity to x."""
    z = (edges[..., None] - x) / sigma
    part = -sigma * (z * (1 + erf(z / np.sqrt(2))) / 2 + np.exp(-z * z / 2) / np.sqrt(2 * np.pi))
    return part[:, 1] - part[:, 0] + (edges[:, 1] - edges[:, 0])[:, None]
