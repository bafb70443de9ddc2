"""Spread contact forces over the taxels by the Gaussian point spread function of the pad's cover.

The cover spreads the pressure of a contact (paper, section II, and its reference [19]); a taxel reads
the mean of the spread pressure over its area.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed
from tactsim.press.clip import EVEN_MOMENTS, POWERS

_erf = np.vectorize(math.erf, otypes=[float])  # a few thousand values: not worth the import of SciPy

_KPA = 1e3  # kPa in a N/mm^2
# Presses at a time: so few that BLAS does not start threads, which would cost more than they save.
_BLOCK = 32
_QUADRATURE = 8  # points per axis and cell for the projection below; exact to 1e-12 for sigma >= 0.3 mm


def contact_map(
    bed: Bed,
    pressure: FloatArray,
    gradient: FloatArray | None,
    pad: Pad,
    cells_per_taxel: int,
    sigma: float,
) -> FloatArray:
    """Average the spread contact pressure over each taxel: (presses, taxels) kPa, no imperfections.

    pressure: (contacts,) N/mm^2 at the centres of the contacts' cells. gradient: (contacts, 2) N/mm^3, by
    which it varies within a cell, or None where it does not; it needs the bed's third moments.
    sigma: mm, standard deviation of the point spread.

    A contact's force lies on the covered part of its cell. A taxel's response to a unit force is
    a smooth function of where in the cell the force is; its best quadratic there (least squares)
    replaces it. The integral over the covered part then needs only the part's moments. For a cell that
    is covered wholly the result is exact.
    """
    x_lines, y_lines = pad.grid_lines(cells_per_taxel, gap_cells=sigma == 0)
    cells = (len(x_lines) - 1) * (len(y_lines) - 1)
    presses = len(bed.start) - 1
    where = bed.press * cells + bed.cell
    responses = _responses(pad, cells_per_taxel, sigma)
    result = np.zeros((presses, pad.taxels))
    for (i, j), moment, response in zip(POWERS, bed.moments, responses, strict=False):
        force = moment * pressure
        if gradient is not None:
            force += bed.moments[POWERS.index((i + 1, j))] * gradient[:, 0]
            force += bed.moments[POWERS.index((i, j + 1))] * gradient[:, 1]
        load = np.bincount(where, force, presses * cells).reshape(presses, cells)
        for first in range(0, presses, _BLOCK):
            block = slice(first, first + _BLOCK)
            result[block] += load[block] @ response
    return _KPA * np.maximum(result, 0)  # where a response is almost 0, its quadratic is a little below


@lru_cache(maxsize=4)
def _responses(pad: Pad, cells_per_taxel: int, sigma: float) -> FloatArray:
    """Map the moments of every cell to every taxel: (6, cells, taxels), per mm^2 of taxel.

    The Gaussian and a taxel's area are products of a function of x and one of y, so each axis is
    projected by itself.
    """
    x_lines, y_lines = pad.grid_lines(cells_per_taxel, gap_cells=sigma == 0)
    x, y = _along(x_lines, pad.column_edges, sigma), _along(y_lines, pad.row_edges, sigma)
    # Legendre's second polynomial has a constant part, so a power's coefficient comes from the projections on
    # several polynomials.
    powers = POWERS[:EVEN_MOMENTS]
    response = np.zeros((len(powers), len(y), len(x), len(pad.row_edges), len(pad.column_edges)))
    for k, (i, j) in enumerate(powers):
        for p, q in powers:
            response[k] += np.einsum("ar,bc->abrc", y[:, j, q], x[:, i, p])
    return response.reshape(len(powers), -1, pad.taxels)


def _along(lines: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    """Project a taxel's response on Legendre polynomials of each cell, along one axis.

    Returns (cells, power 0..2, degree 0..2, taxels): the coefficient of u^power, u in mm from the
    cell's centre, in the part of the given degree; 1/mm.
    """
    points, weights = np.polynomial.legendre.leggauss(_QUADRATURE)
    half = np.diff(lines)[:, None] / 2
    at = (lines[:-1, None] + half) + half * points  # (cells, points)
    felt = felt_along(at[..., None], edges, sigma) / (edges[:, 1] - edges[:, 0])  # (cells, points, taxels)
    result = np.zeros((len(half), 3, 3, len(edges)))
    for degree, polynomial in enumerate(([1.0], [0.0, 1.0], [-0.5, 0.0, 1.5])):
        values = sum(factor * points**power for power, factor in enumerate(polynomial))
        projection = np.einsum("p,cpe->ce", weights * values, felt) * (2 * degree + 1) / 2
        for power, factor in enumerate(polynomial):
            result[:, power, degree] = projection * factor / half**power
    return result


def felt_along(x: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    """Work out the share of a unit line force at x that falls on each taxel along one axis: (..., taxels).

    x: (...) mm. edges: (taxels, 2) mm, where each taxel begins and ends. sigma: mm, of the Gaussian that
    spreads the force; 0 for none.
    """
    if sigma == 0:
        return ((x > edges[:, 0]) & (x < edges[:, 1])).astype(float)
    z = (edges - x[..., None]) / (sigma * np.sqrt(2))
    return np.diff(_erf(z), axis=-1)[..., 0] / 2
