"""The largest values of the tables that bins can read: what makes their upper bounds."""

from __future__ import annotations

import math

import numpy as np

from tactsim.core.compiling import Floats
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.tables import Tables
from tactsim.estimators.field.vectors import LANES, TALL
from tactsim.estimators.filters.bounding import BinMaxima, Ceiling
from tactsim.estimators.filters.branch_and_bound import Belief

# The way from bin to bin is divided into so many parts, at most, each with maxima of its own. More of them make tighter
# bounds, and tables that no longer stay in the cache.
_PHASES = 2


def bin_maxima(tables: Tables, first: FloatArray) -> BinMaxima:
    """Take the maxima of tables for bins as far apart as `tables` was made for; first: [x, y] mm of the first bin."""
    kinds, letters, steps_y, steps_x, rows, columns = tables.values.shape
    steps = steps_y, steps_x
    # The first node of each phase, and one more for the end of the last.
    phases = min(_PHASES, *steps)
    start = np.array([[-(-step * k // phases) for k in range(phases + 1)] for step in steps])
    # From one point before the first node, from which a bin may reach it, until nothing is left.
    shape = (kinds, letters, phases, phases, rows + 3, LANES + columns + 1)
    highest = np.zeros(math.prod(shape) + LANES, dtype=np.float32)
    room = highest[:-LANES].reshape(shape)
    for letter in range(letters):
        nodes = (
            tables.values[:, letter]
            .transpose(0, 3, 1, 4, 2)
            .reshape(kinds, rows * steps_y, columns * steps_x)
        )
        framed = np.pad(nodes, ((0, 0), (steps_y, steps_y + 1), (steps_x, steps_x + 1)))
        for k in range(phases):
            down = _maxima(framed.swapaxes(0, 1), start[0, k], start[0, k + 1], steps_y, rows + 1)
            for m in range(phases):
                both = _maxima(down.transpose(2, 0, 1), start[1, m], start[1, m + 1], steps_x, columns + 1)
                room[:, letter, k, m, 1:-1, LANES:] = both.transpose(2, 1, 0)
    place = np.concatenate([first - tables.origin, tables.step])
    return BinMaxima(highest, np.ascontiguousarray(start[:, :-1]), np.array(shape), place, np.array(steps))


def _maxima(values: Floats, begin: int, end: int, step: int, count: int) -> Floats:
    """Take the maxima of rows begin..end of values (rows, ...), from every `step`-th on: (count, ...)."""
    found = values[begin : begin + (count - 1) * step + 1 : step].copy()
    for row in range(begin + 1, end + 1):
        np.maximum(found, values[row : row + (count - 1) * step + 1 : step], out=found)
    return found


def blank_ceiling(belief: Belief) -> Ceiling:
    """Make room for the upper bounds of the bins of a belief."""
    letters, angles, tile_rows, tile_columns, _ = belief.log_p.shape
    upper = np.zeros((letters, angles, tile_rows * TALL, tile_columns * LANES))
    return Ceiling(upper, np.zeros(belief.seen.shape, dtype=np.int64))
