"""Signed distances to a surface on voxels: merged of what touches felt, looked up, and where a ray meets it first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import float64
from numba.extending import register_jitable

from tactsim.core.compiling import (
    Floats,
    Floats2D,
    Floats3D,
    Int8s3D,
    Int32s3D,
    Reals,
    Reals1D,
    Reals2D,
    Reals3D,
    compiled,
)

BLOCK = 8  # cells along a block's side; it holds one node more, so that neighbours share their border
_SHIFT, _INSIDE, _SIDE, _NEXT = np.uint32(3), np.uint32(BLOCK - 1), np.uint32(BLOCK + 1), np.uint32(1)
_LONGEST = 64  # steps of a ray; at the border of far blocks it may creep


class Voxels(NamedTuple):
    """Signed distances mm at the nodes of a cubic grid, negative inside; only blocks near the surface hold nodes.

    corner: (3,) mm, the first node. cell: mm. block: (a, b, c) which row of `nodes` a block has, or -1. nodes: (blocks
    held, 9 * 9 * 9) z fastest. far: (a, b, c) for a block without nodes a distance that no place in it is nearer than,
    with its sign. margin: mm; no surface is nearer than that to the border of the grid.
    """

    corner: Reals1D
    cell: float
    block: Int32s3D
    nodes: Floats2D
    far: Floats3D
    margin: float


def sparse(corner: Reals, cell: float, distance: Floats, band: float) -> Voxels:
    """Keep of a dense grid of signed distances the blocks that come as near to the surface as `band` mm.

    corner: (3,) mm of the first node. distance: (a, b, c) mm at the nodes, positive at the grid's border.
    """
    blocks = [-(-(count - 1) // BLOCK) for count in distance.shape]
    wide = [(0, BLOCK * count + 1 - have) for count, have in zip(blocks, distance.shape, strict=True)]
    padded = np.pad(distance, wide, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (BLOCK + 1,) * 3)[::BLOCK, ::BLOCK, ::BLOCK]
    low, high = windows.min(axis=(3, 4, 5)), windows.max(axis=(3, 4, 5))
    # Between nodes the distance changes by at most half the diagonal of a cell.
    slack = np.float32(cell * np.sqrt(3) / 2)
    near = (low < band) & (high > -band)
    index = np.full(near.shape, -1, dtype=np.int32)
    index[near] = np.arange(np.count_nonzero(near))
    far = np.where(low > 0, np.maximum(low - slack, cell), np.minimum(high + slack, -cell)).astype(np.float32)
    nodes = np.ascontiguousarray(windows[near].reshape(-1, (BLOCK + 1) ** 3), dtype=np.float32)
    rim = min(
        float(side.min()) for axis in range(3) for side in (distance.take(0, axis), distance.take(-1, axis))
    )
    return Voxels(
        np.array(corner, dtype=float),
        float(cell),
        index,
        nodes,
        np.ascontiguousarray(far),
        max(rim - cell, 0.0),
    )


# Written into its callers: a call counts references to the arrays, which takes longer than the look-up.
@register_jitable(inline="always")
def distance_at(voxels: Voxels, x: float, y: float, z: float) -> float:
    """Interpolate the signed distance at a place, mm; far from the surface, give a bound that it is not nearer than."""
    per = 1 / voxels.cell
    u, v, w = (x - voxels.corner[0]) * per, (y - voxels.corner[1]) * per, (z - voxels.corner[2]) * per
    wide, deep, tall = voxels.block.shape
    if not (0.0 <= u < wide * BLOCK and 0.0 <= v < deep * BLOCK and 0.0 <= w < tall * BLOCK):
        du = max(max(-u, u - wide * BLOCK), 0.0)
        dv = max(max(-v, v - deep * BLOCK), 0.0)
        dw = max(max(-w, w - tall * BLOCK), 0.0)
        return voxels.cell * np.sqrt(du * du + dv * dv + dw * dw) + voxels.margin
    # Unsigned numbers need no check for a count from the end.
    i, j, k = np.uint32(u), np.uint32(v), np.uint32(w)
    a, b, c = i >> _SHIFT, j >> _SHIFT, k >> _SHIFT
    which = voxels.block[a, b, c]
    if which < 0:
        return float64(voxels.far[a, b, c])
    u, v, w = u - i, v - j, w - k
    at = ((i & _INSIDE) * _SIDE + (j & _INSIDE)) * _SIDE + (k & _INSIDE)
    nodes = voxels.nodes[np.uint32(which)]
    low = (1 - v) * ((1 - w) * nodes[at] + w * nodes[at + _NEXT]) + v * (
        (1 - w) * nodes[at + _SIDE] + w * nodes[at + _SIDE + _NEXT]
    )
    at += _SIDE * _SIDE
    high = (1 - v) * ((1 - w) * nodes[at] + w * nodes[at + _NEXT]) + v * (
        (1 - w) * nodes[at + _SIDE] + w * nodes[at + _SIDE + _NEXT]
    )
    return (1 - u) * low + u * high


@register_jitable
def slope_at(voxels: Voxels, x: float, y: float, z: float, slope: Reals) -> None:
    """Write how the signed distance changes along each axis (3,) at a place; 0 far from the surface."""
    slope[:] = 0.0
    per = 1 / voxels.cell
    u, v, w = (x - voxels.corner[0]) * per, (y - voxels.corner[1]) * per, (z - voxels.corner[2]) * per
    wide, deep, tall = voxels.block.shape
    if not (0.0 <= u < wide * BLOCK and 0.0 <= v < deep * BLOCK and 0.0 <= w < tall * BLOCK):
        du = max(u - wide * BLOCK, 0.0) + min(u, 0.0)
        dv = max(v - deep * BLOCK, 0.0) + min(v, 0.0)
        dw = max(w - tall * BLOCK, 0.0) + min(w, 0.0)
        away = np.sqrt(du * du + dv * dv + dw * dw)
        if away > 0:
            slope[0], slope[1], slope[2] = du / away, dv / away, dw / away
        return
    i, j, k = np.uint32(u), np.uint32(v), np.uint32(w)
    which = voxels.block[i >> _SHIFT, j >> _SHIFT, k >> _SHIFT]
    if which < 0:
        return
    u, v, w = u - i, v - j, w - k
    at = ((i & _INSIDE) * _SIDE + (j & _INSIDE)) * _SIDE + (k & _INSIDE)
    nodes = voxels.nodes[np.uint32(which)]
    a, b = nodes[at], nodes[at + _NEXT]
    c, d = nodes[at + _SIDE], nodes[at + _SIDE + _NEXT]
    at += _SIDE * _SIDE
    e, f = nodes[at], nodes[at + _NEXT]
    g, h = nodes[at + _SIDE], nodes[at + _SIDE + _NEXT]
    ab, cd, ef, gh = a + w * (b - a), c + w * (d - c), e + w * (f - e), g + w * (h - g)
    slope[0] = per * ((1 - v) * (ef - ab) + v * (gh - cd))
    slope[1] = per * ((1 - u) * (cd - ab) + u * (gh - ef))
    slope[2] = per * ((1 - u) * ((1 - v) * (b - a) + v * (d - c)) + u * ((1 - v) * (f - e) + v * (h - g)))


@compiled(called_from_python=False)
def first_hit(
    voxels: Voxels, x: float, y: float, z: float, dx: float, dy: float, dz: float, begin: float, end: float
) -> float:
    """Give how far a ray goes before it meets the surface, mm in [begin, end]: `end` if it does not.

    The ray starts at (x, y, z) along the unit vector (dx, dy, dz); only its part from `begin` on is looked at. It walks
    as far as the distance allows (sphere tracing, Hart 1996) and ends with a secant.
    """
    at = before = begin
    value = last = distance_at(voxels, x + at * dx, y + at * dy, z + at * dz)
    if value <= 0:
        return begin
    least = 0.3 * voxels.cell
    for _ in range(_LONGEST):
        before, last = at, value
        at += max(value, least)
        if at >= end:
            at = end
        value = distance_at(voxels, x + at * dx, y + at * dy, z + at * dz)
        if value <= 0:
            return at - value / (value - last) * (at - before)
        if at == end:
            return end
    return at


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
