"""The inner loops of filters whose states lie anywhere: particles. Serial, as all kernels."""

from __future__ import annotations

import math

import numpy as np
from numba import float32, float64, int64, uint64, void

from tactsim.estimators.field.compiling import Floats, Ints, Reals, compiled

_REALS, _REALS_2D, _REALS_3D = float64[::1], float64[:, ::1], float64[:, :, ::1]
_INTS, _INTS_2D = int64[::1], int64[:, ::1]
_FLOATS, _FLOATS_4D = float32[::1], float32[:, :, :, ::1]

# States that are looked up together, so that the arithmetic of their places is done in vectors.
_BATCH = 128


@compiled(
    void(
        _REALS, _REALS_2D, _INTS, _INTS, _INTS, _REALS_2D, _FLOATS, _REALS_2D, int64, int64, _FLOATS_4D,
        _REALS,
    ),
    ordered=False,
)  # fmt: skip
def replay(
    log_p: Reals, state: Reals, letter: Ints, start: Ints, table: Ints, xy: Reals, weight: Floats,
    constant: Reals, first: int, last: int, nodes: Floats, lattice: Reals,
) -> None:  # fmt: skip
    """Add log p(z | x) (eq. 7) of readings first, ..., last - 1 to the log-beliefs of states anywhere.

    log_p: (states,). state: (3, states) T_R^O, letter: (states,). start, table, xy, weight, constant: as
    `start`, `kind` and so on in `tactsim.estimators.field.history.History`. nodes: (tables, letters, rows, columns),
    less the value outside, hence 0 at the rim. lattice: [x, y] of node (0, 0), then the step in x and y,
    mm. A state's readings are added one by one, in order: it does not matter in how many calls.
    """
    _, letters, rows, columns = nodes.shape
    flat, plane = nodes.reshape(nodes.size), rows * columns
    cos_x, sin_x, cos_y, sin_y = np.empty(_BATCH), np.empty(_BATCH), np.empty(_BATCH), np.empty(_BATCH)
    x, y, total = np.empty(_BATCH), np.empty(_BATCH), np.empty(_BATCH, dtype=np.float32)
    base, at = np.empty(_BATCH, dtype=np.int64), np.empty(_BATCH, dtype=np.int64)
    right, above = np.empty(_BATCH, dtype=np.float32), np.empty(_BATCH, dtype=np.float32)
    # Beyond the rim everything is as at the rim: places are moved there instead of being left out.
    last_column, last_row = columns - 1.000001, rows - 1.000001
    one, row_above = uint64(1), uint64(columns)
    for begin in range(0, len(log_p), _BATCH):
        count = min(_BATCH, len(log_p) - begin)
        for k in range(count):
            cos, sin = math.cos(state[2, begin + k]), math.sin(state[2, begin + k])
            cos_x[k], sin_x[k], cos_y[k], sin_y[k] = (
                cos / lattice[2], sin / lattice[2], cos / lattice[3], sin / lattice[3],
            )  # fmt: skip
            x[k] = (state[0, begin + k] - lattice[0]) / lattice[2]
            y[k] = (state[1, begin + k] - lattice[1]) / lattice[3]
            base[k] = letter[begin + k] * plane
        for reading in range(first, last):
            total[:count] = 0
            for i in range(start[reading], start[reading + 1]):
                there_x, there_y, factor = xy[i, 0], xy[i, 1], weight[i]
                tables = table[i] * letters * plane
                # Two loops, because places are computed in vectors and values are not loaded in vectors.
                for k in range(uint64(count)):
                    u = min(max(x[k] + cos_x[k] * there_x - sin_x[k] * there_y, 0.0), last_column)
                    v = min(max(y[k] + sin_y[k] * there_x + cos_y[k] * there_y, 0.0), last_row)
                    column, row = int64(u), int64(v)
                    right[k], above[k] = float32(u - column), float32(v - row)
                    at[k] = tables + base[k] + row * columns + column
                for k in range(uint64(count)):
                    corner = uint64(at[k])
                    below_left, below_right = flat[corner], flat[corner + one]
                    above_left, above_right = flat[corner + row_above], flat[corner + row_above + one]
                    lower = below_left + right[k] * (below_right - below_left)
                    upper = above_left + right[k] * (above_right - above_left)
                    total[k] += factor * (lower + above[k] * (upper - lower))
            for k in range(count):
                log_p[begin + k] += constant[reading, letter[begin + k]] + total[k]


@compiled(
    void(
        _INTS_2D, _REALS_2D, _INTS, _INTS, _INTS, _REALS, _INTS, _INTS, _REALS_2D, _FLOATS, _REALS_2D, int64,
        int64, _FLOATS_4D, _REALS,
    )
)  # fmt: skip
def replay_halves(
    half: Ints, log_p: Reals, cell: Ints, which: Ints, counts: Ints, spacing: Reals, start: Ints, table: Ints,
    xy: Reals, weight: Floats, constant: Reals, first: int, last: int, nodes: Floats, lattice: Reals,
) -> None:  # fmt: skip
    """Find the eight halves of cells of a grid, and add readings first, ..., last - 1 to their log-beliefs.

    half, log_p: (cells, 8), overwritten and added to in the rows `which`. cell: (cells,), flat index into
    (letters, angles, rows, columns), as that of the halves. counts: columns, rows, angles. spacing: in
    x, y and angle, mm, mm, rad; the grid is centred at 0. The rest as in `replay`.
    """
    columns, rows, angles = 2 * counts[0], 2 * counts[1], 2 * counts[2]
    dx, dy, da = spacing[0] / 2, spacing[1] / 2, spacing[2] / 2
    total, state = np.empty(8 * len(which)), np.empty((3, 8 * len(which)))
    letters = np.empty(8 * len(which), dtype=np.int64)
    for i in range(len(which)):
        rest, column = divmod(cell[which[i]], counts[0])
        rest, row = divmod(rest, counts[1])
        letter, angle = divmod(rest, counts[2])
        for part in range(8):
            x, y, turn = 2 * column + (part & 1), 2 * row + (part >> 1 & 1), 2 * angle + (part >> 2)
            half[which[i], part] = ((letter * angles + turn) * rows + y) * columns + x
            k = 8 * i + part
            state[0, k], state[1, k] = (x + 0.5 - columns / 2) * dx, (y + 0.5 - rows / 2) * dy
            state[2, k], letters[k] = (turn + 0.5 - angles / 2) * da, letter
            total[k] = log_p[which[i], part]
    replay(total, state, letters, start, table, xy, weight, constant, first, last, nodes, lattice)
    for i in range(len(which)):
        for part in range(8):
            log_p[which[i], part] = total[8 * i + part]


@compiled(void(_REALS, _REALS_2D, _INTS, _INTS, _REALS_2D, _FLOATS, _FLOATS_4D, _REALS))
def weigh(
    log_weight: Reals, state: Reals, letter: Ints, table: Ints, xy: Reals, weight: Floats, nodes: Floats,
    lattice: Reals,
) -> None:  # fmt: skip
    """Add log p(z | x) of one reading (eq. 7), less what a state far away gets, to log-weights (states,).

    table, xy, weight: the reading's terms, xy (terms, 2) mm in the robot frame. The rest as in `replay`.
    """
    constant = np.zeros((1, nodes.shape[1]))
    start = np.array([0, len(table)])
    replay(log_weight, state, letter, start, table, xy, weight, constant, 0, 1, nodes, lattice)


@compiled(void(_REALS))
def sort_uniform(values: Reals) -> None:
    """Sort numbers that are uniform in [0, 1), in place: into as many buckets, which are then put in order."""
    count = len(values)
    place, unsorted = np.zeros(count + 1, dtype=np.int64), values.copy()
    for value in unsorted:
        place[int64(value * count) + 1] += 1
    for bucket in range(count):
        place[bucket + 1] += place[bucket]
    for value in unsorted:
        bucket = int64(value * count)
        values[place[bucket]] = value
        place[bucket] += 1
    for i in range(1, count):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@compiled(void(_INTS, _REALS, _REALS))
def draw(chosen: Ints, weight: Reals, uniform: Reals) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. uniform: (draws,) in [0, 1), is sorted.
    """
    sort_uniform(uniform)
    total = weight.sum()
    index, reached = 0, weight[0]
    for i in range(len(chosen)):
        while reached <= uniform[i] * total and index < len(weight) - 1:
            index += 1
            reached += weight[index]
        chosen[i] = index


@compiled(void(float32[:, :, ::1], int64, _REALS_2D, _REALS, _REALS, _REALS, float64), ordered=False)
def add_cones(
    density: Floats, before: int, state: Reals, weight: Reals, corner: Reals, step: Reals, rho: float
) -> None:
    """Add the weighted cones (eq. 10, 11) of states to a grid.

    density: (rows, columns, angles), beginning at [x, y] = corner mm and `before` angles ahead of 0,
    which must be more than rho has steps. state: (3, states), with angles in [0, 2 pi). step: mm, mm,
    rad. Cones are not folded around the circle. The distance of eq. 10 counts mm and rad alike.
    """
    rows, columns, angles = density.shape
    nodes, square = density.reshape(density.size), step[2] ** 2
    reach_x, reach_y, reach = rho / step[0], rho / step[1], int64(rho / step[2])
    turned, nothing = np.empty(2 * reach + 2, dtype=np.float32), float32(0)
    for i in range(len(weight)):
        x, y = (state[0, i] - corner[0]) / step[0], (state[1, i] - corner[1]) / step[1]
        turn, height, slope = state[2, i] / step[2], float32(weight[i]), float32(weight[i] / rho)
        first = math.ceil(turn - rho / step[2])
        for k in range(uint64(len(turned))):
            turned[k] = square * (first - turn + k) ** 2
        for row in range(max(0, math.ceil(y - reach_y)), min(rows, math.floor(y + reach_y) + 1)):
            for column in range(max(0, math.ceil(x - reach_x)), min(columns, math.floor(x + reach_x) + 1)):
                flat = float32(((column - x) * step[0]) ** 2 + ((row - y) * step[1]) ** 2)
                if flat >= rho**2:
                    continue
                at = uint64((row * columns + column) * angles + before + first)
                for k in range(uint64(len(turned))):
                    nodes[at + k] += max(nothing, height - slope * math.sqrt(flat + turned[k]))


@compiled(void(_REALS, _REALS_2D, _REALS_2D, _REALS, float64))
def sum_cones(density: Reals, node: Reals, state: Reals, weight: Reals, rho: float) -> None:
    """Sum the weighted cones (eq. 10, 11) of states at single nodes, around the circle.

    density: (nodes,) is overwritten. node: (nodes, 3), state: (3, states) mm, mm, rad, angles in [0, 2 pi).
    """
    for m in range(len(density)):
        density[m] = 0
        for i in range(len(weight)):
            turn = abs(state[2, i] - node[m, 2])
            turn = min(turn, 2 * math.pi - turn)
            square = (state[0, i] - node[m, 0]) ** 2 + (state[1, i] - node[m, 1]) ** 2 + turn**2
            if square < rho**2:
                density[m] += weight[i] * (1 - math.sqrt(square) / rho)
