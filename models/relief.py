"""Shapes with relief: a closed mesh, what of it can be seen from above, and the region that a pad feels first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.symmetry import rotational_order

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

FELT = (
    1.0  # mm behind the foremost point that the footprint includes: the thickness of the default pad's layer
)
FLATNESS = (
    1e-5  # mm by which a flat face may be uneven: single precision, in which .stl files are written, keeps it
)
STEEPEST = 1e-4  # least rise of a facet's normal; what is steeper is an upright side
MOST_UNDERCUTS = (
    20_000  # facets that look down and lie over others: filling below them takes a second per 10,000
)
_LEVELS = 8  # depths at which outlines are compared to find the symmetry


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

    def seen_along(self, rotation: FloatArray) -> FloatArray:
        """List the facets that are seen from +z once the mesh is turned, each where nothing hides it.

        rotation: (3, 3), whose columns are the axes in question in the mesh's own frame: x_mesh = rotation x. Returns
        (facets, 3 corners, 3) mm in those axes.
        Raises InputError if too many facets hide others.
        """
        vertices = self.vertices @ rotation
        corners = vertices[self.triangles]
        rise = _rise(corners)
        seen = corners[rise > STEEPEST]
        above = corners[rise < -STEEPEST]
        if len(above) and self.hull is None and _overhangs(above, seen):
            from manifold3d import Manifold, Mesh64

            turned = Manifold(Mesh64(np.ascontiguousarray(vertices), self.triangles.astype(np.uint64)))
            filled = Relief.of(_fill_undercuts(turned, above))
            corners = filled.vertices[filled.triangles]
            seen = corners[_rise(corners) > STEEPEST]
        return np.ascontiguousarray(seen)

    @cached_property
    def flat_depth(self) -> float:
        """Tell how far below the highest point the mesh is a flat face with upright sides, mm.

        Infinite if nothing else of it can be seen from above, 0 if the highest part is not flat.
        """
        top = self.vertices[:, 2].max()
        seen = self.seen_along(np.eye(3))
        lower = seen[:, :, 2].min(axis=1) < top - FLATNESS
        return float(top - seen[lower][:, :, 2].max()) if lower.any() else math.inf

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
        depths = min(FELT, top - bottom) * (np.arange(_LEVELS) + 0.5) / _LEVELS
        slices = [self.solid.slice(top - depth) for depth in depths]
        orders = [rotational_order(region.to_polygons()) for region in slices if not region.is_empty()]
        finite = [int(order) for order in orders if math.isfinite(order)]
        return math.gcd(*finite) if finite else math.inf


def _rise(corners: FloatArray) -> FloatArray:
    """Give the z of each facet's unit normal; 0 for one without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.sqrt(np.sum(normal**2, axis=1))
    return np.divide(normal[:, 2], length, out=np.zeros(len(corners)), where=length > 0)


def _overhangs(above: FloatArray, seen: FloatArray) -> bool:
    """Tell whether a facet that looks down may lie over one that looks up (by their bounding boxes)."""
    order = np.argsort(seen[:, :, 2].min(axis=1))
    seen = seen[order]
    low, high = seen[:, :, :2].min(axis=1), seen[:, :, :2].max(axis=1)
    lowest = seen[:, :, 2].min(axis=1)
    for facet in above[above[:, :, 2].max(axis=1) > lowest[0] + FLATNESS]:
        count = int(np.searchsorted(lowest, facet[:, 2].max() - FLATNESS))
        left, right = facet[:, :2].min(axis=0), facet[:, :2].max(axis=0)
        if np.any((low[:count] < right).all(axis=1) & (high[:count] > left).all(axis=1)):
            return True
    return False


def _fill_undercuts(solid: Manifold, above: FloatArray) -> Manifold:
    """Fill what lies below the facets that look down, so that every facet that looks up can be seen."""
    from manifold3d import Manifold, OpType

    if len(above) > MOST_UNDERCUTS:
        raise InputError(
            f"{len(above):,} of the mesh's facets look down and may hide others, the most is {MOST_UNDERCUTS:,}: "
            "simplify the mesh"
        )
    bottom = float(solid.bounding_box()[2])
    hanging = above[above[:, :, 2].max(axis=1) > bottom + FLATNESS]
    prisms = []
    for facet in hanging:
        foot = facet.copy()
        foot[:, 2] = bottom
        prisms.append(Manifold.hull_points(np.concatenate([facet, foot])))
    return Manifold.batch_boolean([solid, *prisms], OpType.Add)
