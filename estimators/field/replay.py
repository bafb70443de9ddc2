"""log p of the readings at states anywhere: particles, and cells of any size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, float64, int16, int32, int64, types, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.between_nodes import add_between, add_both_between, find_nodes
from tactsim.estimators.field.series import cos_sin
from tactsim.estimators.field.terms import TERMS, Terms, of_one_place
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
    start, kind, weight, constant = terms.start, terms.kind, terms.weight, terms.constant
    nodes, unit, lattice = sampled.nodes, float32(sampled.unit), sampled.lattice
    _, letters, rows, columns = nodes.shape
    flat, plane = nodes.reshape(nodes.size), rows * columns
    # Places are in float32, twice as many to a vector: the nodes of a letter are some hundred, not thousands, apart.
    of_states = np.empty((7, _BATCH), dtype=np.float32)
    x, along_x, across_x, y, along_y, across_y, total = of_states
    across, up = (x, along_x, across_x), (y, along_y, across_y)
    right, above = np.empty((2, _BATCH), dtype=np.float32)
    # The last vector of a batch may reach beyond its states: what is looked up there must exist.
    base, at = np.zeros((2, _BATCH), dtype=np.int32)
    alike = np.empty(_BATCH // LANES, dtype=np.int64)
    # Beyond the rim everything is as at the rim: places are moved there instead of being left out.
    last_column, last_row, row = int32(columns - 1), int32(rows - 1), uint64(columns)
    for begin in range(0, len(log_p), _BATCH):
        count = min(_BATCH, len(log_p) - begin)
        for k in range(count):
            cos, sin = cos_sin(state[2, begin + k])
            along_x[k], across_x[k] = cos / lattice[2], -sin / lattice[2]
            along_y[k], across_y[k] = sin / lattice[3], cos / lattice[3]
            x[k] = (state[0, begin + k] - lattice[0]) / lattice[2]
            y[k] = (state[1, begin + k] - lattice[1]) / lattice[3]
            base[k] = letter[begin + k] * plane
        width = uint64(-(-count // LANES) * LANES)
        for reading in range(first, last):
            total[:] = 0
            i, end = start[reading], start[reading + 1]
            while i < end:
                # The nodes of so many taxels are found before any is read: numbers that were just written as a vector
                # are slow to read one by one.
                taxels, term, found = 0, i, uint64(0)
                while term < end and found + width <= _BATCH:
                    there_x, there_y = float32(terms.xy[term, 0]), float32(terms.xy[term, 1])
                    for k in range(uint64(0), width, uint64(LANES)):
                        find_nodes(  # type: ignore[call-arg]
                            at, right, above, found, base, across, up, k, there_x, there_y, last_column, last_row
                        )  # fmt: skip
                        found += uint64(LANES)
                    alike[taxels] = of_one_place(terms, term, end)
                    taxels, term = taxels + 1, term + alike[taxels]
                found = uint64(0)
                for taxel in range(taxels):
                    term = i + alike[taxel]
                    while i < term:
                        factor, tables = weight[i] * unit, uint64(kind[i] * letters * plane)
                        if i + 1 < term:
                            factors = factor, weight[i + 1] * unit
                            both = tables, uint64(kind[i + 1] * letters * plane)
                            for k in range(uint64(0), width, uint64(LANES)):
                                add_both_between(
                                    total, k, flat, both, at, row, right, above, found + k, factors
                                )
                            i += 2
                        else:
                            for k in range(uint64(0), width, uint64(LANES)):
                                add_between(
                                    total, k, flat, (tables,), at, row, right, above, found + k, (factor,)
                                )
                            i += 1
                    found += width
            for k in range(count):
                log_p[begin + k] += constant[reading, letter[begin + k]] + total[k]
