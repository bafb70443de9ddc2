"""Coarse bins in tiles, and upper bounds of what all of them are after a reading (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, float64, int32, int64, types, uint8, void
from numpy.typing import NDArray

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.slices import LAYOUT, Layout
from tactsim.estimators.field.table_levels import (
    HIGHEST,
    LEVELS,
    Levels,
    Looked,
    entries_of,
    look_up,
    raise_alike,
    raise_weighted,
)
from tactsim.estimators.field.terms import ROUNDING, TERMS, Terms
from tactsim.estimators.field.vectors import LANES, LINE, fetch

# For so many tiles times terms it is kept at once where they look up bounds, 10 bytes each.
_LOOKED = 2**20


class Coarse(NamedTuple):
    """The log-belief of all bins in tiles (letters, angles, tile rows, tile columns), some of which wait.

    upper: (letters * tiles, TALL * LANES) float32, not below what a bin's log-belief is after all readings; -inf where
    a tile hangs over the grid. bound: (letters * tiles,) the highest of a tile. log_p: as `upper`, a bin's log-belief
    after the first `seen` readings. counts: columns, rows and angles of bins. spacing: of bins, mm, mm, rad.
    """

    upper: NDArray[np.float32]
    bound: Reals
    log_p: Reals
    seen: NDArray[np.int32]
    counts: Ints
    spacing: Reals


COARSE = types.NamedTuple((float32[:, ::1], REALS, REALS_2D, int32[:, ::1], INTS, REALS), Coarse)


@compiled(void(uint8[::1], INTS, int64, int64, int64, int64, int64), called_from_python=False)
def fetch_part(
    level: NDArray[np.uint8], kinds: Ints, table: int, letter: int, nodes: int, part: int, parts: int
) -> None:
    """Begin to fetch one of so many parts of a letter's bounds: `nodes` bytes of each of some tables.

    table: bytes from a table to the next.

    No processor foresees where tiles of all angles look up bounds. So a letter's are fetched in order while those of
    the letter before are summed.
    """
    size = (nodes // LINE) // parts + 1
    for kind in kinds:
        first = kind * table + letter * nodes
        for line in range(part * size, min(nodes // LINE + 1, (part + 1) * size)):
            fetch(level, first + line * LINE)


@compiled(float64(COARSE, LAYOUT, TERMS, int64), called_from_python=False)
def place_rounding(coarse: Coarse, layout: Layout, terms: Terms, reading: int) -> float:
    """Bound by how many nodes along an axis `replay`, in float32, may misplace what a bin reads.

    A place is a sum of a bin's place among the nodes and of two products with the taxel's. It rounds five times at
    most, by half of ROUNDING each. A taxel further off than any bin is from any node reads the rim, wherever exactly it
    lies.
    """
    place, shape, farthest = layout.place, layout.shape, 0.0
    # mm from any bin to any node along an axis, and between nodes.
    wide = abs(place[0]) + place[2] * (coarse.counts[0] + shape[5])
    tall = abs(place[1]) + place[3] * (coarse.counts[1] + shape[4])
    across, up = place[2] / shape[3], place[3] / shape[2]
    for i in range(terms.start[reading], terms.start[reading + 1]):
        farthest = max(farthest, abs(terms.xy[i, 0]) + abs(terms.xy[i, 1]))
    most = max(wide / across, tall / up) + min(farthest, wide + tall) / min(across, up)
    return 2.5 * ROUNDING * most


@compiled(void(COARSE, LEVELS, LAYOUT, TERMS, REALS_2D, int64), called_from_python=False)
def bound_all(
    coarse: Coarse, levels: Levels, layout: Layout, terms: Terms, turns: Reals, reading: int
) -> None:
    """Let the upper bounds of all bins take in a reading. turns: (angles, 2) cos and sin."""
    letters, angles, tiles = layout.shape[1], len(turns), len(coarse.bound) // layout.shape[1]
    entries, of_angle = entries_of(levels, layout, terms, reading), tiles // angles
    longest = len(entries.term)
    together = min(angles, max(1, _LOOKED // max(1, of_angle * longest)))
    looked = Looked(
        np.empty((together * of_angle, longest), dtype=np.int64),
        np.empty((together * of_angle, longest), dtype=np.uint16),
        np.empty((together * of_angle, LANES), dtype=np.float32),
    )
    width, nodes = layout.shape[5], layout.shape[2] * layout.shape[3] * layout.plane
    kinds = np.unique(terms.kind[terms.start[reading] : terms.start[reading + 1]])
    pieces = np.empty((5, longest), dtype=np.int64)
    unit = levels.step[0] * entries.heaviest
    # What float32 may lose of the sums of levels and of lowest values, which are at most HIGHEST steps below 0. Then by
    # how much it may move what a table says, by moving a place along both axes.
    slack = terms.slack[reading] + (longest + 6) * ROUNDING * longest * HIGHEST * unit
    slack += 2 * place_rounding(coarse, layout, terms, reading) * longest * HIGHEST * unit
    for begin in range(0, angles, together):
        some = min(together, angles - begin)
        for i in range(some):
            fetch_part(levels.level, kinds, layout.table, 0, nodes, i, some)
            look_up(
                looked, entries, layout, terms, reading, i * of_angle, coarse.counts[1], coarse.counts[0],
                turns[begin + i, 0], turns[begin + i, 1], pieces,
            )  # fmt: skip
        for letter in range(letters):
            constant = terms.constant[reading, letter]
            constant += slack + 4 * ROUNDING * abs(constant)
            for tile in range(some * of_angle):
                if letter + 1 < letters:
                    fetch_part(levels.level, kinds, layout.table, letter + 1, nodes, tile, some * of_angle)
                place, move = letter * tiles + begin * of_angle + tile, letter * nodes
                here = coarse.upper[place]
                if entries.alike:
                    bound = raise_alike(here, levels, looked, tile, move, width, unit, constant)
                else:
                    bound = raise_weighted(
                        here, levels, looked, entries, tile, move, width, unit / HIGHEST, constant
                    )
                coarse.bound[place] = bound
