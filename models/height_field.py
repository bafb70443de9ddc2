"""Shapes with relief: a closed mesh, what of it can be seen from above, and the region that a pad feels first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.letter import FELT, rotational_order

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

# mm by which a flat face may be uneven; the single precision of .stl files keeps it.
FLATNESS = 1e-5
LEAST_RISE = 1e-4  # least z of a facet's unit normal; what is steeper is an upright side
HIDDEN = 1e-6  # share of a shape's shadow that may be covered twice and count as once
MOST_UNDERCUTS = 20_000  # facets that look down and hide others; to fill below 10,000 of them takes seconds
_LEVELS = 8  # depths at which outlines are compared to find the symmetry


class HeightField(NamedTuple):
    """What a pad can meet of a mesh, along z of some axes.

    facets: (m, 3 corners, 3) mm, [x, y, gap], the gap being the distance behind the foremost point, each facet where
    nothing hides it, ordered by `front`: (m,) mm, the least gap of each. height: mm from the foremost to the
    last point of the mesh.
    """

    facets: FloatArray
    front: FloatArray
    height: float


@dataclass(frozen=True, eq=False)
class Relief:
    """The closed mesh of a shape that is more than a raised outline.

    vertices: (n, 3) mm. triangles: (m, 3) indices, counter-clockwise seen from outside.
    """

    vertices: FloatArray
    triangles: NDArray[np.int64]

    @classmethod
    def of(cls, solid: Manifold, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> Relief:
        """Take the mesh of a solid (mm), moved by `shift`."""
        mesh = solid.to_mesh64()
        vertices = np.ascontiguousarray(mesh.vert_properties[:, :3] + np.asarray(shift))
        triangles = np.ascontiguousarray(mesh.tri_verts, dtype=np.int64)
        for array in (vertices, triangles):
            array.setflags(write=False)  # shapes are shared
        return cls(vertices, triangles)

    @cached_property
    def solid(self) -> Manifold:
        """Give the mesh as a manifold3d.Manifold, mm."""
        from manifold3d import Manifold, Mesh64

        return Manifold(Mesh64(self.vertices.copy(), self.triangles.astype(np.uint64)))

    @cached_property
    def hull(self) -> Relief | None:
        """Give the convex hull if the mesh is convex (within 1e-6 of its volume), else None."""
        hull = self.solid.hull()
        return Relief.of(hull) if hull.volume() - self.solid.volume() <= 1e-6 * hull.volume() else None

    @cached_property
    def normals(self) -> FloatArray:
        """Give each triangle's unit normal, (m, 3), pointing outwards; 0 for one without area."""
        corners = self.vertices[self.triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.sqrt(np.sum(normal**2, axis=1, keepdims=True))
        return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)

    def turned(self, rotation: FloatArray) -> Relief:
        """See the mesh in other axes, which are the columns of rotation (3, 3) in its own: x_mesh = rotation x."""
        return Relief(self.vertices @ rotation, self.triangles)

    @cached_property
    def seen_from_above(self) -> HeightField:
        """List what is seen from +z. Raises InputError if too many facets hide others."""
        corners, rise = self.vertices[self.triangles], self.normals[:, 2]
        low, high = float(self.vertices[:, 2].min()), float(self.vertices[:, 2].max())
        seen = corners[rise > LEAST_RISE]
        if self.hull is None:
            above = corners[rise < -LEAST_RISE]
            if (above[:, :, 2].max(axis=1) > seen[:, :, 2].min() + FLATNESS).any():
                seen = _uncovered(self.solid)
        seen[:, :, 2] = high - seen[:, :, 2]
        front = seen[:, :, 2].min(axis=1)
        order = np.argsort(front, kind="stable")
        return HeightField(np.ascontiguousarray(seen[order]), front[order], high - low)

    @cached_property
    def flat_depth(self) -> float:
        """Tell how far below the highest point the mesh is a flat face with upright sides, mm.

        Infinite if nothing else of it can be seen from above, 0 if the highest part is not flat.
        """
        field = self.seen_from_above
        lower = field.facets[:, :, 2].max(axis=1) > FLATNESS
        return float(field.front[lower].min()) if lower.any() else math.inf

    def footprint(self) -> CrossSection:
        """Give the region, mm, that a pad feels first, seen from above.

        It is the flat face if the sides are upright for FELT below it, else all that lies less than FELT behind the
        highest point.
        """
        top = float(self.vertices[:, 2].max())
        if self.flat_depth >= FELT:
            return self.solid.slice(top - FLATNESS)
        return self.solid.trim_by_plane((0.0, 0.0, 1.0), top - FELT).project()

    @cached_property
    def symmetry(self) -> int | float:
        """Find the order of the rotational symmetry about the z axis, of what lies less than FELT behind the top."""
        bottom, top = float(self.vertices[:, 2].min()), float(self.vertices[:, 2].max())
        depths = 0.99 * min(FELT, top - bottom) / 2.0 ** np.arange(_LEVELS)
        slices = [self.solid.slice(top - depth) for depth in depths]
        orders = [rotational_order(region.to_polygons()) for region in slices if not region.is_empty()]
        finite = [int(order) for order in orders if math.isfinite(order)]
        return math.gcd(*finite) if finite else math.inf

    def __getstate__(self) -> dict[str, object]:
        # Cached properties are left out: they can be computed again, and manifold3d's objects do not pickle.
        return {"vertices": self.vertices, "triangles": self.triangles}


def _uncovered(solid: Manifold) -> FloatArray:
    """List the facets of a solid that look up, each where nothing hides it: (m, 3, 3).

    What lies below the facets that look down is filled. Raises InputError if they are too many.
    """
    from manifold3d import Manifold, OpType

    mesh = Relief.of(solid)
    corners, rise = mesh.vertices[mesh.triangles], mesh.normals[:, 2]
    above, seen = corners[rise < -LEAST_RISE], corners[rise > LEAST_RISE]
    # Each facet that looks up is seen whole if together they cover no more than their shadow.
    shadow, sides = solid.project().area(), seen[:, 1:, :2] - seen[:, :1, :2]
    if np.linalg.det(sides).sum() / 2 <= shadow * (1 + HIDDEN):
        return seen
    bottom = float(corners[:, :, 2].min())
    above = above[above[:, :, 2].max(axis=1) > bottom + FLATNESS]
    if len(above) > MOST_UNDERCUTS:
        raise InputError(
            f"{len(above):,} of the mesh's facets look down and may hide others, the most is {MOST_UNDERCUTS:,}: "
            "simplify the mesh"
        )
    # Prisms that reach a little into the solid and out of its bottom: faces that just touch would not merge.
    feet = above.copy()
    feet[:, :, 2] = bottom - 1
    above[:, :, 2] += FLATNESS
    prisms = [Manifold.hull_points(corners) for corners in np.concatenate([above, feet], axis=1)]
    mesh = Relief.of(Manifold.batch_boolean([solid, *prisms], OpType.Add))
    return mesh.vertices[mesh.triangles][mesh.normals[:, 2] > LEAST_RISE]
