"""Round the edge of a pressed face: the mitred inset of an outline, its convex strips and its solid.

The edge's profile is a quarter circle of radius r: at the distance d < r inside the outline the face
lies r - sqrt(r^2 - (r - d)^2) below its plane. Distances are to the lines of the outline's edges and
corners are mitred, so each edge of the outline has one strip and every strip is convex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from manifold3d import Manifold

CHORD_ERROR = 0.005  # mm, of the profile's chords


def inset(contours: Sequence[FloatArray], distance: float) -> list[FloatArray]:
    """Move every edge of a region inwards by `distance` (mm); corners are mitred and keep their order.

    contours: (k, 2) mm each, the region on their left. Raises InputError if the distance is so large that an
    edge would vanish or the region would lose a piece of its outline.
    """
    from manifold3d import CrossSection

    moved = []
    for contour in contours:
        along = np.roll(contour, -1, axis=0) - contour
        along /= np.hypot(*along.T)[:, None]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        before = np.roll(normal, 1, axis=0)
        bend = 1 + np.sum(normal * before, axis=1, keepdims=True)
        corner = contour + distance * (normal + before) / np.maximum(bend, 1e-12)
        if np.any(np.sum((np.roll(corner, -1, axis=0) - corner) * along, axis=1) <= 0):
            raise InputError(f"rounding by {distance:g} mm is more than the shortest edges carry; take less")
        moved.append(corner)
    union = CrossSection(moved)
    signed = sum(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 for x, y in map(np.transpose, moved))
    if union.num_contour() != len(moved) or abs(union.area() - signed) > 1e-6:
        raise InputError(f"rounding by {distance:g} mm is more than the strokes carry; take less")
    return moved


def profile(radius: float) -> FloatArray:
    """List the quarter circle's corners as (n, 2) mm, inset and depth below the face, from side to face."""
    count = math.ceil(math.pi / 4 / math.acos(1 - min(CHORD_ERROR / radius, 0.25)))
    angle = np.linspace(0, math.pi / 2, count + 1)
    return radius * np.stack([1 - np.cos(angle), 1 - np.sin(angle)], axis=1)


def strips(
    contours: Sequence[FloatArray], radius: float, height: float
) -> list[tuple[FloatArray, FloatArray]]:
    """List the convex strip along each edge: its outline in plan (4, 2) mm and its corners (m, 3) mm.

    Raises InputError as `inset` does.
    """
    steps = profile(radius)
    found = []
    for outer, inner in zip(contours, inset(contours, radius), strict=True):
        outlines = np.stack([outer, np.roll(outer, -1, axis=0), np.roll(inner, -1, axis=0), inner], axis=1)
        for outline in outlines:
            near, far = outline[:2], outline[[3, 2]]
            base = np.column_stack([outline, np.zeros(4)])
            rounded = [
                np.column_stack([near + (far - near) * (step / radius), np.full(2, height - depth)])
                for step, depth in steps
            ]
            found.append((outline, np.concatenate([base, *rounded])))
    return found


def rounded_solid(contours: Sequence[FloatArray], radius: float, height: float) -> Manifold:
    """Build the whole solid, from z = 0 to the face at z = height, as one watertight mesh (mm)."""
    from manifold3d import Manifold, Mesh64, triangulate

    layers = [(list(contours), 0.0)]
    layers += [
        (inset(contours, step) if step else list(contours), height - depth) for step, depth in profile(radius)
    ]
    corners = [np.column_stack([np.concatenate(plan), np.full(sum(map(len, plan)), z)]) for plan, z in layers]
    count = len(corners[0])
    sizes = [len(contour) for contour in contours]
    starts = np.repeat(np.cumsum([0, *sizes[:-1]]), sizes)
    here = np.arange(count)
    following = starts + (here - starts + 1) % np.repeat(sizes, sizes)
    walls = [
        np.concatenate([
            np.stack([here, following, following + count], axis=1),
            np.stack([here, following + count, here + count], axis=1),
        ]) + level * count
        for level in range(len(layers) - 1)
    ]  # fmt: skip
    bottom = triangulate(layers[0][0])[:, ::-1]
    top = triangulate(layers[-1][0]) + (len(layers) - 1) * count
    triangles = np.concatenate([bottom, top, *walls]).astype(np.uint64)
    return Manifold(Mesh64(np.ascontiguousarray(np.concatenate(corners)), triangles))
