"""The terms of all readings in vectors, as squares of states look them up (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, float64, int32, int64, types, void
from numpy.typing import NDArray

from tactsim.core.compiling import FLOATS, INTS, Floats, Ints, compiled
from tactsim.estimators.field.terms import TERMS, Terms, of_one_place
from tactsim.estimators.field.vectors import LANES


class Vectors(NamedTuple):
    """Terms, and the places where they lie, in vectors of LANES; a reading's begin with a new one.

    places, terms: (readings + 1,) where each reading's vectors begin, of places and of terms. at_place: (vectors of
    places,) how many vectors of terms lie there. x, y: (LANES * vectors of places,) mm, of the places in the robot's
    frame. factor, table: (LANES * vectors of terms,) weights times `Tables.unit`, and nodes from the first table to the
    term's. Arrays may be longer than what is filled.
    """

    places: Ints
    terms: Ints
    at_place: Ints
    x: Floats
    y: Floats
    factor: Floats
    table: NDArray[np.int32]


VECTORS = types.NamedTuple((INTS, INTS, INTS, FLOATS, FLOATS, FLOATS, int32[::1]), Vectors)


def no_vectors(readings: int, vectors: int) -> Vectors:
    """Make room for so many readings and vectors, of places and of terms."""
    return Vectors(
        places=np.zeros(readings + 1, dtype=np.int64),
        terms=np.zeros(readings + 1, dtype=np.int64),
        at_place=np.zeros(vectors, dtype=np.int64),
        x=np.zeros(vectors * LANES, dtype=np.float32),
        y=np.zeros(vectors * LANES, dtype=np.float32),
        factor=np.zeros(vectors * LANES, dtype=np.float32),
        table=np.zeros(vectors * LANES, dtype=np.int32),
    )


def most_vectors(terms: int) -> int:
    """Say into how many vectors so many terms go at most.

    One is not full where no more terms are left, or no more taxels, of which there were LANES or more.
    """
    return 2 * terms // LANES + 2


@compiled(int64(TERMS, int64), called_from_python=False)
def terms_of_taxel(terms: Terms, reading: int) -> int:
    """Find how many terms each taxel of a reading has, if these are alike and follow each other; 1 otherwise.

    Also 1 if there are fewer taxels than LANES.
    """
    begin, end = terms.start[reading], terms.start[reading + 1]
    each = of_one_place(terms, begin, end)
    if (end - begin) % each or end - begin < each * LANES:
        return 1
    for i in range(begin, end, each):
        if of_one_place(terms, i, i + each) < each:
            return 1
    return each


@compiled(void(VECTORS, TERMS, int64, int64, float64, int64))
def put_in_vectors(
    vectors: Vectors, terms: Terms, first: int, last: int, unit: float, table_nodes: int
) -> None:
    """Put readings first, ..., last - 1 into vectors, after those before; there must be room.

    Terms of one taxel share its place where they can. table_nodes: how many nodes a table has, of all letters.
    """
    for reading in range(first, last):
        each, begin, end = terms_of_taxel(terms, reading), terms.start[reading], terms.start[reading + 1]
        of_places, of_terms = vectors.places[reading], vectors.terms[reading]
        while begin < end:
            # What is left over may fit into one vector of terms, each with a place of its own.
            apart = 1 if end - begin <= LANES else each
            filled = min(LANES, (end - begin) // apart)
            for lane in range(LANES):
                # The lanes that remain are at the last place, and count nothing.
                i, place = begin + min(lane, filled - 1) * apart, of_places * LANES + lane
                vectors.x[place], vectors.y[place] = terms.xy[i, 0], terms.xy[i, 1]
                for k in range(apart):
                    there = (of_terms + k) * LANES + lane
                    vectors.factor[there] = (
                        terms.weight[i + k] * float32(unit) if lane < filled else float32(0)
                    )
                    vectors.table[there] = int32(terms.kind[i + k] * table_nodes)
            vectors.at_place[of_places] = apart
            of_places, of_terms, begin = of_places + 1, of_terms + apart, begin + filled * apart
        vectors.places[reading + 1], vectors.terms[reading + 1] = of_places, of_terms
