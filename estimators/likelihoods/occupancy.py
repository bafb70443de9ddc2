"""Occupancy maps of objects, learned from classified readings at known poses (paper, section II)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError, Scan, transform
from tactsim.core.compiling import Reals2D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify, threshold_of
from tactsim.estimators.options import MapOptions

_NOTHING = 1e-12  # a taxel is left out of cells whose log-odds it would change by less than this
_MOST_CELLS = 50_000_000  # of all maps together: 400 MB
# Where both ratios times G' are at most this, the logarithm is summed as a series of so many terms, to 1e-17.
_SMALL, _TERMS = 0.01, 7


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """Log-odds of occupancy on a square grid in the object frame (paper, eq. 1).

    origin: [x, y] mm of the centre of cell [0, 0]. cell: mm. log_odds: (rows, columns), rows along
    +y. prior: p(m), which holds outside the grid. Raises ValueError if a cell is not finite.
    """

    origin: FloatArray
    cell: float
    log_odds: FloatArray
    prior: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.log_odds).all():
            raise ValueError("an occupancy map holds a log-odds value that is not finite")

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Give the outer edges of the cells: left, right, bottom, top in mm."""
        rows, columns = self.log_odds.shape
        left, bottom = self.origin - self.cell / 2
        return left, left + columns * self.cell, bottom, bottom + rows * self.cell

    def probability(self) -> FloatArray:
        """Give p(occupied) of every cell."""
        return sigmoid(self.log_odds)

    def log_odds_at(self, xy: ArrayLike) -> FloatArray:
        """Interpolate the log-odds bilinearly at points (..., 2) mm; outside is the prior.

        The paper's occ of section III-A: the grid is queried for log-odds, not for probabilities.
        """
        rows, columns = self.log_odds.shape
        place = (np.asarray(xy, dtype=float) - self.origin) / self.cell
        # A frame of prior cells around the grid lets every point be interpolated alike.
        framed = np.full((rows + 2, columns + 2), log_odds(self.prior))
        framed[1:-1, 1:-1] = self.log_odds
        column = np.clip(place[..., 0] + 1, 0, columns + 1)
        row = np.clip(place[..., 1] + 1, 0, rows + 1)
        left = np.minimum(column.astype(np.intp), columns)
        below = np.minimum(row.astype(np.intp), rows)
        right_share, above_share = column - left, row - below
        return (1 - above_share) * (
            (1 - right_share) * framed[below, left] + right_share * framed[below, left + 1]
        ) + above_share * (
            (1 - right_share) * framed[below + 1, left] + right_share * framed[below + 1, left + 1]
        )


def maps_of(estimator: object) -> Mapping[str, OccupancyMap]:
    """Give the maps that an estimator has learned, its attribute `maps`; none if it has no such maps."""
    maps = getattr(estimator, "maps", None)
    known = isinstance(maps, Mapping) and all(isinstance(chart, OccupancyMap) for chart in maps.values())
    return maps if known and maps is not None else {}


def learn_maps(
    scan: Scan,
    *,
    sigma: float = 1.0,
    peak: float = 0.9,
    prior: float = 0.2,
    threshold: float | Literal["auto"] = 2.0,
    ratio: float = 0.3,
    cell: float = 0.4,
) -> Mapping[str, OccupancyMap]:
    """Learn one occupancy map for every letter of a scan's training readings (paper, eq. 2 to 6).

    sigma: mm, the sensor's point spread. peak: G' at a taxel's centre. prior: p(m). threshold,
    ratio: eq. 3. cell: mm. All maps share one grid, which covers everything any taxel has
    touched upon. Raises InputError if the scan has no training readings, or poses so far apart that
    the maps would have more than 50 million cells.
    """
    train = scan.where(split="train")
    if len(train) == 0:
        raise InputError("the scan has no readings with split 'train' to learn maps from")
    centres = transform(train.poses, train.taxel_xy)
    reach = _reach(sigma, prior)
    low = np.floor((centres.min(axis=(0, 1)) - reach) / cell)
    high = np.ceil((centres.max(axis=(0, 1)) + reach) / cell)
    spans = high - low + 1
    if spans.prod() * len(train.letters) > _MOST_CELLS:
        raise InputError(
            f"the training poses span {spans[0] * cell:.3g} x {spans[1] * cell:.3g} mm: maps of {len(train.letters)} "
            f"letters in cells of {cell} mm would have more than {_MOST_CELLS:,} cells; are the poses in mm?"
        )
    columns, rows = spans.astype(int)
    classes = classify(train.readings, threshold_of(threshold, train.readings), ratio)
    maps = {}
    for label in train.letters:
        mine = train.labels == label
        blank = OccupancyMap(low * cell, cell, np.full((rows, columns), log_odds(prior)), prior)
        evidence = log_odds_of(blank, centres[mine], classes[mine], sigma, peak)
        maps[label] = replace(blank, log_odds=blank.log_odds + evidence)
    return maps


def learn_maps_by(options: MapOptions, scan: Scan) -> Mapping[str, OccupancyMap]:
    """Learn maps as options say, by `learn_maps`, which says what it raises."""
    return learn_maps(
        scan, sigma=options.sigma, peak=options.peak, prior=options.prior, threshold=options.threshold,
        ratio=options.ratio, cell=options.cell,
    )  # fmt: skip


def log_odds_of(
    chart: OccupancyMap, xy: FloatArray, classes: NDArray[np.int8], sigma: float, peak: float
) -> FloatArray:
    """Sum the log-odds that taxels add to the cells of a map (eq. 4 to 6): (rows, columns).

    With p = p(m) that is log (p + (1-p) G') / (p (1-G')) in contact, and log (1-p) (1-G') / (1 - p + p G') without; an
    Unknown taxel leaves p(m), hence adds nothing. xy: (..., 2) mm. classes: (...). sigma, peak: as for `learn_maps`.
    """
    evidence, prior = np.zeros(chart.log_odds.shape), chart.prior
    low, reach = np.rint(chart.origin / chart.cell), _reach(sigma, prior)
    # Both are log (1 + above G') / (1 + below G').
    for kind, above, below in ((CONTACT, (1 - prior) / prior, -1.0), (NO_CONTACT, -1.0, prior / (1 - prior))):
        touched = xy[classes == kind] / chart.cell - low
        stamp(evidence, touched, sigma / chart.cell, peak, reach / chart.cell, above, below)
    return evidence


def _reach(sigma: float, prior: float) -> float:
    """Find how far from a taxel, in the unit of sigma, it still changes a cell: maps end there."""
    return sigma * math.sqrt(-math.log(_NOTHING * min(prior, 1 - prior)) / 2)


def point_spread(squared_distance: ArrayLike, sigma: float, peak: float) -> FloatArray:
    """Give G' of eq. 4, at squared distances (mm^2) from a taxel's centre."""
    return peak * np.exp(-2 / sigma**2 * np.asarray(squared_distance))


def log_odds(probability: float) -> float:
    """Turn a probability into log-odds (paper, eq. 1)."""
    return math.log(probability) - math.log1p(-probability)


def sigmoid(values: ArrayLike) -> FloatArray:
    """Turn log-odds into probabilities, without overflow at either end."""
    falling = np.exp(-np.abs(values))
    return np.where(np.asarray(values) >= 0, 1.0, falling) / (1 + falling)


@compiled()
def stamp(
    evidence: Reals2D, centres: Reals2D, sigma: float, peak: float, reach: float, above: float, below: float
) -> None:
    """Add log (1 + above G') / (1 + below G') of eq. 4 to the cells (rows, columns) around taxels.

    centres: (n, 2) [x, y] of the taxels. sigma: the point spread. All lengths are in cells. peak: G' at a taxel's
    centre. Cells farther than `reach` from a taxel are left out.
    """
    rows, columns = evidence.shape
    series = np.empty(_TERMS)
    for k in range(_TERMS):
        series[k] = (-1.0) ** k * (above ** (k + 1) - below ** (k + 1)) / (k + 1)
    small = _SMALL / max(abs(above), abs(below))
    along = np.empty(2 * math.ceil(reach) + 2)
    for i in range(len(centres)):
        x, y = centres[i]
        left, right = max(0, math.ceil(x - reach)), min(columns - 1, math.floor(x + reach))
        for column in range(left, right + 1):
            along[column - left] = math.exp(-2 * ((x - column) / sigma) ** 2)
        for row in range(max(0, math.ceil(y - reach)), min(rows - 1, math.floor(y + reach)) + 1):
            wide = math.sqrt(max(reach**2 - (y - row) ** 2, 0.0))
            across = peak * math.exp(-2 * ((y - row) / sigma) ** 2)
            for column in range(max(left, math.ceil(x - wide)), min(right, math.floor(x + wide)) + 1):
                g = across * along[column - left]
                if g > small:
                    evidence[row, column] += math.log((1 + above * g) / (1 + below * g))
                else:
                    added = 0.0
                    for k in range(_TERMS - 1, -1, -1):
                        added = g * (added + series[k])
                    evidence[row, column] += added
