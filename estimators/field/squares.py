"""log p of the readings at squares of states, as cells are halved: two x by two y, of one angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int16, int32, int64, types, uint64, void
from numba.core.registry import cpu_target
from numpy.typing import NDArray

from tactsim.core.compiling import FLOATS, FLOATS_2D, INTS, REALS, REALS_2D, Floats, Ints, Reals, compiled
from tactsim.estimators.field.replay import SAMPLED, Sampled, replay
from tactsim.estimators.field.series import cos_sin
from tactsim.estimators.field.term_vectors import VECTORS, Vectors
from tactsim.estimators.field.terms import TERMS, Terms
from tactsim.estimators.field.vectors import LANES
from tactsim.estimators.field.windows import (
    KEPT,
    WIDE,
    add_low_windows,
    add_tall_windows,
    add_up,
    add_vectors,
    find_windows,
)

# Vectors of places whose windows are found before any is read: numbers that were just written as a vector are slow to
# read one by one.
_SLOTS = 16
# So many steps of the lattice a square may span, for windows of three rows and of four; less what rounding may move, up
# to some 100,000 steps from a state.
_LOW, _TALL = 1 - 2.0**-6, 2 - 2.0**-6
# The place of a node in the tables is a whole number of 32 bits.
_MOST_NODES = 2**32
# Where registers hold less than LANES numbers, windows take as long as states by themselves, or longer.
_WIDE_REGISTERS = "+avx512f" in cpu_target.target_context.codegen().magic_tuple()[2]


class Found(NamedTuple):
    """Where some squares see some of a reading's terms. For each vector of places there is a slot, square by square.

    window, into, share: of the slots, as `find_windows` fills them. at: (squares, LANES * vectors of terms), for each
    term the first node of its window, counted from the letter's first in the first table. total: (squares, 4 * LANES)
    partial sums.
    """

    window: NDArray[np.int32]
    into: NDArray[np.int32]
    share: Floats
    at: NDArray[np.int32]
    total: Floats


FOUND = types.NamedTuple((int32[::1], int32[::1], FLOATS, int32[:, ::1], FLOATS_2D), Found)


@compiled(void(FOUND, VECTORS, *[int64] * 3, FLOATS_2D, int32[::1]), called_from_python=False)
def find_terms(
    found: Found, vectors: Vectors, first: int, last: int, term: int, square: Floats, limits: NDArray[np.int32]
) -> None:  # fmt: skip
    """Find where squares see the terms at the places first, ..., last - 1.

    first, last, term: numbers of vectors, of places and of the terms at the first of them. square, limits: as
    `find_windows` takes them.
    """
    lanes, slot = uint64(LANES), uint64(0)
    for i in range(len(square)):
        here, there = uint64(0), uint64(term * LANES)
        for place in range(first, last):
            find_windows(  # type: ignore[call-arg]
                found.window, found.into, found.share, slot, vectors.x, vectors.y, uint64(place) * lanes, square[i],
                limits,
            )  # fmt: skip
            for _ in range(vectors.at_place[place]):
                add_vectors(found.at[i], here, found.window, slot * lanes, vectors.table, there)
                here, there = here + lanes, there + lanes
            slot += uint64(1)


@compiled(
    int64(FOUND, VECTORS, *[int64] * 3, int16[::1], INTS, int64, int64, boolean),
    ordered=False,
    called_from_python=False,
)
def add_terms(
    found: Found, vectors: Vectors, first: int, last: int, term: int, nodes: NDArray[np.int16], letter: Ints,
    plane: int, columns: int, low: bool,
) -> int:  # fmt: skip
    """Add what the terms say that `find_terms` found, and return the number of the first vector after them.

    nodes: flat. letter: of the squares. plane: nodes of a letter in a table. low: whether windows have three rows, or
    four.
    """
    into, share, factor, slot, row = found.into, found.share, vectors.factor, uint64(0), uint64(columns)
    here = there = uint64(0)
    for i in range(len(letter)):
        at, total, begin, here, there = (
            found.at[i], found.total[i], uint64(letter[i] * plane), uint64(0), uint64(term * LANES),
        )  # fmt: skip
        for place in range(first, last):
            for _ in range(vectors.at_place[place]):
                if low:
                    add_low_windows(total, nodes, begin, row, at, here, factor, there, into, share, slot)
                else:
                    add_tall_windows(total, nodes, begin, row, at, here, factor, there, into, share, slot)
                here, there = here + uint64(LANES), there + uint64(LANES)
            slot += uint64(1)
    return term + int(here) // LANES


@compiled(FLOATS_2D(REALS_2D, REALS_2D, REALS, REALS), called_from_python=False)
def on_lattice(x: Reals, y: Reals, angle: Reals, lattice: Reals) -> Floats:
    """Give squares (n, 8) as `find_windows` takes them. Arguments as for `replay_squares`."""
    square = np.empty((len(angle), 8), dtype=np.float32)
    for i in range(len(angle)):
        cos, sin = cos_sin(angle[i])
        for k in range(2):
            square[i, k] = (x[i, k] - lattice[0]) / lattice[2]
            square[i, 4 + k] = (y[i, k] - lattice[1]) / lattice[3]
        square[i, 2], square[i, 3] = cos / lattice[2], -sin / lattice[2]
        square[i, 6], square[i, 7] = sin / lattice[3], cos / lattice[3]
    return square


@compiled(
    void(REALS_2D, FLOATS_2D, INTS, TERMS, VECTORS, int64, int64, SAMPLED, boolean), called_from_python=False
)
def replay_windows(
    log_p: Reals, square: Floats, letter: Ints, terms: Terms, vectors: Vectors, first: int, last: int,
    sampled: Sampled, low: bool,
) -> None:  # fmt: skip
    """Do what `replay_squares` does where squares fit into windows.

    square: (n, 8) as `find_windows` takes them. low: whether windows of three rows are enough.
    """
    nodes = sampled.nodes
    rows, columns = nodes.shape[2], nodes.shape[3]
    flat, plane, squares, longest = nodes.reshape(nodes.size), rows * columns, len(letter), 0
    limits = np.array([columns - 1, rows - 1, columns - WIDE, rows - (3 if low else 4)], dtype=np.int32)
    for reading in range(first, last):
        longest = max(longest, vectors.terms[reading + 1] - vectors.terms[reading])
    found = Found(
        np.empty(_SLOTS * LANES, dtype=np.int32),
        np.empty(_SLOTS * KEPT * LANES, dtype=np.int32),
        np.empty(_SLOTS * KEPT * LANES, dtype=np.float32),
        np.empty((_SLOTS, longest * LANES), dtype=np.int32),
        np.empty((_SLOTS, 4 * LANES), dtype=np.float32),
    )
    sums = np.empty(4, dtype=np.float32)
    for reading in range(first, last):
        places, last_place = vectors.places[reading], vectors.places[reading + 1]
        together = max(1, _SLOTS // max(1, last_place - places))
        for begin in range(0, squares, together):
            end, term = min(begin + together, squares), vectors.terms[reading]
            found.total[: end - begin] = 0
            for place in range(places, last_place, _SLOTS):
                after = min(place + _SLOTS, last_place)
                find_terms(found, vectors, place, after, term, square[begin:end], limits)
                term = add_terms(
                    found, vectors, place, after, term, flat, letter[begin:end], plane, columns, low
                )
            for i in range(begin, end):
                add_up(sums, found.total[i - begin])  # type: ignore[call-arg]
                for k in range(4):
                    log_p[i, k] += terms.constant[reading, letter[i]] + sums[k]


@compiled(
    void(REALS_2D, REALS_2D, REALS_2D, REALS, INTS, float64, float64, TERMS, VECTORS, int64, int64, SAMPLED)
)
def replay_squares(
    log_p: Reals, x: Reals, y: Reals, angle: Reals, letter: Ints, wide: float, tall: float, terms: Terms,
    vectors: Vectors, first: int, last: int, sampled: Sampled,
) -> None:  # fmt: skip
    """Do what `replay` does, at squares of states. Small ones take less time.

    log_p: (squares, 4) of the states [y, x]. x, y: (squares, 2) mm, ascending. angle, letter: (squares,), of T_R^O.
    wide, tall: mm, how far x and y of all squares are apart. vectors: of the terms.

    Of squares that span less than some two steps of the lattice, sums are rounded in another order than in `replay`,
    which is called for larger ones, for tables that are very small or very large, and on processors without AVX-512.
    """
    nodes, lattice, squares = sampled.nodes, sampled.lattice, len(letter)
    small = _WIDE_REGISTERS and wide <= _TALL * lattice[2] and tall <= _TALL * lattice[3]
    if small and min(nodes.shape[2], nodes.shape[3]) >= WIDE and nodes.size < _MOST_NODES:
        square, low = on_lattice(x, y, angle, lattice), tall <= _LOW * lattice[3]
        replay_windows(log_p, square, letter, terms, vectors, first, last, sampled, low)
        return
    state, of_state = np.empty((3, 4 * squares)), np.empty(4 * squares, dtype=np.int64)
    for k in range(4 * squares):
        state[0, k], state[1, k], state[2, k] = x[k // 4, k & 1], y[k // 4, k >> 1 & 1], angle[k // 4]
        of_state[k] = letter[k // 4]
    replay(log_p.reshape(log_p.size), state, of_state, terms, first, last, sampled)
