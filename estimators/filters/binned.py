"""The log-belief of all bins of a grid, kept up to date with a field; planes that cannot matter wait (compiled).

A plane is all bins of one letter and one angle: their x and y differ by whole bins. So a taxel sees, from bin to bin,
nodes of its table that follow each other, and a sum over taxels is one of shifted slices. A plane's upper bound is its
highest log-belief so far, and what the readings that it waited for may give at most. While the bound is below what
matters, its bins wait. A bin's terms are added in the same order and precision whenever it is evaluated, so what is not
left alone is the same to the bit as without waiting (branch and bound: Land and Doig 1960; for matching scans to maps
Olson 2009).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float32, int64, uint64
from numpy.typing import NDArray

from tactsim.core.compiling import Floats2D, Ints1D, Ints2D, Reals1D, Reals2D, Reals4D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.field.kernels import FAR, LANES, Lattice, Terms
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.states import Weights, pose_samples

# Nats; bins that are as near to the last one that matters matter too.
_ROUNDING = 1e-6
# One in so many planes, those with the highest bounds, is looked at before the others.
_FIRST = 10


class Belief(NamedTuple):
    """The log-belief of all bins, some of which wait.

    log_p: (letters, angles, rows, columns) after the first `seen` readings. peak: (letters, angles) the highest of a
    plane. seen: (letters, angles).
    """

    log_p: Reals4D
    peak: Reals2D
    seen: Ints2D


@compiled(called_from_python=False)
def replace_least(kept: Reals1D, value: float) -> None:
    """Put a value in the place of the least of `kept` if it is higher.

    kept: (n,) the highest so far, a heap: [i] is not above [2 i + 1] and [2 i + 2].
    """
    if value <= kept[0]:
        return
    place = 0
    while True:
        below = 2 * place + 1
        if below + 1 < len(kept) and kept[below + 1] < kept[below]:
            below += 1
        if below >= len(kept) or value <= kept[below]:
            break
        kept[place] = kept[below]
        place = below
    kept[place] = value


@compiled(called_from_python=False)
def sum_plane(
    total: Floats2D, lattice: Lattice, terms: Terms, reading: int, letter: int, cos: float, sin: float
) -> None:
    """Sum the terms of a reading for the bins of one letter and angle, less what a bin far off the map gets.

    It is for readings of one load. Fills total (rows, columns), columns rounded up to a multiple of LANES; what lies
    beyond is any number.
    """
    _, letters, phases_y, phases_x, rows, columns = lattice.shape
    nodes, place, width = lattice.nodes, lattice.place, columns + LANES
    plane, total_columns, sums = rows * width, total.shape[1], total.reshape(total.size)
    sums[:] = 0
    for i in range(terms.start[reading], terms.start[reading + 1]):
        x = (cos * terms.xy[i, 0] - sin * terms.xy[i, 1] + place[0]) / place[2]
        y = (sin * terms.xy[i, 0] + cos * terms.xy[i, 1] + place[1]) / place[3]
        if not (abs(x) < FAR and abs(y) < FAR):
            continue
        # The node before the first bin's taxel: `left` whole bins, and so many nodes of those between two bins.
        left, below = int64(math.floor(x)), int64(math.floor(y))
        x, y = (x - left) * phases_x, (y - below) * phases_y
        step_x, step_y = min(int64(x), phases_x - 1), min(int64(y), phases_y - 1)
        right, above, weight = x - step_x, y - step_y, terms.weight[i] * lattice.unit
        # The next node is in the next plane of nodes, or in the next column or row of the first.
        over_x, over_y = step_x + 1 == phases_x, step_y + 1 == phases_y
        to_right = 1 - step_x * plane if over_x else plane
        to_above = width - step_y * phases_x * plane if over_y else phases_x * plane
        share_1, share_2 = float32(weight * (1 - above) * (1 - right)), float32(weight * (1 - above) * right)
        share_3, share_4 = float32(weight * above * (1 - right)), float32(weight * above * right)
        first = (terms.kind[i] * letters + letter) * phases_y * phases_x * plane
        first += (step_y * phases_x + step_x) * plane + LANES
        # Beyond its rows and columns a table is 0, and so is its rim.
        begin, end = max(0, -below), min(len(total), rows - below - over_y)
        for column in range(0, total_columns, LANES):
            if not -LANES < left + column < columns:
                continue
            for row in range(begin, end):
                node = first + (row + below) * width + left + column
                node_1, node_2 = uint64(node), uint64(node + to_right)
                node_3, node_4 = uint64(node + to_above), uint64(node + to_right + to_above)
                bin_1 = uint64(row * total_columns + column)
                for lane in range(uint64(LANES)):
                    sums[bin_1 + lane] += (
                        share_1 * float32(nodes[node_1 + lane])
                        + share_2 * float32(nodes[node_2 + lane])
                        + share_3 * float32(nodes[node_3 + lane])
                        + share_4 * float32(nodes[node_4 + lane])
                    )


@compiled()
def advance(
    belief: Belief, lattice: Lattice, terms: Terms, turns: Reals2D, count: int, skip: bool, keep: int, within: float
) -> tuple[int, float, float]:  # fmt: skip
    """Bring the bins up to date that can matter after `count` readings (eq. 13, in logs).

    What matters is all bins at most `within` nats below the best, and in any case the best `keep` and one more. turns:
    (angles, 2) cos and sin. skip: whether planes may wait. Returns how many times a plane took in a reading, the
    highest log-belief, and from which log-belief on bins matter.
    """
    letters, angles, rows, columns = belief.log_p.shape
    total = np.empty((rows, -(-columns // LANES) * LANES), dtype=np.float32)
    gain, kept = terms.upper[count] - terms.upper[: count + 1], np.full(keep + 1, -np.inf)
    evaluated, best, least = 0, -np.inf, -np.inf
    bound = np.empty(letters * angles)
    for plane in range(len(bound)):
        letter, angle = divmod(plane, angles)
        bound[plane] = belief.peak[letter, angle] + gain[belief.seen[letter, angle]]
    # The most promising first: the sooner it is known from where on bins matter, the fewer planes do. The others letter
    # by letter, so that its tables are in the cache.
    order = np.argsort(-bound)
    order[1 + len(order) // _FIRST :].sort()
    for plane in order:
        letter, angle = divmod(plane, angles)
        log_p = belief.log_p[letter, angle]
        while belief.seen[letter, angle] < count:
            reading = belief.seen[letter, angle]
            if skip and belief.peak[letter, angle] + gain[reading] < least:
                break
            sum_plane(total, lattice, terms, reading, letter, turns[angle, 0], turns[angle, 1])
            constant, peak = terms.constant[reading, letter], -np.inf
            for row in range(rows):
                for column in range(columns):
                    log_p[row, column] += constant + total[row, column]
                    peak = max(peak, log_p[row, column])
            belief.peak[letter, angle], belief.seen[letter, angle] = peak, reading + 1
            evaluated += 1
        if belief.seen[letter, angle] == count and belief.peak[letter, angle] > kept[0]:
            best = max(best, belief.peak[letter, angle])
            for row in range(rows):
                for column in range(columns):
                    replace_least(kept, log_p[row, column])
            least = min(best - within, kept[0]) - _ROUNDING
    return evaluated, best, least


@compiled()
def summarise(belief: Belief, count: int, best: float, least: float, mass: Reals1D, mode: Ints1D) -> None:
    """Sum the belief of each letter (eq. 14) and find its best bin (eq. 15), after `count` readings.

    Bins below `least` are left out. Fills mass (letters,), relative to a bin with log-belief `best`, and mode
    (letters,), flat index into its (angles, rows, columns), or -1.
    """
    letters, angles, rows, columns = belief.log_p.shape
    for letter in range(letters):
        mass[letter], mode[letter], highest = 0.0, -1, -np.inf
        for angle in range(angles):
            if belief.seen[letter, angle] != count or belief.peak[letter, angle] < least:
                continue
            for row in range(rows):
                for column in range(columns):
                    value = belief.log_p[letter, angle, row, column]
                    if value >= least:
                        mass[letter] += math.exp(value - best)
                        if value > highest:
                            highest, mode[letter] = value, (angle * rows + row) * columns + column


@compiled()
def bins_from(belief: Belief, count: int, least: float, first: int, last: int) -> tuple[Ints1D, Reals1D]:
    """List the bins of letters first, ..., last - 1, up to date after `count` readings, from log-belief `least` on.

    Returns flat indices into (letters, angles, rows, columns), ascending, and log-beliefs.
    """
    _, angles, rows, columns = belief.log_p.shape
    number = 0
    for fill in range(2):  # first they are counted
        flat, log_p = np.empty(number, dtype=np.int64), np.empty(number)
        number = 0
        for letter in range(first, last):
            for angle in range(angles):
                if belief.seen[letter, angle] != count or belief.peak[letter, angle] < least:
                    continue
                for row in range(rows):
                    for column in range(columns):
                        value = belief.log_p[letter, angle, row, column]
                        if value >= least:
                            if fill:
                                flat[number] = ((letter * angles + angle) * rows + row) * columns + column
                                log_p[number] = value
                            number += 1
    return flat, log_p


class BinnedBelief:
    """log p(letter, bin | readings) of all bins, not normalised (paper, eq. 13).

    With `skip`, planes of bins that cannot matter wait. Without, every bin is up to date after every reading.
    """

    def __init__(self, field: TableField, grid: StateGrid, *, skip: bool = False) -> None:
        self._field, self._grid, self._skip = field, grid, skip
        x, y, angle = grid.centres
        self._lattice = field.lattice(np.array([x[0], y[0]]), np.array(grid.spacing[:2]))
        self._turns = np.column_stack([np.cos(angle), np.sin(angle)])
        planes = len(field.labels), grid.angle
        self._belief = Belief(
            log_p=np.empty((*planes, grid.y, grid.x)),
            peak=np.empty(planes),
            seen=np.empty(planes, dtype=np.int64),
        )
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        self._taken_in = 0  # readings, with the last update
        self._belief.log_p[:] = 0
        self._belief.peak[:] = 0
        self._belief.seen[:] = 0
        self._best, self._least = 0.0, -math.inf

    def update(self, within: float, keep: int = 0) -> tuple[int, int]:
        """Multiply the belief by the likelihood of the field's new readings (eq. 13), in logs.

        Up to date are then all bins at most `within` nats below the best, and in any case the best `keep` and one
        more. Returns how many times a bin took in a reading, and how many times it need not.
        """
        count = len(self._field)
        planes, self._best, self._least = advance(
            self._belief, self._lattice, self._field.terms, self._turns, count, self._skip, keep, within
        )
        bins, every = planes * self._grid.x * self._grid.y, len(self._field.labels) * self._grid.bins
        new, self._taken_in = count - self._taken_in, count
        return bins, new * every - bins

    def summary(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """Sum the bins of each letter (eq. 14), relative to the best bin, and find its mode (eq. 15): (letters,) each.

        A mode is a flat index into (angles, rows, columns).
        """
        letters = len(self._field.labels)
        mass, mode = np.empty(letters), np.empty(letters, dtype=np.int64)
        summarise(self._belief, self._taken_in, self._best, self._least, mass, mode)
        return mass, mode

    def samples(self, letter: int, within: float) -> PoseSamples:
        """Give the bins of a letter that are less than `within` nats below the best bin."""
        flat, log_p = bins_from(self._belief, self._taken_in, self._best - within, letter, letter + 1)
        size = np.repeat(np.array(self._grid.spacing)[:, None], len(flat), axis=1)
        return pose_samples(self._grid.states(flat), Weights(log_p), size)

    @property
    def listed(self) -> tuple[NDArray[np.int64], FloatArray]:
        """List the bins that `update` was asked for: flat indices into (letters, angles, y, x), and log-beliefs."""
        return bins_from(self._belief, self._taken_in, self._least, 0, len(self._field.labels))

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns); of those left alone -inf."""
        current = self._belief.seen == self._taken_in
        return np.where(current[:, :, None, None], self._belief.log_p, -np.inf)
