"""The best of a grid's bins after every reading, whichever letter's; bins that cannot be among them wait.

Each bin has an upper bound. A bin reads four neighbouring nodes of a table for each taxel and interpolates; the largest
of the four bounds that, in tables of their own, one byte a bound. All letters' bounds lie side by side, so that what a
term adds to the bins of one angle are whole rows. A bin that need not wait takes in the readings that it waited for by
itself, as a state anywhere does: what it gets is the same to the bit as without waiting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float32, int64, uint64

from tactsim.core.compiling import Floats1D, Int8s5D, Int32s1D, Ints1D, Reals1D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.kernels import ROUNDING, Sampled, Terms, replay
from tactsim.estimators.field.table_field import TableField
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

    level: Int8s5D
    step: float
    letters: int
    place: Reals1D


class Coarse(NamedTuple):
    """The log-belief of all bins, (angles, rows, columns, letters) flat, some of which wait.

    upper: not below what a bin's log-belief is after all readings. log_p: a bin's log-belief after the first `seen`
    readings. counts: letters, angles, rows, columns. middle: x of all columns, y of all rows, then all angles, mm, mm,
    rad.
    """

    upper: Reals1D
    log_p: Reals1D
    seen: Int32s1D
    counts: Ints1D
    middle: Reals1D


def levels_of(field: TableField, first: FloatArray, spacing: FloatArray) -> Levels:
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


@compiled(called_from_python=False)
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


@compiled(ordered=False, called_from_python=False)
def raise_to(most: Reals1D, total: Floats1D, constant: Reals1D) -> None:
    """Raise what a reading gives bins (n,) to total (n,) and, in each row, constant (columns * letters,)."""
    width = len(constant)
    for first in range(0, len(most), width):
        for k in range(width):
            most[first + k] = max(most[first + k], total[first + k] + constant[k])


@compiled()
def raise_bounds(coarse: Coarse, levels: Levels, terms: Terms, reading: int) -> None:
    """Let the upper bounds of all bins take in a reading. Of several loads the likeliest bounds their mean."""
    letters, angles, rows, columns = coarse.counts
    _, phases_y, phases_x, node_rows, width = levels.level.shape
    flat, plane = levels.level.reshape(levels.level.size), node_rows * width
    table = phases_y * phases_x * plane
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
            term, last = start[load], start[load + 1]
            while term < last:
                # Terms of one taxel follow each other and are at one place: up to three are added in one go.
                i, term = term, term + 1
                while term < min(i + 3, last) and xy[term, 0] == xy[i, 0] and xy[term, 1] == xy[i, 1]:
                    term += 1
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
                corner = (step_y * phases_x + step_x) * plane + left * letters + below * width + begin
                # Of fewer than three terms the last is named again, and counts nothing.
                kind = terms.kind[i], terms.kind[min(i + 1, term - 1)], terms.kind[term - 1]
                one = float32(terms.weight[i] * levels.step)
                two = float32(terms.weight[i + 1] * levels.step if term > i + 1 else 0)
                three = float32(terms.weight[i + 2] * levels.step if term > i + 2 else 0)
                for row in range(max(0, -below), min(rows, node_rows - below)):
                    target = uint64(row * columns * letters + begin)
                    first = uint64(kind[0] * table + corner + row * width)
                    second = uint64(kind[1] * table + corner + row * width)
                    third = uint64(kind[2] * table + corner + row * width)
                    if term == i + 1:
                        for k in range(uint64(max(0, end - begin))):
                            total[target + k] += one * float32(flat[first + k])
                    else:
                        for k in range(uint64(max(0, end - begin))):
                            sums = total[target + k] + one * float32(flat[first + k])
                            sums += two * float32(flat[second + k])
                            total[target + k] = sums + three * float32(flat[third + k])
            raise_to(most, total, constant[load])
        upper = coarse.upper[angle * len(most) : (angle + 1) * len(most)]
        for k in range(len(most)):
            upper[k] += most[k]


@compiled()
def evaluate_bins(coarse: Coarse, place: Ints1D, terms: Terms, sampled: Sampled, count: int) -> int:
    """Let bins take in all of `count` readings; their bounds are then what they have.

    place: (n,) flat indices. Returns how many times a bin took in a reading.
    """
    letters, _, rows, columns = coarse.counts
    # Those that have waited longest come first: so those that take in a reading are the first ones, more and more.
    order = place[np.argsort(coarse.seen[place], kind="mergesort")]
    state, letter = np.empty((3, len(order))), np.empty(len(order), dtype=np.int64)
    for k in range(len(order)):
        rest, letter[k] = divmod(order[k], letters)
        rest, column = divmod(rest, columns)
        angle, row = divmod(rest, rows)
        state[0, k], state[1, k] = coarse.middle[column], coarse.middle[columns + row]
        state[2, k] = coarse.middle[columns + rows + angle]
    log_p, evaluated, end = coarse.log_p[order], 0, 0
    while end < len(order):
        first, last = coarse.seen[order[end]], count
        while end < len(order) and coarse.seen[order[end]] == first:
            end += 1
        if end < len(order):
            last = coarse.seen[order[end]]
        replay(log_p[:end].reshape(1, end), state[:, :end].copy(), letter[:end], terms, first, last, sampled)
        evaluated += end * (last - first)
    for k in range(len(order)):
        coarse.log_p[order[k]] = coarse.upper[order[k]] = log_p[k]
        coarse.seen[order[k]] = count
    return evaluated


class CoarseBins:
    """log p(letter, bin | readings) of the bins that may be among the best (paper, eq. 13), not normalised.

    With `skip` the others wait: their upper bounds take in every reading, they themselves only when a bound comes
    within what is asked for. What is listed is the same.
    """

    def __init__(self, field: TableField, grid: StateGrid, *, skip: bool) -> None:
        self._field, self._grid, self._skip = field, grid, skip
        x, y, angle = grid.centres
        self._levels = levels_of(field, np.array([x[0], y[0]]), np.array(grid.spacing[:2]))
        bins = len(field.labels) * grid.bins
        self._coarse = Coarse(
            upper=np.empty(bins),
            log_p=np.empty(bins),
            seen=np.empty(bins, dtype=np.int32),
            counts=np.array([len(field.labels), grid.angle, grid.y, grid.x]),
            middle=np.concatenate([x, y, angle]),
        )
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        for array in self._coarse[:3]:
            array[:] = 0
        self._taken_in, self._likely = 0, np.zeros(0, dtype=np.int64)
        self.listed = np.zeros(1, dtype=np.int64), np.zeros(1)

    def update(self, within: float, keep: int) -> tuple[int, int]:
        """Multiply the belief by the likelihood of the field's new readings (eq. 13), in logs.

        `listed` are then all bins at most `within` nats below the best, and in any case the best `keep` and one more:
        flat indices into (letters, angles, rows, columns), and log-beliefs. Returns how many times a bin took in a
        reading, and how many times it need not.
        """
        field, coarse, count = self._field, self._coarse, len(self._field)
        place = self._likely  # those that were best are probably among the best again
        if self._skip:
            for reading in range(self._taken_in, count):
                raise_bounds(coarse, self._levels, field.terms, reading)
        else:
            place = np.arange(len(coarse.upper))
        evaluated, together = 0, max(_ROUND, keep + 1)
        # The highest log-beliefs that are known; from `least` on bins are listed.
        kept, least = np.full(keep + 1, -np.inf), -np.inf
        while True:
            if len(place):
                evaluated += evaluate_bins(coarse, place, field.terms, field.tables.sampled, count)
                kept = np.partition(np.concatenate([kept, coarse.log_p[place]]), len(place))[len(place) :]
                least = min(float(kept.max()) - within, float(kept[0])) - _ROUNDING
            near = np.flatnonzero(coarse.upper >= least)
            place = near[coarse.seen[near] < count]
            if not len(place):
                break
            if len(place) > together:
                # Among the bins that may matter, first those with the highest bounds.
                bounds = coarse.upper[place]
                place = place[bounds >= np.partition(bounds, len(bounds) - together)[len(bounds) - together]]
                together *= 2
        log_p = coarse.log_p[near]
        likely = near[log_p >= kept[0]]
        self._likely = likely if len(likely) <= 2 * len(kept) else likely[:0]  # too many are equal
        cell, letter = np.divmod(near, len(field.labels))
        self.listed = letter * self._grid.bins + cell, log_p
        new, self._taken_in = count - self._taken_in, count
        return evaluated, new * len(coarse.upper) - evaluated

    def best_of_letters(self) -> tuple[FloatArray, int]:
        """Give the log-belief of the best bin of each letter (letters,), and how many times a bin took in a reading."""
        coarse, letters, evaluated = self._coarse, len(self._field.labels), 0
        best = np.empty(letters)
        for letter in range(letters):
            upper = coarse.upper[letter::letters]
            while coarse.seen[first := letter + letters * int(upper.argmax())] < self._taken_in:
                highest = letter + letters * np.argsort(upper)[-_ROUND:]
                place = highest[coarse.seen[highest] < self._taken_in]
                terms, sampled = self._field.terms, self._field.tables.sampled
                evaluated += evaluate_bins(coarse, place, terms, sampled, self._taken_in)
            best[letter] = coarse.log_p[first]
        return best, evaluated
