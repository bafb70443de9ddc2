"""Kernels that merge what touches say of a surface into distances on a dense voxel grid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64

from tactsim.core.compiling import Floats3D, Int8s3D, Reals1D, Reals2D, Reals3D, compiled

UNKNOWN, INSIDE, OUTSIDE = 0, 1, 2  # of voxels


class HeightMaps(NamedTuple):
    """How high a surface lies over the nodes of a lattice on the pad, in n touches.

    places: (n, 3) mm and turns: (n, 3, 3), the sensor in the object. heights: (n, rows, columns) mm above the pad's
    plane; trusted: (n, rows, columns) the weight of that, 0 for none. frame: [x of the first node, y of the first node,
    spacing] mm.
    """

    places: Reals2D
    turns: Reals3D
    heights: Reals3D
    trusted: Reals3D
    frame: Reals1D


@compiled()
def merge(
    total: Floats3D,
    weight: Floats3D,
    corner: Reals1D,
    cell: float,
    maps: HeightMaps,
    before: float,
    behind: float,
) -> None:
    """Add to the voxels what touches say of their signed distances (Curless and Levoy 1996).

    total, weight: (a, b, c) sums of weighted distances mm and of weights, changed in place. corner: (3,) mm, cell: mm.
    before, behind: how far from the surface voxels are changed, mm.
    """
    places, turns, heights, trusted, frame = maps.places, maps.turns, maps.heights, maps.trusted, maps.frame
    rows, columns = heights.shape[1:]
    left, low, step = frame[0], frame[1], frame[2]
    middle_x, middle_y = left + step * (columns - 1) / 2, low + step * (rows - 1) / 2
    half_x, half_y = step * (columns - 1) / 2, step * (rows - 1) / 2
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for n in range(len(places)):
        deepest, highest = 1e9, -1e9
        for row in range(rows):
            for column in range(columns):
                if trusted[n, row, column] > 0:
                    deepest = min(deepest, heights[n, row, column])
                    highest = max(highest, heights[n, row, column])
        if deepest > highest:
            continue
        bottom, top = deepest - before, highest + behind
        turn = turns[n]
        for axis in range(3):
            middle = (
                places[n, axis]
                + turn[axis, 0] * middle_x
                + turn[axis, 1] * middle_y
                + turn[axis, 2] * (bottom + top) / 2
            )
            half = (
                abs(turn[axis, 0]) * half_x
                + abs(turn[axis, 1]) * half_y
                + abs(turn[axis, 2]) * (top - bottom) / 2
            )
            first[axis] = max(0, math.ceil((middle - half - corner[axis]) / cell))
            last[axis] = min(total.shape[axis] - 1, math.floor((middle + half - corner[axis]) / cell))
        for i in range(first[0], last[0] + 1):
            x = corner[0] + cell * i - places[n, 0]
            for j in range(first[1], last[1] + 1):
                y = corner[1] + cell * j - places[n, 1]
                for k in range(first[2], last[2] + 1):
                    z = corner[2] + cell * k - places[n, 2]
                    u = (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z - left) / step
                    v = (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z - low) / step
                    if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
                        continue
                    column, row = min(int(u), columns - 2), min(int(v), rows - 2)
                    u, v = u - column, v - row
                    share = (1 - v) * (
                        (1 - u) * trusted[n, row, column] + u * trusted[n, row, column + 1]
                    ) + v * ((1 - u) * trusted[n, row + 1, column] + u * trusted[n, row + 1, column + 1])
                    if share < 0.5:
                        continue
                    height = (1 - v) * (
                        (1 - u) * heights[n, row, column] + u * heights[n, row, column + 1]
                    ) + v * ((1 - u) * heights[n, row + 1, column] + u * heights[n, row + 1, column + 1])
                    away = height - (turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z)
                    if -behind <= away <= before:
                        total[i, j, k] += share * away
                        weight[i, j, k] += share


@compiled()
def carve(
    free: Floats3D,
    corner: Reals1D,
    cell: float,
    places: Reals2D,
    turns: Reals3D,
    ends: Reals3D,
    frame: Reals1D,
    stroke: float,
) -> None:
    """Count how often the pad has passed each voxel: what it passed is free (the paper's No Contact, in space).

    free: (a, b, c) counts, changed in place. ends: (n, rows, columns) mm above the pad's plane up to which each ray was
    free; it came along z over `stroke` mm. The others: as in `merge`.
    """
    rows, columns = ends.shape[1:]
    at = np.empty(3, dtype=np.int64)
    for n in range(len(places)):
        turn = turns[n]
        for row in range(rows):
            for column in range(columns):
                x, y = frame[0] + frame[2] * column, frame[1] + frame[2] * row
                steps = int((ends[n, row, column] + stroke) / cell) + 1
                for step in range(steps):
                    z = ends[n, row, column] - cell * step
                    for axis in range(3):
                        p = places[n, axis] + turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
                        at[axis] = math.floor((p - corner[axis]) / cell + 0.5)
                    i, j, k = at[0], at[1], at[2]
                    if 0 <= i < free.shape[0] and 0 <= j < free.shape[1] and 0 <= k < free.shape[2]:
                        free[i, j, k] += 1


@compiled()
def settle(side: Int8s3D) -> None:
    """Let every UNKNOWN voxel be on the side of the nearest that is INSIDE or OUTSIDE, counted in steps along axes."""
    a, b, c = side.shape
    queue = np.empty((a * b * c, 3), dtype=np.int32)
    end = 0
    for i in range(a):
        for j in range(b):
            for k in range(c):
                if side[i, j, k] != UNKNOWN:
                    queue[end, 0], queue[end, 1], queue[end, 2] = i, j, k
                    end += 1
    at = 0
    while at < end:
        i, j, k = queue[at, 0], queue[at, 1], queue[at, 2]
        at += 1
        for way in range(6):
            step = 1 if way % 2 else -1
            p = i + step if way < 2 else i
            q = j + step if way // 2 == 1 else j
            r = k + step if way >= 4 else k
            if 0 <= p < a and 0 <= q < b and 0 <= r < c and side[p, q, r] == UNKNOWN:
                side[p, q, r] = side[i, j, k]
                queue[end, 0], queue[end, 1], queue[end, 2] = p, q, r
                end += 1


@compiled()
def redistance(distance: Floats3D, level: Floats3D, cell: float) -> None:
    """Turn values whose zeros are a surface into signed distances to it, mm (fast sweeping, Zhao 2005).

    level: (a, b, c), negative inside. distance: the same shape, filled here. cell: mm.
    """
    a, b, c = level.shape
    # Beside the surface: from where it cuts the edges to the neighbours.
    for i in range(a):
        for j in range(b):
            for k in range(c):
                here = level[i, j, k]
                inverse = 0.0
                for axis in range(3):
                    nearest = 2.0
                    for side in (-1, 1):
                        p = i + side if axis == 0 else i
                        q = j + side if axis == 1 else j
                        r = k + side if axis == 2 else k
                        if 0 <= p < a and 0 <= q < b and 0 <= r < c:
                            there = level[p, q, r]
                            if (here < 0) != (there < 0):
                                nearest = min(nearest, abs(here) / (abs(here) + abs(there) + 1e-12))
                    if nearest <= 1:
                        inverse += 1 / max(nearest, 1e-3) ** 2
                distance[i, j, k] = cell / math.sqrt(inverse) if inverse > 0 else 1e6
    for sweep in range(8):
        up_i, up_j, up_k = sweep & 1 == 0, sweep & 2 == 0, sweep & 4 == 0
        for ii in range(a):
            i = ii if up_i else a - 1 - ii
            for jj in range(b):
                j = jj if up_j else b - 1 - jj
                for kk in range(c):
                    k = kk if up_k else c - 1 - kk
                    now = float64(distance[i, j, k])
                    if now < cell:
                        continue
                    x = float64(min(distance[max(i - 1, 0), j, k], distance[min(i + 1, a - 1), j, k]))
                    y = float64(min(distance[i, max(j - 1, 0), k], distance[i, min(j + 1, b - 1), k]))
                    z = float64(min(distance[i, j, max(k - 1, 0)], distance[i, j, min(k + 1, c - 1)]))
                    if x > y:
                        x, y = y, x
                    if y > z:
                        y, z = z, y
                    if x > y:
                        x, y = y, x
                    new = x + cell
                    if new > y:
                        new = (x + y + math.sqrt(max(2 * cell**2 - (x - y) ** 2, 0.0))) / 2
                        if new > z:
                            sum_ = x + y + z
                            under = sum_**2 - 3 * (x**2 + y**2 + z**2 - cell**2)
                            new = (sum_ + math.sqrt(max(under, 0.0))) / 3
                    if new < now:
                        distance[i, j, k] = new
    for i in range(a):
        for j in range(b):
            for k in range(c):
                if level[i, j, k] < 0:
                    distance[i, j, k] = -distance[i, j, k]
