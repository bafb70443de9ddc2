"""Tables of upper bounds for blocks of bins of 1, 2, 4, ... a side: what a search from coarse to fine looks up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.estimators.field.replay import Sampled
from tactsim.estimators.field.tables import Tables


@dataclass(frozen=True, eq=False)
class Level:
    """What a block of `side` x `side` bins, given by the place of its first bin, may reach at most.

    sampled: as `field.replay` takes it. Interpolated at the first bin's place, it is not below what any bin of the
    block looks up. With a side of 1 it is the tables.
    """

    side: int
    sampled: Sampled


def pyramid(tables: Tables, side: int) -> list[Level]:
    """Make the levels of blocks of 1, 2, 4, ..., `side` bins; the first is the tables themselves.

    A node becomes the maximum of the nodes that the bins of a block beginning there may look up, as in the precomputed
    grids of Hess et al. (2016). One node more is taken in on every side, so that it does not matter how places are
    rounded. Where not all of these nodes are equal, one unit is added: interpolation may round up by less.
    """
    levels = [Level(1, tables.sampled)]
    while levels[-1].side < side:
        levels.append(_level(tables, 2 * levels[-1].side))
    return levels


def _level(tables: Tables, side: int) -> Level:
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # imported here: only a fit needs it

    highest = lowest = tables.nodes
    low = []  # nodes that the lattice grows by before the first, in y and x
    for axis, phases in zip((2, 3), tables.phases, strict=True):
        span = (side - 1) * phases + 3
        frame = [(0, 0)] * 4
        frame[axis] = (span, 2)
        # Output [i] is of the nodes [i - 1 : i + span - 1]; beyond the lattice they are 0.
        where = {"size": span, "axis": axis, "origin": 1 - (span - span // 2), "mode": "constant"}
        highest = maximum_filter1d(np.pad(highest, frame), **where)
        lowest = minimum_filter1d(np.pad(lowest, frame), **where)
        low.append(span)
    highest += highest > lowest
    lattice = tables.sampled.lattice
    lattice[:2] -= np.array(low[::-1]) * lattice[2:]
    return Level(side, tables.sampled._replace(nodes=highest, lattice=lattice))
