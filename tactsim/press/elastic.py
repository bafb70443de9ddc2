"""Press a rigid face on an elastic solid, whose every point gives way under a force at any other.

The solid is a half-space, or a layer bonded to a rigid base; contact is without friction. A pressure
p(k) with wave number k moves its surface by u(k) = 2 / E* L(k h) / k p(k), E* = E / (1 - nu^2), with L = 1
for the half-space and, for a layer of thickness h (K. L. Johnson, Contact Mechanics, 1985, section 5.8;
derived anew in tests/press/test_elastic.py),

    L(x) = (K sinh 2x - 2x) / (K cosh 2x + 2x^2 + (1 + K^2) / 2),  K = 3 - 4 nu.

L / k is written as a sum of Gaussians of k, so the surface moves by a sum of Gaussians of x times Gaussians
of y. Their means over two rectangles have closed forms, and so has the influence of a cell on another.

The pressure is even within each covered part of a cell. The mean movement under each part equals the mean
depth of the face there, or is more where the pressure is 0: a linear complementarity problem, solved by
Cholesky factors of the parts that carry (block pivoting). The face rests where it balances the force, and,
where the wrist gives way, the hinges about the pad's middle. Tilts count to first order.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv
from scipy.special import erf

from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed, lay_bed, levels
from tactsim.press.scan_options import PressOptions, ScanOptions
from tactsim.press.spread import Patches, cell_lines
from tactsim.press.touches import MOST_TILT, TIPPED, Pressed, Touches

_RATIO = 2**0.4  # between the widths of two Gaussians: their sum is then exact to 3e-5
_NARROWEST = 0.05  # times a cell's width, or half a layer's thickness; narrower ones act on their point alone
_WIDEST = 100.0  # times the pad's size, under a half-space
_DEVIATES = 8.0  # a layer is a half-space to Gaussians below its thickness over this
_REACHES = 12.0  # and moves no farther off than some thicknesses
_MOST_INFLUENCES = 30_000_000  # 240 MB
_TOUCHING = 1e-9  # share of the depth by which a face may enter the solid where it does not press
_BLOCK_STEPS = 8  # without progress, after which parts change one at a time


class Gaussians(NamedTuple):
    """L(k h) / k as point + sum weight * exp(-(k width)^2 / 2): widths and weights (n,) mm, point mm."""

    widths: FloatArray
    weights: FloatArray
    point: float


@dataclass(frozen=True, eq=False)
class Rested:
    """Presses on an elastic solid.

    pressure: (contacts,) N/mm^2, even within each contact's part, 0 in a blank. depth: (presses,) mm that the
    face sinks in at the pad's middle, 0 where nothing touches. tilt: (presses, 2) rad, where the wrist comes to
    rest. blanks: {press: why it does not come to rest}.
    """

    pressure: FloatArray
    depth: FloatArray
    tilt: FloatArray
    blanks: dict[int, str]


@dataclass(frozen=True, eq=False)
class _Influence:
    """How far the cells of a pad give way under a force on any of them, for E* = 1 N/mm^2.

    of_classes: 1/mm, by the classes of two columns and of two rows. of_columns, of_rows: (columns, columns) and
    (rows, rows), the class of each two. width, height: mm of the columns and rows.
    """

    gaussians: Gaussians
    of_classes: FloatArray
    of_columns: NDArray[np.intp]
    of_rows: NDArray[np.intp]
    width: FloatArray
    height: FloatArray

    def between(self, cell: NDArray[np.intp]) -> FloatArray:
        """Give the mean movement of cells (n,) under a force of 1 N on each of them, (n, n)."""
        row, column = np.divmod(cell, len(self.width))
        classes = self.of_columns[column[:, None], column] * self.of_classes.shape[1]
        classes += self.of_rows[row[:, None], row]
        return self.of_classes.ravel()[classes]

    def under_itself(self, bed: Bed) -> FloatArray:
        """Give the mean movement of each contact's part under a force of 1 N spread over that part, (contacts,).

        A part counts as the rectangle of its area and of its second moments' ratio: exact for every
        rectangle along the grid.
        """
        row, column = np.divmod(bed.cell, len(self.width))
        size = np.stack([self.width[column], self.height[row]])
        result = self.of_classes[np.diag(self.of_columns)[column], np.diag(self.of_rows)[row]]
        partial = np.flatnonzero((bed.area > 0) & (bed.area < (1 - 1e-9) * size.prod(axis=0)))
        area, first = bed.area[partial], bed.moments[1:3, partial]
        spread = bed.moments[[3, 5]][:, partial] / area - (first / area) ** 2
        spread = np.sqrt(np.maximum(spread, 1e-12 * size[:, partial] ** 2))
        size = spread * np.sqrt(area / spread.prod(axis=0))
        means = [mean_of_gaussians(0.0, side, side, self.gaussians.widths) for side in size]
        alone = 2 * (self.gaussians.weights @ (means[0] * means[1]) + self.gaussians.point / area)
        result[partial] = np.maximum(alone, result[partial])
        return result


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter on the elastic solid of `options.press` until it rests.

    A press that tips over is a blank, with its reason. Raises what `press_elastic` does.
    """
    x_lines, y_lines = options.cell_lines
    face = levels(touches.letter, options.press)
    tilts = touches.tilts if touches.tilts.any() else None
    bed = lay_bed(face, touches.poses, x_lines, y_lines, tilts=tilts)
    rested = press_elastic(bed, touches.tilts, options, touches.forces(options.press.force))
    touching = int(np.count_nonzero(bed.area_of_presses))
    cells = (len(x_lines) - 1) * (len(y_lines) - 1) * len(face)
    work = Counter(
        presses=touching, no_contact=len(touches) - touching, cells=touching * cells - len(bed.area)
    )
    return Pressed(touches, Patches(bed, rested.pressure), work, rested.blanks)


def press_elastic(
    bed: Bed, tilts: FloatArray, options: ScanOptions, force: FloatArray | None = None
) -> Rested:
    """Press a face on the solid of `options.press` until it rests.

    bed: all parts of the face over the pad, each at its gap, laid on `cell_lines`. tilts: (presses, 2) rad
    about the pad's x and y, before the wrist gives way. force: (presses,) N; None: that of the options.
    A press that tips over is a blank.
    Raises InputError if the pad's cells are of too many different sizes.
    """
    press = options.press
    thickness = press.thickness if press.foundation == "layer" else None
    influence = _influence(
        options.pad, press.cells_per_taxel, options.sensor.psf_sigma, thickness, press.poisson
    )
    alone = influence.under_itself(bed)
    pressure, depth = np.zeros(len(bed.area)), np.zeros(len(tilts))
    tilt, blanks = np.array(tilts, dtype=float), {}
    force = np.full(len(tilts), press.force) if force is None else force
    for index, (first, last) in enumerate(pairwise(bed.start.tolist())):
        rows = np.arange(first, last)[bed.area[first:last] > 0]
        if not len(rows):
            continue
        area = bed.area[rows]
        moves = influence.between(bed.cell[rows])
        np.fill_diagonal(moves, alone[rows])
        moves /= modulus(press, float(area.sum()), float(force[index]))
        centroid = bed.centroid[rows]
        # How depths answer to the face's place: at the pad's middle (mm), and to the tilts about x and y.
        ways = np.column_stack([np.ones(len(rows)), centroid[:, 1], -centroid[:, 0]])
        forces, place = _rest(
            moves, ways, bed.gap[rows], tilt[index], float(force[index]), press.wrist_stiffness
        )
        depth[index], tilt[index] = place[0], place[1:]
        if np.abs(place[1:]).max() > MOST_TILT:
            blanks[index] = TIPPED
        else:
            pressure[rows] = forces / area
    return Rested(pressure, depth, tilt, blanks)


def modulus(press: PressOptions, area: float, force: float | None = None) -> float:
    """Give E / (1 - nu^2) of the solid under a contact of `area` mm^2 that carries `force` N, N/mm^2.

    The material is that of a layer of `thickness` which, under a wide flat contact, has `stiffness`: there
    the layer cannot give way sideways, so stiffness * thickness is its modulus of uniaxial strain, E (1 - nu) /
    ((1 + nu) (1 - 2 nu)). The half-space is of the same material.
    """
    uniaxial = 1e-3 * press.stiffness_over(area, force) * press.thickness
    return uniaxial * (1 - 2 * press.poisson) / (1 - press.poisson) ** 2


def multiplier(x: FloatArray, poisson: float) -> FloatArray:
    """Give L of the module's docstring at x = wave number times thickness, above 0."""
    k = 3 - 4 * poisson
    x = np.minimum(x, 50.0)  # L is 1 there
    return (k * np.sinh(2 * x) - 2 * x) / (k * np.cosh(2 * x) + 2 * x**2 + (1 + k**2) / 2)


def gaussians_of(thickness: float | None, poisson: float, cell: float, pad: float) -> Gaussians:
    """Write L(k h) / k as a sum of Gaussians of k.

    thickness: mm of a layer, None for the half-space. cell: mm, the smallest side of a cell. pad: mm, the
    largest distance on it.

    1 / k is the integral of sqrt(2 / pi) exp(-(k s)^2 / 2) ds over all s > 0, and the trapezoid rule in log s
    gives it. Of a layer, the weights of the wide Gaussians are fitted instead (least squares, relative).
    """
    low, high = _NARROWEST * cell, _WIDEST * pad
    if thickness is not None:
        low, high = min(low, _NARROWEST * thickness / 2), _REACHES * thickness
    widths = low * _RATIO ** np.arange(np.ceil(np.log(high / low) / np.log(_RATIO)) + 1)
    weights = np.sqrt(2 / np.pi) * np.log(_RATIO) * widths
    point = float(weights[0] / (_RATIO - 1))  # the rest of the geometric series
    if thickness is not None:
        wide = widths > 0.99 * thickness / _DEVIATES
        k = np.geomspace(1e-3, 60, 1200) / thickness
        wanted = multiplier(k * thickness, poisson) / k
        terms = weights * np.exp(-((k[:, None] * widths) ** 2) / 2)
        rest = wanted - point - terms[:, ~wide].sum(axis=1)
        factor, *_ = np.linalg.lstsq(terms[:, wide] / wanted[:, None], rest / wanted, rcond=1e-12)
        weights[wide] *= factor
    return Gaussians(widths, weights, point)


def mean_of_gaussians(
    distance: FloatArray | float, a: FloatArray, b: FloatArray, widths: FloatArray
) -> FloatArray:
    """Average normal densities of the distance of two points over two stretches of a line, (widths, ...) 1/mm.

    distance: mm between the stretches' middles. a, b: mm, their lengths. widths: mm, standard deviations.
    """
    s = widths.reshape(-1, *(1,) * np.ndim(a))

    def twice_integrated(x: FloatArray) -> FloatArray:
        result: FloatArray = x * erf(x / (s * np.sqrt(2))) / 2
        return result + s / np.sqrt(2 * np.pi) * np.exp(-((x / s) ** 2) / 2)

    apart, within = (a + b) / 2, (a - b) / 2
    total = twice_integrated(distance + apart) - twice_integrated(distance + within)
    total += twice_integrated(distance - apart) - twice_integrated(distance - within)
    return total / (a * b)


@lru_cache(maxsize=4)
def _influence(
    pad: Pad, cells_per_taxel: int, sigma: float, thickness: float | None, poisson: float
) -> _Influence:
    """Work out the influence of all cells of a pad on each other. Raises InputError for too many."""
    x_lines, y_lines = cell_lines(pad, cells_per_taxel, sigma)
    width, height = np.diff(x_lines), np.diff(y_lines)
    size = float(np.hypot(x_lines[-1] - x_lines[0], y_lines[-1] - y_lines[0]))
    gaussians = gaussians_of(thickness, poisson, float(min(width.min(), height.min())), size)
    of_columns, columns = _classes(x_lines)
    of_rows, rows = _classes(y_lines)
    if len(columns) * len(rows) > _MOST_INFLUENCES:
        raise InputError(
            f"the pad's cells are of {len(columns) * len(rows):,} different distances and sizes, more than "
            f"{_MOST_INFLUENCES:,}; choose press.foundation = winkler or a sensor.psf_sigma nearer to the pitch"
        )
    means = [mean_of_gaussians(d, a, b, gaussians.widths) for d, a, b in (columns.T, rows.T)]
    of_classes = 2 * (gaussians.weights * means[0].T) @ means[1]
    itself = np.ix_(np.unique(np.diag(of_columns)), np.unique(np.diag(of_rows)))
    of_classes[itself] += (
        2 * gaussians.point / np.outer(columns[itself[0].ravel(), 1], rows[itself[1].ravel(), 1])
    )
    return _Influence(gaussians, of_classes, of_columns, of_rows, width, height)


def _classes(lines: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Class every two stretches between lines by their distance and lengths, mm: (n, n) and (classes, 3)."""
    middle, length = (lines[1:] + lines[:-1]) / 2, np.diff(lines)
    one, other = np.minimum(length[:, None], length), np.maximum(length[:, None], length)
    pairs = np.stack([np.abs(middle[:, None] - middle), one, other], axis=-1).reshape(-1, 3)
    classes, which = np.unique(np.round(pairs, 9), axis=0, return_inverse=True)
    return which.reshape(len(length), -1), classes


def _rest(
    moves: FloatArray, ways: FloatArray, gap: FloatArray, tilt: FloatArray, force: float, wrist: float | None
) -> tuple[FloatArray, FloatArray]:
    """Find the forces (n,) N and the place (3,) [mm, rad, rad] of a face at rest.

    moves: (n, n) mm/N. ways: (n, 3), by which depths answer to the place. gap: (n,) mm. tilt: (2,) rad
    before the wrist gives way. force: N. wrist: N mm/rad, None if it is rigid.
    """
    count = len(gap)
    carries = np.ones(count, dtype=bool)
    fewest, patience = count + 1, _BLOCK_STEPS
    while True:
        sides = np.column_stack([ways, gap])[carries]
        _, answer, info = dposv(moves[np.ix_(carries, carries)], sides)
        if info:
            raise np.linalg.LinAlgError("the influence of a solid's points on each other is not positive")
        balance = sides.T @ answer
        place = np.array([0.0, *tilt])
        if wrist is None:
            place[0] = (force + balance[3, 0] - balance[0, 1:3] @ tilt) / balance[0, 0]
        else:
            hinges = np.array([0.0, wrist, wrist])
            place = np.linalg.solve(
                balance[:3, :3] + np.diag(hinges), hinges * place + (force, 0, 0) + balance[:3, 3]
            )
        forces = np.zeros(count)
        forces[carries] = answer[:, :3] @ place - answer[:, 3]
        wrong = np.flatnonzero(forces < 0)
        idle = np.flatnonzero(~carries)
        if len(idle):
            depth = ways @ place - gap
            enters = depth[idle] - moves[idle] @ forces > _TOUCHING * np.abs(depth).max()
            wrong = np.concatenate([wrong, idle[enters]])
        if not len(wrong):
            return forces, place
        # All at a time where that lessens what is wrong; else the last one alone (Murty's rule), which ends.
        if len(wrong) < fewest:
            fewest, patience = len(wrong), _BLOCK_STEPS
        else:
            patience -= 1
        flipped = wrong if patience > 0 else wrong.max()
        carries[flipped] = ~carries[flipped]
