"""log p of the readings at states anywhere: particles, and cells of any size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, float64, int16, int32, int64, types, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.between_nodes import add_between, find_nodes
from tactsim.estimators.field.series import cos_sin
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES

# States that are looked up together, so that the arithmetic of their places is done in vectors.
_BATCH = 128


class Sampled(NamedTuple):
    """Tables on a lattice.

    nodes: (tables, letters, rows, columns), each times `unit` nats, less the value far away; 0 at the rim. lattice:
    [x, y] of node (0, 0), then the step in x and y, mm.
    """

    nodes: NDArray[np.int16]
    unit: float
    lattice: Reals


SAMPLED = types.NamedTuple((int16[:, :, :, ::1], float64, REALS), Sampled)


@compiled(void(REALS, REALS_2D, INTS, TERMS, int64, int64, SAMPLED), ordered=False)
def replay(
    log_p: Reals, state: Reals, letter: Ints, terms: Terms, first: int, last: int, sampled: Sampled
) -> None:
    """Add log p(z | x) (eq. 7) of readings first, ..., last - 1 to the log-beliefs of states anywhere.

    log_p: (states,). state: (3, states) T_R^O. letter: (states,). A state's readings are added one by one, in order: it
    does not matter in how many calls.
    """
    start, kind, xy, weight, constant = terms.start, terms.kind, terms.xy, terms.weight, terms.constant
    nodes, unit, lattice = sampled.nodes, float32(sampled.unit), sampled.lattice
    _, letters, rows, columns = nodes.shape
    flat, plane = nodes.reshape(nodes.size), rows * columns
    # Places are in float32, twice as many to a vector: the nodes of a letter are some hundred, not thousands, apart.
    cos_x, minus_sin_x = np.empty(_BATCH, dtype=np.float32), np.empty(_BATCH, dtype=np.float32)
    cos_y, sin_y = np.empty(_BATCH, dtype=np.float32), np.empty(_BATCH, dtype=np.float32)
    x, y = np.empty(_BATCH, dtype=np.float32), np.empty(_BATCH, dtype=np.float32)
    right, above = np.empty(_BATCH, dtype=np.float32), np.empty(_BATCH, dtype=np.float32)
    # The last vector of a batch may reach beyond its states: what is looked up there must exist.
    base, at = np.zeros(_BATCH, dtype=np.int32), np.empty(_BATCH, dtype=np.int32)
    total = np.empty(_BATCH, dtype=np.float32)
    # Beyond the rim everything is as at the rim: places are moved there instead of being left out.
    last_column, last_row, next_node, next_row = int32(columns - 1), int32(rows - 1), int32(1), int32(columns)
    zero, side_by_side, row = uint64(0), uint64(LANES), uint64(columns)
    for begin in range(0, len(log_p), _BATCH):
        count = min(_BATCH, len(log_p) - begin)
        for k in range(count):
            cos, sin = cos_sin(state[2, begin + k])
            cos_x[k], minus_sin_x[k] = cos / lattice[2], -sin / lattice[2]
            sin_y[k], cos_y[k] = sin / lattice[3], cos / lattice[3]
            x[k] = (state[0, begin + k] - lattice[0]) / lattice[2]
            y[k] = (state[1, begin + k] - lattice[1]) / lattice[3]
            base[k] = letter[begin + k] * plane
        for reading in range(first, last):
            total[:] = 0
            for i in range(start[reading], start[reading + 1]):
                factor, tables = weight[i] * unit, uint64(kind[i] * letters * plane)
                # A taxel's terms follow each other and share its places.
                if i == start[reading] or xy[i, 0] != xy[i - 1, 0] or xy[i, 1] != xy[i - 1, 1]:
                    there_x, there_y = float32(xy[i, 0]), float32(xy[i, 1])
                    at[:] = base
                    for k in range(zero, uint64(count), side_by_side):
                        find_nodes(  # type: ignore[call-arg]
                            at, right, x, cos_x, minus_sin_x, k, there_x, there_y, last_column, next_node
                        )
                        find_nodes(at, above, y, sin_y, cos_y, k, there_x, there_y, last_row, next_row)
                for k in range(zero, uint64(count), side_by_side):
                    add_between(total, k, flat, tables, at, row, right, above, factor)  # type: ignore[call-arg]
            for k in range(count):
                log_p[begin + k] += constant[reading, letter[begin + k]] + total[k]
