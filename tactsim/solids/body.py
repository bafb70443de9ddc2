"""`Solid`, a body in space that a pad touches from any side: its mesh, mass and symmetry."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.letter import DENSITY
from tactsim.solids.symmetry import SpaceSymmetry, find_symmetry

if TYPE_CHECKING:
    from manifold3d import Manifold


import logging
from pathlib import Path
from typing import TYPE_CHECKING

from tactsim.core.errors import short
from tactsim.core.scan import is_label
from tactsim.models.shapes import ENDINGS, read_file
from tactsim.solids.symmetry import crossings

if TYPE_CHECKING:
    from manifold3d import Manifold


LARGEST_SOLID = 300.0  # mm, the most that a solid may measure along an axis: a household object
LEAST_SOLID = 5.0  # mm, the least that it measures along its longest: a pad is 11 mm wide
MOST_TRIANGLES = 20_000
SLIVER = 1e-5  # mm: corners nearer than this are made one, so that no face is without area


@dataclass(frozen=True, eq=False)
class Solid:
    """A body that rests fixed while a pad touches it. The origin of its frame is the centre of mass.

    name: what a scan calls it. vertices: (v, 3) mm. faces: (f, 3) numbers of vertices, counter-clockwise seen from
    outside; the mesh is watertight. Make one with `solid`, `read_solid_file` or `solid_of`, which see to that.

    Solids are equal when their names and digests are. They can be pickled.
    """

    name: str
    vertices: FloatArray
    faces: NDArray[np.int64]

    @cached_property
    def manifold(self) -> Manifold:
        """Give the mesh as a manifold3d.Manifold, mm."""
        from manifold3d import Manifold, Mesh64

        return Manifold(Mesh64(self.vertices.copy(), self.faces.astype(np.uint64)))

    @cached_property
    def corners(self) -> FloatArray:
        """Give each face's corners, (f, 3 corners, 3) mm."""
        return self.vertices[self.faces]

    @cached_property
    def areas(self) -> FloatArray:
        """Give each face's area, (f,) mm^2."""
        return np.asarray(np.linalg.norm(self._crosses, axis=1) / 2, dtype=float)

    @cached_property
    def normals(self) -> FloatArray:
        """Give each face's outward unit normal, (f, 3)."""
        return self._crosses / np.maximum(2 * self.areas, 1e-300)[:, None]

    @cached_property
    def _crosses(self) -> FloatArray:
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a)

    @cached_property
    def volume(self) -> float:
        """Volume, mm^3."""
        return volume_and_moments(self.corners)[0]

    @property
    def mass(self) -> float:
        """Mass in kg at the assumed density of the letters, 1,050 kg / m^3."""
        return DENSITY * self.volume

    @cached_property
    def inertia(self) -> FloatArray:
        """Give the inertia tensor about the centre of mass in the solid's axes, (3, 3) kg mm^2."""
        second = volume_and_moments(self.corners)[2]
        return DENSITY * (np.trace(second) * np.eye(3) - second)

    @cached_property
    def radius(self) -> float:
        """Give the largest distance of a point from the centre of mass, mm."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def symmetry(self) -> SpaceSymmetry:
        """Find the turns about the origin that leave the solid as it is.

        Raises InputError for a ball, which every turn leaves as it is.
        """
        try:
            return find_symmetry(self.corners)
        except InputError as error:
            raise InputError(f"{self.name!r}: {error}") from error

    @cached_property
    def digest(self) -> str:
        """Hash the mesh, not the name: 64 hex digits. Readings can be cached under it."""
        content = hashlib.sha256(np.array([len(self.vertices), len(self.faces)], dtype="<i8").tobytes())
        content.update(np.ascontiguousarray(self.vertices, dtype="<f8").tobytes())
        content.update(np.ascontiguousarray(self.faces, dtype="<i8").tobytes())
        return content.hexdigest()

    def sample_surface(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw points even in area over the surface: points (count, 3) mm and outward unit normals (count, 3).

        Each face gets its share of the points to within one.
        """
        ends = np.cumsum(self.areas)
        along = (np.arange(count) + rng.random(count)) / count * ends[-1]
        face = rng.permutation(np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1))
        u, v = rng.random((2, count))
        # The half of the parallelogram beyond the triangle is folded back into it.
        outside = u + v > 1
        u, v = np.where(outside, 1 - u, u)[:, None], np.where(outside, 1 - v, v)[:, None]
        a, b, c = np.moveaxis(self.corners[face], 1, 0)
        return a + u * (b - a) + v * (c - a), self.normals[face]

    def facts(self) -> dict[str, Any]:
        """Tell what `SpaceScan.meta["objects"]` says of an object: rotations, axis, radius mm, digest."""
        axis = self.symmetry.axis
        return {
            "rotations": self.symmetry.rotations.tolist(),
            "axis": None if axis is None else axis.tolist(),
            "radius": self.radius,
            "digest": self.digest,
        }

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Solid) and (self.name, self.digest) == (other.name, other.digest)

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    def __getstate__(self) -> dict[str, object]:
        # Cached properties are left out: they can be computed again, and manifold3d's objects do not pickle.
        return {field.name: getattr(self, field.name) for field in fields(self)}


def solid_of(name: str, shape: Manifold) -> Solid:
    """Make a Solid of a manifold3d.Manifold (mm), moved so that its centre of mass is the origin.

    Raises InputError if the shape is empty, damaged or inside out, if its longest side is not LEAST_SOLID to
    LARGEST_SOLID, or if it has more than MOST_TRIANGLES faces.
    """
    from manifold3d import Error

    if shape.status() != Error.NoError or shape.is_empty() or shape.volume() <= 0:
        raise InputError(f"{name!r}: the solid is empty or damaged ({shape.status().name})")
    box = np.reshape(shape.bounding_box(), (2, 3))
    size = box[1] - box[0]
    if not LEAST_SOLID <= size.max() <= LARGEST_SOLID:
        raise InputError(
            f"{name!r}: the solid measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} mm; its longest side must "
            f"measure {LEAST_SOLID:g} to {LARGEST_SOLID:g} mm: scale it"
        )
    if shape.num_tri() > MOST_TRIANGLES:
        raise InputError(
            f"{name!r}: the solid has {shape.num_tri():,} faces, the most is {MOST_TRIANGLES:,}: simplify it"
        )
    mesh = shape.simplify(SLIVER).to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=float)
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    # The origin is moved near first: far from it the moments lose digits.
    vertices -= vertices.mean(axis=0)
    volume, first, _ = volume_and_moments(vertices[faces])
    vertices -= first / volume
    for array in (vertices, faces):
        array.setflags(write=False)  # solids are cached and shared
    return Solid(name, vertices, faces)


def mirrored(solid: Solid, name: str | None = None) -> Solid:
    """Mirror a solid at its yz plane; its name becomes `name`, by default "mirrored " and its own."""
    return solid_of(
        f"mirrored {solid.name}" if name is None else name, solid.manifold.mirror((1.0, 0.0, 0.0))
    )


def volume_and_moments(corners: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Integrate 1, x and x x^T over the inside of a closed mesh: mm^3, (3,) mm^4, (3, 3) mm^5.

    corners: (f, 3 corners, 3) mm, counter-clockwise seen from outside. Each face makes a signed tetrahedron with the
    origin, over which the integrals are V, V s / 4 and V (s s^T + sum p p^T) / 20, s the sum of its corners p.
    """
    signed = np.linalg.det(corners) / 6
    sums = corners.sum(axis=1)
    second = np.einsum("f,fi,fj->ij", signed, sums, sums)
    second += np.einsum("f,fki,fkj->ij", signed, corners, corners)
    return float(signed.sum()), signed @ sums / 4, second / 20


COARSEST = 0.01  # share of a solid's longest side by which thinning out may move its surface


def read_solid_file(path: str | Path, name: str | None = None) -> Solid:
    """Read a solid to touch from a mesh file: mm, z up; in .glb and .gltf metres, y up.

    name: what a scan calls it, by default the file's name without its ending. The solid keeps its axes; the origin
    becomes the centre of mass. Bodies that overlap are united.

    A mesh of more than `MOST_TRIANGLES` faces is thinned out, which is logged.

    Raises InputError if the file cannot be read or is damaged, if the mesh is open or cuts through itself, or if it
    measures more than `LARGEST_SOLID` mm along an axis.
    """
    from tactsim.models.mesh import read_solid

    path = Path(path)
    name = path.stem if name is None else name
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise InputError(f"{path}: solids are read from {', '.join(ENDINGS)} files, not {suffix or 'this'}")
    content = read_file(path, "solid")
    if not is_label(name):
        raise InputError(f"{short(name)} is no name for a solid; give one of 1 to 100 printable characters")
    try:
        shape, remark = _thinned(read_solid(content, suffix[1:]))
        solid = solid_of(name, shape)
        crossing = crossings(solid.corners)
        if len(crossing):
            raise InputError(
                f"the mesh cuts through itself: {len(crossing):,} pairs of its faces cross; repair it, for example in "
                "MeshLab or Blender"
            )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if remark:
        logging.getLogger(__name__).warning("%s: %s", path, remark)
    return solid


def _thinned(shape: Manifold) -> tuple[Manifold, str]:
    """Thin a mesh out to MOST_TRIANGLES faces, as little as will do, and say so; finer ones stay as they are."""
    thin, tolerance = shape, 3e-5 * float(np.ptp(np.reshape(shape.bounding_box(), (2, 3)), axis=0).max())
    coarsest = tolerance / 3e-5 * COARSEST
    while thin.num_tri() > MOST_TRIANGLES and tolerance < coarsest:
        tolerance *= 2
        thin = shape.simplify(tolerance)
    if thin is shape:
        return shape, ""
    return thin, (
        f"its {shape.num_tri():,} faces are thinned out to {thin.num_tri():,}; "
        f"that moves its surface by {tolerance:.2g} mm at most"
    )
