"""Signed distances to a surface on a sparse voxel grid, and where a ray meets that surface first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64
from numba.extending import register_jitable

from tactsim.core.compiling import Floats, Floats2D, Floats3D, Int32s3D, Reals, Reals1D, compiled

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
