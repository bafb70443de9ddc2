"""The best of a grid's bins after every reading, whichever letter's; bins that cannot be among them wait (compiled).

Each bin has an upper bound. A bin reads four neighbouring nodes of a table for each taxel and interpolates; the largest
of the four bounds that, in tables of their own, one byte a bound. All letters' bounds lie side by side, so that what a
term adds to the bins of one angle are whole rows. A bin that need not wait takes in the readings that it waited for by
itself, as a state anywhere does: what it gets is the same to the bit as without waiting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import boolean, float32, float64, int8, int32, int64, types, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import FLOATS, INTS, REALS, Floats, Ints, Reals, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.kernels import ROUNDING, SAMPLED, TERMS, Sampled, Terms, replay
from tactsim.estimators.filters.binned import Certificate, replace_least
from tactsim.estimators.filters.grid import StateGrid

# Nats; bins that are as near to the last one listed are listed too.
_ROUNDING = 1e-6
# The highest level of a bound.
_HIGHEST = 127
# So many of the bins with the highest bounds are evaluated first, then twice as many again and again.
_ROUND = 64
# Bins; a taxel that many bins from the first bin, or nowhere, is off the map, and its index might overflow.
_FAR = 1e9


class Levels(NamedTuple):
    """Upper bounds of tables, in steps of `step` nats, less the value far away.

    level: (tables, phases_y, phases_x, rows, columns * letters) int8, of the largest of the four nodes around a place;
    beyond a table it is 0. letters: how many there are. place: [x, y] of bin (0, 0) less that of node (0, 0), then the
    bins' spacing in x and y, mm.
    """

    level: NDArray[np.int8]
    step: float
    letters: int
    place: Reals


LEVELS = types.NamedTuple((int8[:, :, :, :, ::1], float64, int64, REALS), Levels)


class Coarse(NamedTuple):
    """The log-belief of all bins, (angles, rows, columns, letters) flat, some of which wait.

    upper: not below what a bin's log-belief is after all readings. highest: (angles * rows,) no bin of the row has a
    higher bound. log_p: a bin's log-belief after the first `seen` readings. counts: letters, angles, rows, columns.
    middle: x of all columns, y of all rows, then all angles, mm, mm, rad.
    """

    upper: Reals
    highest: Reals
    log_p: Reals
    seen: NDArray[np.int32]
    counts: Ints
    middle: Reals


COARSE = types.NamedTuple((REALS, REALS, REALS, int32[::1], INTS, REALS), Coarse)


class Wanted(NamedTuple):
    """Which bins are asked for: all at most `within` nats below the best, and in any case the best `keep` and one more.

    skip: whether the others may wait.
    """

    keep: int
    within: float
    skip: bool


WANTED = types.NamedTuple((int64, float64, boolean), Wanted)


def levels_of(field: LikelihoodField, first: FloatArray, spacing: FloatArray) -> Levels:
    """Bound a field's tables for a grid of bins.

    first: [x, y] mm of the first bin's middle. spacing: of the bins in x and y, mm, as the field was made for.
    """
    tables, (phases_y, phases_x) = field.tables, field.tables.phases
    kinds, letters, rows, columns = tables.nodes.shape
    step = max(1, -(-int(np.abs(tables.nodes.astype(np.int32)).max()) // _HIGHEST))
    level = np.zeros(
        (kinds, phases_y, phases_x, rows // phases_y + 1, (columns // phases_x + 1) * letters), np.int8
    )
    for kind in range(kinds):  # one by one: the tables may be many
        # A place before the first node lies between it and the node before, which is 0.
        nodes = np.pad(tables.nodes[kind], ((0, 0), (phases_y, 1), (phases_x, 1)))
        nodes = np.maximum(nodes[:, :-1], nodes[:, 1:])
        nodes = np.maximum(nodes[:, :, :-1], nodes[:, :, 1:])
        split = (-(-nodes // step)).reshape(
            letters, rows // phases_y + 1, phases_y, columns // phases_x + 1, phases_x
        )
        level[kind] = split.transpose(2, 4, 1, 3, 0).reshape(level.shape[1:])
    # The lattice of levels begins one bin before that of the nodes.
    place = np.concatenate([first - tables.origin + spacing, spacing])
    return Levels(level, tables.unit * step, letters, place)


@compiled(float64(LEVELS, TERMS, int64, int64, int64), called_from_python=False)
def place_rounding(levels: Levels, terms: Terms, reading: int, rows: int, columns: int) -> float:
    """Bound by how many nodes along an axis `replay`, in float32, may misplace what one of rows x columns bins reads.

    A place is a sum of a bin's place among the nodes and of two products with the taxel's. It rounds five times at
    most, by half of ROUNDING each. A taxel further off than any bin is from any node reads the rim, wherever exactly it
    lies.
    """
    _, phases_y, phases_x, node_rows, node_columns = levels.level.shape
    place, farthest = levels.place, 0.0
    # mm from any bin to any node along an axis, and between nodes.
    wide = abs(place[0]) + place[2] * (columns + node_columns // levels.letters)
    tall = abs(place[1]) + place[3] * (rows + node_rows)
    across, up = place[2] / phases_x, place[3] / phases_y
    for i in range(terms.start[reading * terms.loads], terms.start[(reading + 1) * terms.loads]):
        farthest = max(farthest, abs(terms.xy[i, 0]) + abs(terms.xy[i, 1]))
    most = max(wide / across, tall / up) + min(farthest, wide + tall) / min(across, up)
    return 2.5 * ROUNDING * most


@compiled(void(COARSE, int64, REALS), ordered=False, called_from_python=False)
def add_rows(coarse: Coarse, angle: int, most: Reals) -> None:
    """Add to the bounds of an angle's bins what a reading gives them at most, (rows * columns * letters,)."""
    letters, _, rows, columns = coarse.counts
    width = columns * letters
    for row in range(rows):
        begin, highest = (angle * rows + row) * width, -np.inf
        upper, added = coarse.upper[begin : begin + width], most[row * width : (row + 1) * width]
        for k in range(width):
            upper[k] += added[k]
            highest = max(highest, upper[k])
        coarse.highest[angle * rows + row] = highest


@compiled(void(REALS, FLOATS, REALS), ordered=False, called_from_python=False)
def raise_to(most: Reals, total: Floats, constant: Reals) -> None:
    """Raise what a reading gives bins (n,) to total (n,) and, in each row, constant (columns * letters,)."""
    width = len(constant)
    for first in range(0, len(most), width):
        for k in range(width):
            most[first + k] = max(most[first + k], total[first + k] + constant[k])


@compiled(void(COARSE, LEVELS, TERMS, int64), called_from_python=False)
def raise_bounds(coarse: Coarse, levels: Levels, terms: Terms, reading: int) -> None:
    """Let the upper bounds of all bins take in a reading. Of several loads the likeliest bounds their mean."""
    letters, angles, rows, columns = coarse.counts
    _, phases_y, phases_x, node_rows, width = levels.level.shape
    flat, plane = levels.level.reshape(levels.level.size), node_rows * width
    node_columns, place, xy, loads = width // letters, levels.place, terms.xy, terms.loads
    start = terms.start[reading * loads : (reading + 1) * loads + 1]
    total = np.empty(rows * columns * letters, dtype=np.float32)
    most, constant = np.empty(len(total)), np.empty((loads, columns * letters))
    moved = place_rounding(levels, terms, reading, rows, columns)
    for load in range(loads):
        heaviest = terms.weight[start[load] : start[load + 1]].sum()
        # What float32 may lose of the sums of levels, and by how much it may move what a table says, where it moves a
        # place along both axes.
        span = heaviest * levels.step * (_HIGHEST + 1)
        slack = terms.slack[reading] + span * ROUNDING * (start[load + 1] - start[load] + 6)
        slack += 4 * moved * span
        for k in range(columns * letters):
            # The constants hold the log of a load's share of the mean.
            constant[load, k] = terms.constant[reading * loads + load, k % letters] + math.log(loads) + slack
    for angle in range(angles):
        turn = coarse.middle[columns + rows + angle]
        cos, sin = math.cos(turn), math.sin(turn)
        most[:] = -np.inf
        for load in range(loads):
            total[:] = 0
            for i in range(start[load], start[load + 1]):
                x = (cos * xy[i, 0] - sin * xy[i, 1] + place[0]) / place[2]
                y = (sin * xy[i, 0] + cos * xy[i, 1] + place[1]) / place[3]
                if not (abs(x) < _FAR and abs(y) < _FAR):
                    continue
                left, below = int64(math.floor(x)), int64(math.floor(y))
                step_x, step_y = (
                    min(int64((x - left) * phases_x), phases_x - 1),
                    min(int64((y - below) * phases_y), phases_y - 1),
                )
                # The bins whose place is on the lattice, from and to; beyond it a table is 0.
                begin, end = max(0, -left) * letters, min(columns, node_columns - left) * letters
                corner = ((terms.kind[i] * phases_y + step_y) * phases_x + step_x) * plane + left * letters
                factor = float32(terms.weight[i] * levels.step)
                for row in range(max(0, -below), min(rows, node_rows - below)):
                    source = uint64(corner + (row + below) * width + begin)
                    target = uint64(row * columns * letters + begin)
                    for k in range(uint64(max(0, end - begin))):
                        total[target + k] += factor * float32(flat[source + k])
            raise_to(most, total, constant[load])
        add_rows(coarse, angle, most)


@compiled(INTS(COARSE, float64, int64, boolean), called_from_python=False)
def bins_above(coarse: Coarse, least: float, count: int, current: bool) -> Ints:
    """List the bins whose bound is at least `least`, ascending: those that are up to date, or the others."""
    width, number = len(coarse.upper) // len(coarse.highest), 0
    for fill in range(2):  # first they are counted
        place, number = np.empty(number, dtype=np.int64), 0
        for row in range(len(coarse.highest)):
            if coarse.highest[row] >= least:
                for k in range(row * width, (row + 1) * width):
                    if coarse.upper[k] >= least and (coarse.seen[k] == count) == current:
                        if fill:
                            place[number] = k
                        number += 1
    return place


@compiled(float64(COARSE, float64, int64), called_from_python=False)
def bound_of_waiting(coarse: Coarse, least: float, count: int) -> float:
    """Bound what bins have that wait, all of which are below `least`."""
    width, waits = len(coarse.upper) // len(coarse.highest), -np.inf
    for row in range(len(coarse.highest)):
        if coarse.highest[row] < least:
            waits = max(waits, coarse.highest[row])
        else:
            for k in range(row * width, (row + 1) * width):
                if coarse.seen[k] < count:
                    waits = max(waits, coarse.upper[k])
    return waits


@compiled(int64(COARSE, INTS, TERMS, SAMPLED, int64, REALS), called_from_python=False)
def evaluate_bins(
    coarse: Coarse, place: Ints, terms: Terms, sampled: Sampled, count: int, kept: Reals
) -> int:
    """Let bins take in all of `count` readings; their bounds are then what they have.

    place: (n,) flat indices. kept: the highest log-beliefs so far, as `replace_least` takes them. Returns how many
    times a bin took in a reading.
    """
    letters, _, rows, columns = coarse.counts
    evaluated = 0
    # Those of which many have waited for the same readings are evaluated together.
    order = place[np.argsort(coarse.seen[place], kind="mergesort")]
    begin = 0
    while begin < len(order):
        first, end = coarse.seen[order[begin]], begin
        while end < len(order) and coarse.seen[order[end]] == first:
            end += 1
        some = order[begin:end]
        state, letter, log_p = (
            np.empty((3, len(some))),
            np.empty(len(some), dtype=np.int64),
            coarse.log_p[some],
        )
        for k in range(len(some)):
            rest, letter[k] = divmod(some[k], letters)
            rest, column = divmod(rest, columns)
            angle, row = divmod(rest, rows)
            state[0, k], state[1, k] = coarse.middle[column], coarse.middle[columns + row]
            state[2, k] = coarse.middle[columns + rows + angle]
        replay(log_p, state, letter, terms, first, count, sampled)
        for k in range(len(some)):
            coarse.log_p[some[k]] = coarse.upper[some[k]] = log_p[k]
            coarse.seen[some[k]] = count
            replace_least(kept, log_p[k])
        evaluated += len(some) * (count - first)
        begin = end
    return evaluated


@compiled(
    types.Tuple((INTS, REALS, float64, int64, INTS))(COARSE, LEVELS, TERMS, SAMPLED, INTS, WANTED, INTS)
)
def best_bins(
    coarse: Coarse,
    levels: Levels,
    terms: Terms,
    sampled: Sampled,
    readings: Ints,
    wanted: Wanted,
    likely: Ints,
) -> tuple[Ints, Reals, float, int, Ints]:
    """Take in readings number readings[0] + 1, ..., readings[1], and list the bins that are wanted, ascending.

    likely: of bins that are evaluated first; any will do. Bins are told by their flat indices in `Coarse`. Returns
    places and log-beliefs, a bound of all bins that wait, how many times a bin took in a reading, and the places of the
    best `keep` and one more, which are likely to be among the best after the next reading; none if too many are equal.
    """
    count, kept = readings[1], np.full(wanted.keep + 1, -np.inf)
    best, evaluated, least = -np.inf, 0, -np.inf
    if not wanted.skip:
        coarse.highest[:] = np.inf
        likely = np.arange(len(coarse.upper))
    else:
        for reading in range(readings[0], count):
            raise_bounds(coarse, levels, terms, reading)
    place, together = likely, max(_ROUND, wanted.keep + 1)
    while True:
        if len(place) > 0:
            evaluated += evaluate_bins(coarse, place, terms, sampled, count, kept)
            best = max(best, coarse.log_p[place].max())
            least = min(best - wanted.within, kept[0]) - _ROUNDING
        place = bins_above(coarse, least, count, False)
        if len(place) == 0:
            break
        if len(place) > together:
            # Among the bins that may matter, first those with the highest bounds.
            bounds = coarse.upper[place]
            place = place[bounds >= np.partition(bounds, len(bounds) - together)[len(bounds) - together]]
            together *= 2
    waits = bound_of_waiting(coarse, least, count)
    place = bins_above(coarse, least, count, True)
    log_p = coarse.log_p[place]
    likely = place[log_p >= kept[0]]
    if len(likely) > 2 * len(kept):
        likely = likely[:0]
    return place, log_p, waits, evaluated, likely


class CoarseBins:
    """log p(letter, bin | readings) of the bins that may be among the best (paper, eq. 13), not normalised.

    With `skip` the others wait: their upper bounds take in every reading, they themselves only when a bound comes
    within what is asked for. What is listed is the same.
    """

    def __init__(self, field: LikelihoodField, grid: StateGrid, *, skip: bool) -> None:
        self._field, self._grid, self._skip = field, grid, skip
        x, y, angle = grid.centres
        self._levels = levels_of(field, np.array([x[0], y[0]]), np.array(grid.spacing[:2]))
        bins = len(field.labels) * grid.bins
        self._coarse = Coarse(
            upper=np.empty(bins),
            highest=np.empty(grid.angle * grid.y),
            log_p=np.empty(bins),
            seen=np.empty(bins, dtype=np.int32),
            counts=np.array([len(field.labels), grid.angle, grid.y, grid.x]),
            middle=np.concatenate([x, y, angle]),
        )
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        for array in self._coarse[:4]:
            array[:] = 0
        self._taken_in, self._waits, self._likely = 0, -math.inf, np.zeros(0, dtype=np.int64)
        self.listed = np.zeros(1, dtype=np.int64), np.zeros(1)

    def update(self, within: float, keep: int) -> tuple[int, int]:
        """Multiply the belief by the likelihood of the field's new readings (eq. 13), in logs.

        `listed` are then all bins at most `within` nats below the best, and in any case the best `keep` and one more:
        flat indices into (letters, angles, rows, columns), and log-beliefs. Returns how many times a bin took in a
        reading, and how many times it need not.
        """
        field, grid, readings = self._field, self._grid, np.array([self._taken_in, len(self._field)])
        wanted = Wanted(keep, within, self._skip)
        place, log_p, self._waits, evaluated, self._likely = best_bins(
            self._coarse, self._levels, field.terms, field.tables.sampled, readings, wanted, self._likely
        )
        cell, letter = np.divmod(place, len(field.labels))
        self.listed = letter * grid.bins + cell, log_p
        new, self._taken_in = len(field) - self._taken_in, len(field)
        return evaluated, new * len(field.labels) * grid.bins - evaluated

    def upper_bounds(self) -> FloatArray:
        """Give a bound that each bin is not above: (letters, angles, rows, columns)."""
        grid = self._grid
        return self._coarse.upper.reshape(grid.angle, grid.y, grid.x, -1).transpose(3, 0, 1, 2)

    def certificate(self) -> Certificate:
        """Give the best bin, and how far below it the bins that were left alone are at least."""
        flat, log_p = self.listed
        best = flat[log_p.argmax()]
        label = self._field.labels[int(best // self._grid.bins)]
        return Certificate(label, self._grid.states(best[None])[:, 0], float(log_p.max()) - self._waits)
