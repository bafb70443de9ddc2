"""Cut a polygon with holes into few convex pieces that tile it.

MuJoCo collides convex bodies only, and each piece costs time in every press. The polygon is cut into triangles, and
then cuts are taken back, the longest first, wherever both corners stay convex (Hertel and Mehlhorn 1983). That leaves
at most two cuts at a reflex corner, so r reflex corners make at most 2 r + 1 pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tactsim.core.poses import FloatArray

STRAIGHT = 1e-8  # mm: corners nearer than this to the line between their neighbours are left out
_CONVEX = 1e-6  # mm by which a corner may lie inside the line between its neighbours and count as convex
_SLIVER = 1e-6  # mm: thinner pieces are left out


def convex_pieces(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Split the region inside `contours` into convex polygons without overlap or gap.

    contours: (k, 2) mm each, outer ones counter-clockwise and holes clockwise, nowhere nearer to each other or to
    themselves than 1e-5 mm. Returns (k, 2) mm arrays, counter-clockwise, without straight corners.
    """
    from manifold3d import triangulate

    outlines = _with_feet(contours)
    corners = np.concatenate(outlines)
    pieces = dict(enumerate(triangulate(outlines).tolist()))
    owner = {edge: index for index, piece in pieces.items() for edge in _edges(piece)}
    cuts = [(a, b) for a, b in owner if a < b and (b, a) in owner]
    for a, b in sorted(cuts, key=lambda cut: -np.hypot(*(corners[cut[0]] - corners[cut[1]]))):
        left, right = owner[a, b], owner[b, a]
        # From b round the left piece to a, and on round the right one.
        joined = [*_from(b, pieces[left]), *_from(a, pieces[right])[1:-1]]
        if left != right and all(_is_convex(corners, joined, corner) for corner in (a, b)):
            del pieces[right]
            pieces[left] = joined
            owner |= dict.fromkeys(_edges(joined), left)
    found = [_without_straight_corners(corners[piece]) for piece in pieces.values()]
    return [outline for outline in found if not _is_sliver(outline)]


def _with_feet(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Add the points where an edge that is extended beyond a reflex corner first meets another, at a right angle.

    A cut that ends there keeps right angles right: an E becomes four rectangles.
    """
    starts = np.concatenate(list(contours)).astype(float)
    along = np.concatenate([np.roll(contour, -1, axis=0) - contour for contour in contours])
    before = np.concatenate([np.roll(contour, 1, axis=0) - contour for contour in contours])
    feet: list[list[tuple[float, FloatArray]]] = [[] for _ in starts]
    for corner in np.flatnonzero(_cross(along, before) < 0):
        for ray in (-along[corner], -before[corner]):
            away, slope = starts - starts[corner], _cross(ray, along)
            slope = np.where(np.abs(slope) > 1e-12, slope, np.nan)
            reach, share = _cross(away, along) / slope, _cross(away, ray) / slope
            met = (reach > 1e-9) & (share >= 0) & (share <= 1)
            hit = int(np.argmin(np.where(met, reach, np.inf)))
            square = abs(ray @ along[hit]) <= 1e-9 * np.hypot(*ray) * np.hypot(*along[hit])
            if met[hit] and square and 1e-6 < share[hit] < 1 - 1e-6:
                feet[hit].append((float(share[hit]), starts[hit] + share[hit] * along[hit]))
    filled = [
        np.array([start, *(point for _, point in sorted(own, key=lambda foot: foot[0]))])
        for start, own in zip(starts, feet, strict=True)
    ]
    ends = np.cumsum([0, *map(len, contours)])
    return [np.concatenate(filled[start:end]) for start, end in pairwise(ends)]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _edges(piece: list[int]) -> list[tuple[int, int]]:
    return list(zip(piece, piece[1:] + piece[:1], strict=True))


def _from(corner: int, piece: list[int]) -> list[int]:
    place = piece.index(corner)
    return piece[place:] + piece[:place]


def _is_convex(corners: FloatArray, piece: list[int], corner: int) -> bool:
    """Tell whether a piece turns left at a corner or, within _CONVEX, goes straight on."""
    place = piece.index(corner)
    before, here, after = corners[[piece[place - 1], corner, piece[(place + 1) % len(piece)]]]
    (ux, uy), (vx, vy) = here - before, after - here
    return bool(ux * vy - uy * vx >= -_CONVEX * np.hypot(*(after - before)))


def _without_straight_corners(outline: FloatArray) -> FloatArray:
    """Leave out the corners that lie within STRAIGHT of the line between their neighbours."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    return outline[np.abs(_cross(before, after)) > STRAIGHT * np.hypot(*(before + after).T)]


def _is_sliver(outline: FloatArray) -> bool:
    """Tell whether a convex outline is thinner than _SLIVER."""
    x, y = outline.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return 2 * area < _SLIVER * float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())
