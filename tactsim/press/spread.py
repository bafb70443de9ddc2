"""Spread contact pressure over the taxels by the Gaussian point spread function of the pad's cover.

The cover spreads the pressure of a contact (paper, section II, and its reference [19]); a taxel reads
the mean of the spread pressure over its area. The Gaussian and a taxel's area are each a function of x
times one of y, so the pressure is spread along x and then along y, and the work grows with taxels plus cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed, slopes

if TYPE_CHECKING:
    from tactsim.press.scan_options import ScanOptions

_erf = np.vectorize(math.erf, otypes=[float])  # a few thousand values: not worth the import of SciPy

_KPA = 1e3  # kPa in a N/mm^2
_WIDEST = 1.25  # times sigma: a wider cell is cut where a taxel's edge is felt
_FELT = 6.0  # times sigma: an edge farther away is not felt, by 1e-9
# Cells of all presses at a time. So few stay in the cache, and BLAS does not start threads, which would cost more
# than they save.
_BLOCK = 8192
# Points per axis and cell for the projection below; exact to 1e-12 for cells up to 3 sigma wide.
_QUADRATURE = 8


@lru_cache(maxsize=8)
def cell_lines(pad: Pad, cells_per_taxel: int, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Divide the surface that carries load into cells: returns their edges along x and along y, mm.

    sigma: mm, of the point spread. Without one the edges of taxels are lines too (`Pad.grid_lines`). With
    one, a cell wider than 1.25 sigma is cut into equal parts of at most sigma; of those lines only the ones
    within 6 sigma of a taxel's edge are kept, since elsewhere a taxel feels all of a force or none.
    They are kept, and not to be changed: a press asks for them at every step towards its balance.
    """
    x_lines, y_lines = pad.grid_lines(cells_per_taxel, gap_cells=sigma == 0)
    if sigma:
        x_lines, y_lines = (
            _cut_wide(x_lines, pad.column_edges, sigma),
            _cut_wide(y_lines, pad.row_edges, sigma),
        )
    return x_lines, y_lines


def _cut_wide(lines: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    widths = np.diff(lines)
    parts = np.where(widths > _WIDEST * sigma, np.ceil(widths / sigma), 1).astype(int)
    cell = np.repeat(np.arange(len(widths)), parts)
    order = np.arange(len(cell)) - np.repeat(np.cumsum(parts) - parts, parts)
    cuts = lines[cell] + widths[cell] * (order / parts[cell])
    every = np.sort(edges, axis=None)
    after = np.searchsorted(every, cuts).clip(1, len(every) - 1)
    near = np.minimum(np.abs(cuts - every[after - 1]), np.abs(cuts - every[after])) < _FELT * sigma
    return np.append(cuts[near | (order == 0)], lines[-1])


@dataclass(frozen=True, eq=False)
class Patches:
    """Pressure on the covered parts of the pad's cells.

    bed: the parts. pressure: (contacts,) N/mm^2 at the centres of their cells. gradient: (contacts, 2)
    N/mm^3 along the pad's x and y, None where the pressure is even within a cell.
    """

    bed: Bed
    pressure: FloatArray
    gradient: FloatArray | None = None

    @classmethod
    def under(
        cls, bed: Bed, depth: FloatArray, tilt: FloatArray, force: FloatArray, *, even: bool = False
    ) -> Patches:
        """Share the force of each press among the parts, in proportion to the depth over them (springs).

        bed: what touches. depth: (presses,) mm at the pad's middle. tilt: (presses, 2) rad. force: (presses,) N.
        even: whether the face is level, so that the pressure is even within a cell.
        """
        slope = slopes(tilt)[bed.press]
        at_centre = depth[bed.press] - bed.gap + np.einsum("ci,ci->c", slope, bed.centre)
        volume = np.bincount(
            bed.press,
            at_centre * bed.area + np.einsum("ci,ic->c", slope, bed.moments[1:3]),
            len(bed.start) - 1,
        )
        stiffness = force[bed.press] / volume[bed.press]  # N/mm^3, just so that all of the force is carried
        return cls(bed, stiffness * at_centre, None if even else stiffness[:, None] * slope)

    @property
    def forces(self) -> FloatArray:
        """Integrate over each part: (contacts,) N."""
        forces = self.pressure * self.bed.area
        if self.gradient is not None:
            forces += np.einsum("ci,ic->c", self.gradient, self.bed.moments[1:3])
        return forces

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections."""
        press, sigma = options.press, options.sensor.psf_sigma
        return contact_map(self.bed, self.pressure, self.gradient, options.pad, press.cells_per_taxel, sigma)


class _Felt(NamedTuple):
    """What the taxels feel of each column and row of cells, `_along` x and y, and the cells' half widths, mm.

    x: (columns of taxels, 3 columns of cells), the degrees one after another. y: (3, rows of cells, rows of taxels).
    """

    x: FloatArray
    y: FloatArray
    half_x: FloatArray
    half_y: FloatArray


def contact_map(
    bed: Bed, pressure: FloatArray, gradient: FloatArray | None, pad: Pad, cells_per_taxel: int, sigma: float
) -> FloatArray:
    """Average the spread contact pressure over each taxel: (presses, taxels) kPa, no imperfections.

    bed: laid on `cell_lines`. pressure: (contacts,) N/mm^2 at the centres of the contacts' cells.
    gradient: (contacts, 2) N/mm^3 along x and y, or None where the pressure is even over each covered part.
    sigma: mm, standard deviation of the point spread.

    A taxel's response to a unit force is a smooth function of where in the cell the force is; its best
    quadratic there (least squares) replaces it. The integral over the covered part then needs only the
    part's moments. For a cell that is covered wholly by an even pressure the result is exact.
    """
    felt = _felt_by_cells(pad, cells_per_taxel, sigma)
    columns, rows, presses = len(felt.half_x), len(felt.half_y), len(bed.start) - 1
    y, x = np.divmod(bed.cell, columns)
    loads = _loads(bed.moments, pressure, gradient, felt.half_x[x], felt.half_y[y])
    block = max(1, _BLOCK // (columns * rows))
    result = np.empty((presses, pad.rows, pad.columns))
    for first in range(0, presses, block):
        count = min(block, presses - first)
        these = slice(bed.start[first], bed.start[first + count])
        if not len(x[these]):
            result[first : first + count] = 0
            continue
        left, low = x[these].min(), y[these].min()
        across, up = x[these].max() + 1 - left, y[these].max() + 1 - low
        # Columns of cells first, then presses, then rows: both products below then are of plain matrices.
        where = ((x[these] - left) * count + bed.press[these] - first) * up + (y[these] - low)
        bins = across * count * up
        spread = np.zeros((pad.columns * count, pad.rows))
        for degree_y, degrees_x in enumerate((slice(0, 3), slice(3, 5), slice(5, 6))):
            load = np.concatenate([np.bincount(where, value[these], bins) for value in loads[degrees_x]])
            felt_x = felt.x[:, : 3 - degree_y, left : left + across].reshape(pad.columns, -1)
            along_x = felt_x @ load.reshape(-1, count * up)
            spread += along_x.reshape(-1, up) @ felt.y[degree_y, low : low + up]
        result[first : first + count] = spread.reshape(pad.columns, count, pad.rows).transpose(1, 2, 0)
    # Where a response is almost 0, its quadratic is a little below.
    return _KPA * np.maximum(result.reshape(presses, pad.taxels), 0)


def _loads(
    moments: FloatArray,
    pressure: FloatArray,
    gradient: FloatArray | None,
    half_x: FloatArray,
    half_y: FloatArray,
) -> list[FloatArray]:
    """Integrate pressure times P_i(u) P_j(v) over covered parts, for ij = 00, 10, 20, 01, 11, 02: (contacts,) N each.

    P_i is Legendre's polynomial of degree i over the cell, whose half widths are given, mm.
    """
    one, u, v, uu, uv, vv = moments[:6] * pressure
    if gradient is not None:
        of_u, of_v = gradient.T
        _, m_u, m_v, m_uu, m_uv, m_vv, m_uuu, m_uuv, m_uvv, m_vvv = moments
        one += of_u * m_u + of_v * m_v
        u += of_u * m_uu + of_v * m_uv
        v += of_u * m_uv + of_v * m_vv
        uu += of_u * m_uuu + of_v * m_uuv
        uv += of_u * m_uuv + of_v * m_uvv
        vv += of_u * m_uvv + of_v * m_vvv
    return [
        one,
        u / half_x,
        1.5 * uu / half_x**2 - 0.5 * one,
        v / half_y,
        uv / (half_x * half_y),
        1.5 * vv / half_y**2 - 0.5 * one,
    ]


@lru_cache(maxsize=4)
def _felt_by_cells(pad: Pad, cells_per_taxel: int, sigma: float) -> _Felt:
    x_lines, y_lines = cell_lines(pad, cells_per_taxel, sigma)
    x, y = _along(x_lines, pad.column_edges, sigma), _along(y_lines, pad.row_edges, sigma)
    return _Felt(x.transpose(2, 0, 1).copy(), y, np.diff(x_lines) / 2, np.diff(y_lines) / 2)


def _along(lines: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    """Project a taxel's response on Legendre polynomials over each cell, along one axis.

    Returns (degree 0..2, cells, taxels): the polynomials' coefficients, 1/mm.
    """
    points, weights = np.polynomial.legendre.leggauss(_QUADRATURE)
    half = np.diff(lines)[:, None] / 2
    at = (lines[:-1, None] + half) + half * points  # (cells, points)
    felt = felt_along(at, edges, sigma) / (edges[:, 1] - edges[:, 0])  # (cells, points, taxels)
    values = np.polynomial.legendre.legvander(points, 2) * (weights[:, None] * (np.arange(3) + 0.5))
    return np.einsum("pd,cpe->dce", values, felt)


def felt_along(x: FloatArray, edges: FloatArray, sigma: float) -> FloatArray:
    """Work out the share of a unit line force at x that falls on each taxel along one axis: (..., taxels).

    x: (...) mm. edges: (taxels, 2) mm, where each taxel begins and ends. sigma: mm, of the Gaussian that
    spreads the force; 0 for none.
    """
    if sigma == 0:
        return ((x[..., None] > edges[:, 0]) & (x[..., None] < edges[:, 1])).astype(float)
    felt: FloatArray = np.diff(_erf((edges - x[..., None, None]) / (sigma * np.sqrt(2))), axis=-1)[..., 0] / 2
    return felt
