"""The terms of the readings of a sequence, and their sums at states anywhere (compiled); those of planes: `binned`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import float32, float64, int32, uint32, uint64

from tactsim.core.compiling import Floats1D, Int16s1D, Int16s4D, Ints1D, Reals1D, Reals2D, compiled

# How far one operation in float32 may be off, relative to its result.
ROUNDING = 2.0**-23
# States, or bins of a row, that are summed together; and zeros between the rows of `Lattice.nodes`, which a row of bins
# that hangs over reads.
LANES = 16
# States that `replay` takes one term after another for: what it keeps of them stays in the nearest cache.
_BLOCK = 128
# Bins; a taxel that many bins from the first bin, or nowhere, is off the map, and its index might overflow.
FAR = 1e9


class Terms(NamedTuple):
    """The terms of all readings so far; arrays may be longer than what is filled.

    A reading is one sum of terms, or as many as there are loads that it may have been taken under: then their mean
    counts, of likelihoods. loads: how many. start: (readings * loads + 1,) where the terms of each load of each reading
    begin. kind, xy, weight: (terms,) the terms' table, place in the robot frame (mm) and factor. constant: (readings *
    loads, letters) what a state far off the map gets. upper: (readings + 1,) cumulated, an upper bound of what any
    state gets. slack: (readings,) by how much rounding may move a sum.
    """

    loads: int
    start: Ints1D
    kind: Ints1D
    xy: Reals2D
    weight: Floats1D
    constant: Reals2D
    upper: Reals1D
    slack: Reals1D


class Ranges(NamedTuple):
    """What tables say: outside (tables, letters), lowest and highest (tables,), as in `tables.Tables`, nats."""

    outside: Reals2D
    lowest: Reals1D
    highest: Reals1D


class Named(NamedTuple):
    """The terms that a reading names: table and taxel (terms,) indices, weight (terms,), see `likelihood.Evidence`.

    end: (loads,) where the terms of each load end.
    """

    table: Ints1D
    taxel: Ints1D
    weight: Floats1D
    end: Ints1D


class Sampled(NamedTuple):
    """Tables on a lattice.

    nodes: (tables, letters, rows, columns), each times `unit` nats, less the value far away; 0 at the rim. lattice:
    [x, y] of node (0, 0), then the step in x and y, mm.
    """

    nodes: Int16s4D
    unit: float
    lattice: Reals1D


class Lattice(NamedTuple):
    """Tables as the bins of a plane read them: the nodes one bin apart follow each other.

    nodes: flat, int16, each times `unit` nats: (tables, letters, phases_y, phases_x, rows, columns), where the lattice
    node [row * phases_y + phase_y, column * phases_x + phase_x] is in that row and column of the plane of those phases.
    Before each row, and after the last one, there are LANES zeros. shape: those six numbers. place: [x, y] of bin
    (0, 0) less that of node (0, 0), then the bins' spacing in x and y, mm.
    """

    nodes: Int16s1D
    unit: float
    shape: Ints1D
    place: Reals1D


@compiled()
def record(
    terms: Terms, reading: int, named: Named, taxel_xy: Reals2D, pose: Reals1D, ranges: Ranges
) -> bool:
    """Append a reading's terms, taken at the pose sensor_in_robot; the arrays must have room.

    Returns False, and appends nothing, if a table or taxel does not exist or a weight is negative or not finite.
    """
    row, count = reading * terms.loads, len(named.table)
    begin = terms.start[row]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    first, upper, slack = 0, -np.inf, 0.0
    for load in range(terms.loads):
        most = size = 0.0
        terms.constant[row + load] = -math.log(terms.loads)
        for i in range(first, named.end[load]):
            kind, taxel, factor = named.table[i], named.taxel[i], float64(named.weight[i])
            if not (0 <= kind < len(ranges.highest) and 0 <= taxel < len(taxel_xy) and 0 <= factor < np.inf):
                return False
            x, y = taxel_xy[taxel, 0], taxel_xy[taxel, 1]
            terms.kind[begin + i], terms.weight[begin + i] = kind, factor
            terms.xy[begin + i, 0] = pose[0] + cos * x - sin * y
            terms.xy[begin + i, 1] = pose[1] + sin * x + cos * y
            most += factor * ranges.highest[kind]
            size += factor * max(abs(ranges.lowest[kind]), abs(ranges.highest[kind]))
            for letter in range(ranges.outside.shape[1]):
                terms.constant[row + load, letter] += factor * ranges.outside[kind, letter]
        first = named.end[load]
        terms.start[row + load + 1] = begin + first
        upper, slack = max(upper, most), max(slack, size)
    # Each of the additions may be off by that share of what the sum can have reached.
    terms.slack[reading] = slack * ROUNDING * (count + 4)
    terms.upper[reading + 1] = terms.upper[reading] + upper + terms.slack[reading]
    return True


@compiled()
def replay(
    log_p: Reals2D, state: Reals2D, letter: Ints1D, terms: Terms, first: int, last: int, sampled: Sampled
) -> None:
    """Add log p(z | x) (eq. 7) of readings first, ..., last - 1 to the log-beliefs of states anywhere.

    Of a reading that may have been taken under several loads it is the log of their mean.

    log_p: (1, states), or (readings, states) for each reading by itself. state: (3, states) T_R^O. letter: (states,). A
    state's terms are added one by one, in order: it does not matter in how many calls, or beside which others. Each of
    three loops over a block of states is compiled to instructions for many states at once: find their places, read the
    nodes around them, interpolate.
    """
    lattice, begin = sampled.lattice, terms.start
    _, letters, rows, columns = sampled.nodes.shape
    nodes, plane = sampled.nodes.reshape(sampled.nodes.size).view(np.uint16), rows * columns
    # Places are in float32, twice as many to an instruction: a letter's nodes are some hundred, not thousands, apart.
    x, along_x, across_x, y, along_y, across_y, right, above, total = np.zeros((9, _BLOCK), dtype=np.float32)
    mixed = np.empty(_BLOCK)
    own, node, low, high = np.zeros((4, _BLOCK), dtype=np.int32)
    none, last_column, last_row = float32(0), float32(columns - 1), float32(rows - 1)
    second_column, second_row, width = int32(columns - 2), int32(rows - 2), int32(columns)
    half, next_node, next_row = uint32(16), uint64(1), uint64(columns)
    for block in range(0, len(letter), _BLOCK):
        count = min(_BLOCK, len(letter) - block)
        states, padded = uint64(count), uint64(-(-count // LANES) * LANES)
        for k in range(count):
            cos, sin = math.cos(state[2, block + k]), math.sin(state[2, block + k])
            along_x[k], across_x[k] = cos / lattice[2], -sin / lattice[2]
            along_y[k], across_y[k] = sin / lattice[3], cos / lattice[3]
            x[k] = (state[0, block + k] - lattice[0]) / lattice[2]
            y[k] = (state[1, block + k] - lattice[1]) / lattice[3]
            own[k] = letter[block + k] * plane
        for row in range(first * terms.loads, last * terms.loads):
            total[:] = 0
            term_x = term_y = float32(0)
            for term in range(begin[row], begin[row + 1]):
                before_x, before_y = term_x, term_y
                term_x, term_y = float32(terms.xy[term, 0]), float32(terms.xy[term, 1])
                # Terms of one taxel follow each other, and are at one place, which is found once.
                again = term > begin[row] and term_x == before_x and term_y == before_y
                for k in range(uint64(0) if again else padded):
                    to_x = x[k] + along_x[k] * term_x + across_x[k] * term_y
                    to_y = y[k] + along_y[k] * term_x + across_y[k] * term_y
                    # Beyond the rim all is as at the rim. A place that is no number is taken for the first node.
                    to_x, to_y = to_x if to_x > none else none, to_y if to_y > none else none
                    to_x, to_y = (
                        to_x if to_x < last_column else last_column,
                        to_y if to_y < last_row else last_row,
                    )
                    near_x: Any = int32(to_x)  # type: ignore[arg-type]
                    near_y: Any = int32(to_y)  # type: ignore[arg-type]
                    near_x, near_y = min(near_x, second_column), min(near_y, second_row)
                    right[k], above[k] = to_x - float32(near_x), to_y - float32(near_y)
                    node[k] = own[k] + near_y * width + near_x
                table = uint64(terms.kind[term] * letters * plane)
                # Two neighbours are read as one number of 32 bits, the second in its upper half.
                for k in range(states):
                    there = table + uint64(node[k])
                    low[k] = uint32(nodes[there]) | (uint32(nodes[there + next_node]) << half)
                    there += next_row
                    high[k] = uint32(nodes[there]) | (uint32(nodes[there + next_node]) << half)
                weight = float32(terms.weight[term] * sampled.unit)
                for k in range(padded):
                    lower, upper = low[k], high[k]
                    lower_left, lower_right = (
                        float32(int32(int32(lower << 16) >> 16)),
                        float32(int32(lower >> 16)),
                    )
                    upper_left, upper_right = (
                        float32(int32(int32(upper << 16) >> 16)),
                        float32(int32(upper >> 16)),
                    )
                    below = lower_left + right[k] * (lower_right - lower_left)
                    beyond = upper_left + right[k] * (upper_right - upper_left)
                    total[k] += weight * (below + above[k] * (beyond - below))
            load, into = row % terms.loads, log_p[row // terms.loads - first if len(log_p) > 1 else 0]
            for k in range(count):
                value = terms.constant[row, letter[block + k]] + total[k]
                if load > 0:
                    value = max(mixed[k], value) + math.log1p(math.exp(-abs(mixed[k] - value)))
                mixed[k] = value
                if load == terms.loads - 1:
                    into[block + k] += value
