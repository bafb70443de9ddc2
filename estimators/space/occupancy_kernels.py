"""The kernel that adds what taxels say of occupancy to voxels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64, types, void

from tactsim.core.compiling import (
    FLOATS_3D,
    INTS_2D,
    REALS,
    REALS_2D,
    REALS_3D,
    Floats,
    Ints,
    Reals,
    compiled,
)


class TaxelWays(NamedTuple):
    """The ways that taxels came along in n touches.

    places: (n, 3) mm and turns: (n, 3, 3), the sensor in the object. taxel: (taxels, 2) mm. ends: (n, taxels) mm above
    the pad's plane, where each taxel's way ended: at the surface, or with the pad. kinds: (n, taxels) 0 No Contact,
    1 In Contact, 2 Unknown.
    """

    places: Reals
    turns: Reals
    taxel: Reals
    ends: Reals
    kinds: Ints


TAXEL_WAYS = types.NamedTuple((REALS_2D, REALS_3D, REALS_2D, REALS_2D, INTS_2D), TaxelWays)


@compiled(void(FLOATS_3D, REALS, float64, TAXEL_WAYS, REALS_2D, float64, float64))
def add_evidence(
    odds: Floats, corner: Reals, cell: float, ways: TaxelWays, added: Reals, reach: float, stroke: float
) -> None:
    """Add to voxels (a, b, c) the log-odds that taxels give them (paper, eq. 4 to 6, in space).

    corner: (3,) mm of the first voxel, cell: mm. added: (2, steps) the log-odds by kind and squared distance, even
    steps up to reach^2. A taxel In Contact says that its way's end is occupied and that the way, `stroke` mm long, is
    free up to 2 reach before that; No Contact, that all of it is free.
    """
    places, turns, taxel, ends, kinds = ways.places, ways.turns, ways.taxel, ways.ends, ways.kinds
    finest = added.shape[1] / reach**2
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    low_u, high_u = taxel[:, 0].min() - reach, taxel[:, 0].max() + reach
    low_v, high_v = taxel[:, 1].min() - reach, taxel[:, 1].max() + reach
    for n in range(len(places)):
        turn = turns[n]
        low_w, high_w = ends[n].min() - stroke - reach, ends[n].max() + reach
        for axis in range(3):
            middle = places[n, axis] + (
                turn[axis, 0] * (low_u + high_u) + turn[axis, 1] * (low_v + high_v) + turn[axis, 2] * (low_w + high_w)
            ) / 2  # fmt: skip
            half = (
                abs(turn[axis, 0]) * (high_u - low_u)
                + abs(turn[axis, 1]) * (high_v - low_v)
                + abs(turn[axis, 2]) * (high_w - low_w)
            ) / 2
            first[axis] = max(0, math.ceil((middle - half - corner[axis]) / cell))
            last[axis] = min(odds.shape[axis] - 1, math.floor((middle + half - corner[axis]) / cell))
        for i in range(first[0], last[0] + 1):
            x = corner[0] + cell * i - places[n, 0]
            for j in range(first[1], last[1] + 1):
                y = corner[1] + cell * j - places[n, 1]
                for k in range(first[2], last[2] + 1):
                    z = corner[2] + cell * k - places[n, 2]
                    u = turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z
                    v = turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z
                    w = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
                    if not (low_u < u < high_u and low_v < v < high_v and low_w < w < high_w):
                        continue
                    for t in range(len(taxel)):
                        aside = (u - taxel[t, 0]) ** 2 + (v - taxel[t, 1]) ** 2
                        if aside >= reach * reach or kinds[n, t] == 2:
                            continue
                        away = aside + (w - ends[n, t]) ** 2
                        if kinds[n, t] == 1 and away < reach * reach:
                            odds[i, j, k] += added[1, int(away * finest)]
                        over = w - ends[n, t] + 2 * reach * kinds[n, t]
                        away = aside + max(over, 0.0) ** 2
                        if away < reach * reach:
                            odds[i, j, k] += added[0, int(away * finest)]
