"""The inner loops of the filters, compiled once and cached. Serial: trials are what runs in parallel.

For one angle of T_R^O, all bins of a row see a taxel through the same fraction of a table cell. So a
term of a reading adds one slice of the table to the row, with four bilinear weights common to the
row: no bin is looked up by itself. Every kernel adds up a state's terms in the same order and
precision, so it does not matter when, or beside which others, a state is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import float32, float64, int64, njit, types, uint64, void
from numpy.typing import NDArray

_Function = TypeVar("_Function", bound=Callable[..., Any])
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]
Floats = NDArray[np.float32]


def compiled(signature: Any) -> Callable[[_Function], _Function]:
    """Compile for one signature, or load what an earlier run has compiled.

    "contract" lets a * b + c be one instruction; nothing else of IEEE arithmetic is given up.
    """
    decorate: Callable[[_Function], _Function] = njit(
        signature, cache=True, error_model="numpy", fastmath={"contract"}
    )
    return decorate


_INTS, _REALS = int64[::1], float64[::1]
_TABLES = float32[:, :, :, :, :, ::1]
# start, kind, xy, weight, constant, ceiling: see `estimators.history.History`.
_HISTORY = (_INTS, _INTS, float64[:, ::1], float32[::1], float64[:, ::1], _REALS)

# A slice further out than this many table nodes is off the map, and its index might overflow.
_FAR = 1e9


@compiled(
    void(
        int64, int64, _INTS, float64[:, ::1], float32[::1], _TABLES, _REALS, float64, float64, int64, int64,
        int64[:, ::1], float32[:, ::1], int64[:, ::1],
    )
)  # fmt: skip
def place_terms(
    begin: int, end: int, kind: Ints, xy: Reals, weight: Floats, tables: Floats, lattice: Reals,
    cos: float, sin: float, rows: int, columns: int, offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Find, for terms begin..end and one angle, the table slices that a block of bins reads.

    kind, xy, weight: the terms, xy (terms, 2) mm in the robot frame. lattice: [x, y] of bin (0, 0)
    less that of node (0, 0), then the step in x and y, all in mm. rows, columns: bins of the block.
    Fills, for each term, offset (4,): flat index of the nodes around bin (0, 0) in the first letter's
    tables, share (4,): their weights, within (4,): the columns and rows of bins, from and to, whose
    four nodes are on the lattice. Tables are 0 elsewhere.
    """
    _, letters, phases_y, phases_x, depth, width = tables.shape
    for i in range(end - begin):
        x, y = xy[begin + i, 0], xy[begin + i, 1]
        u = (cos * x - sin * y + lattice[0]) / lattice[2]
        v = (sin * x + cos * y + lattice[1]) / lattice[3]
        if not (abs(u) < _FAR and abs(v) < _FAR):
            within[i] = 0
            continue
        left, below = int64(math.floor(u)), int64(math.floor(v))
        right_share, above_share = u - left, v - below
        factor = float64(weight[begin + i])
        share[i, 0] = factor * (1 - above_share) * (1 - right_share)
        share[i, 1] = factor * (1 - above_share) * right_share
        share[i, 2] = factor * above_share * (1 - right_share)
        share[i, 3] = factor * above_share * right_share
        base = kind[begin + i] * letters * phases_y * phases_x
        for corner in range(4):
            node_x, node_y = left + corner % 2, below + corner // 2
            phase = base + (node_y % phases_y) * phases_x + node_x % phases_x
            offset[i, corner] = (phase * depth + node_y // phases_y) * width + node_x // phases_x
        within[i, 0] = max(0, -(left // phases_x))
        within[i, 1] = min(columns, width - (left + 1) // phases_x)
        within[i, 2] = max(0, -(below // phases_y))
        within[i, 3] = min(rows, depth - (below + 1) // phases_y)


@compiled(
    void(
        float32[::1], float32[::1], int64, int64, int64, int64, int64[:, ::1], float32[:, ::1], int64[:, ::1]
    )
)  # fmt: skip
def sum_row(
    total: Floats, nodes: Floats, terms: int, row: int, first: int, width: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Add up the placed terms for one row of bins.

    total: (columns,) is overwritten. nodes: the tables, flat. first: flat index of the letter's
    tables less that of the first letter's. width: nodes from one row to the next.
    """
    total[:] = 0
    for i in range(terms):
        if row < within[i, 2] or row >= within[i, 3] or within[i, 0] >= within[i, 1]:
            continue
        # Unsigned, because a signed index is compiled with a test for negative ones, without vectors.
        begin, end = uint64(within[i, 0]), uint64(within[i, 1])
        move = first + row * width
        a, b = uint64(offset[i, 0] + move), uint64(offset[i, 1] + move)
        c, d = uint64(offset[i, 2] + move), uint64(offset[i, 3] + move)
        share_a, share_b, share_c, share_d = share[i, 0], share[i, 1], share[i, 2], share[i, 3]
        for column in range(begin, end):
            total[column] += (
                share_a * nodes[a + column]
                + share_b * nodes[b + column]
                + share_c * nodes[c + column]
                + share_d * nodes[d + column]
            )


@compiled(
    types.UniTuple(int64, 2)(
        float64[:, :, :, ::1], float64[:, :, ::1], int64[:, :, ::1], _TABLES, _REALS, float64[:, ::1],
        *_HISTORY, int64, int64, float64, int64,
    )
)  # fmt: skip
def advance(
    belief: Reals, top: Reals, seen: Ints, tables: Floats, lattice: Reals, turns: Reals,
    start: Ints, kind: Ints, xy: Reals, weight: Floats, constant: Reals, ceiling: Reals,
    count: int, most: int, margin: float, leader: int,
) -> tuple[int, int]:  # fmt: skip
    """Bring the rows of bins up to date that can still matter after `count` readings (eq. 13, in logs).

    belief: (letters, angles, rows, columns), the log-belief of a bin after the first `seen` readings;
    top: its largest value in a row, seen: (letters, angles, rows). lattice: as in `place_terms`.
    turns: (angles, 2) cos and sin. start..ceiling: the history. most: terms of the longest reading.
    A row that has not seen all readings cannot have passed top + ceiling[count] - ceiling[seen]. It
    is left alone while that is more than `margin` below the best bin that has; otherwise it is caught
    up, reading by reading, for as long as it still can matter. leader: flat index of the row to begin
    with. Returns how many times a row took in a reading, and the row of the best bin.
    """
    letters, angles, rows, columns = belief.shape
    nodes = tables.reshape(-1)
    width = tables.shape[5]
    letter_size = tables.shape[2] * tables.shape[3] * tables.shape[4] * width
    offset, within = np.empty((most, 4), dtype=np.int64), np.empty((most, 4), dtype=np.int64)
    share, total = np.empty((most, 4), dtype=np.float32), np.empty(columns, dtype=np.float32)
    wanted = np.empty(letters * rows, dtype=np.int64)
    best, evaluated = -np.inf, 0
    first = leader
    # The leading row comes first and alone: the better the best bin, the fewer rows can matter.
    for stage in range(-1, angles):
        angle = first // rows % angles if stage < 0 else stage
        chosen, oldest = 0, count
        for letter in range(letters):
            for row in range(rows):
                if stage < 0 and (letter * angles + angle) * rows + row != first:
                    continue
                age = seen[letter, angle, row]
                hope = top[letter, angle, row] + ceiling[count] - ceiling[age]
                if age < count and hope > best - margin:
                    wanted[chosen] = letter * rows + row
                    chosen += 1
                    oldest = min(oldest, age)
        for reading in range(oldest, count):
            begin, terms = start[reading], start[reading + 1] - start[reading]
            place_terms(
                begin, begin + terms, kind, xy, weight, tables, lattice, turns[angle, 0], turns[angle, 1],
                rows, columns, offset, share, within,
            )  # fmt: skip
            rest = ceiling[count] - ceiling[reading]
            for i in range(chosen):
                letter, row = wanted[i] // rows, wanted[i] % rows
                if seen[letter, angle, row] != reading or top[letter, angle, row] + rest <= best - margin:
                    continue
                sum_row(total, nodes, terms, row, letter * letter_size, width, offset, share, within)
                here = belief[letter, angle, row]
                far, highest = constant[reading, letter], -np.inf
                for column in range(columns):
                    value = far + total[column]
                    if reading > 0:  # before the first reading all bins are alike, whatever is stored
                        value += here[column]
                    here[column] = value
                    highest = max(highest, value)
                top[letter, angle, row] = highest
                seen[letter, angle, row] = reading + 1
                evaluated += 1
                if reading + 1 == count and highest > best:
                    best = highest
                    leader = (letter * angles + angle) * rows + row
    return evaluated, leader


@compiled(
    float64(float64[:, :, :, ::1], float64[:, :, ::1], int64[:, :, ::1], int64, float64, _REALS, _INTS),
)
def summarise(
    belief: Reals, top: Reals, seen: Ints, count: int, margin: float, mass: Reals, mode: Ints
) -> float:
    """Sum the belief of each letter (eq. 14) and find its best bin (eq. 15).

    Bins more than `margin` below the best are left out. Fills mass (letters,), relative to the best
    bin, whose log-belief is returned, and mode (letters,), flat index into belief[letter], or -1.
    """
    letters, angles, rows, columns = belief.shape
    best = -np.inf
    for letter in range(letters):
        for angle in range(angles):
            for row in range(rows):
                if seen[letter, angle, row] == count:
                    best = max(best, top[letter, angle, row])
    for letter in range(letters):
        mass[letter], mode[letter], highest = 0.0, -1, -np.inf
        for angle in range(angles):
            for row in range(rows):
                if seen[letter, angle, row] != count or top[letter, angle, row] <= best - margin:
                    continue
                for column in range(columns):
                    value = belief[letter, angle, row, column]
                    if value <= best - margin:
                        continue
                    mass[letter] += math.exp(value - best)
                    if value > highest:
                        highest = value
                        mode[letter] = (angle * rows + row) * columns + column
    return best
