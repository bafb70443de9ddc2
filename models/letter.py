"""`Letter`, a shape to press, with its moments and its rotational symmetry."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError, unknown
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

    from tactsim.models.height_field import Relief
    from tactsim.models.parts import ConvexPart

HEIGHT = 4.0  # mm, assumed: "a few mm high"
LARGEST_HEIGHT = 100.0  # mm
# mm behind the foremost point that the footprint of a shape with relief includes: the thickness of the default layer.
FELT = 1.0
DENSITY = 1.05e-6  # kg / mm^3, assumed: ABS plastic, 1,050 kg / m^3


@dataclass(frozen=True, eq=False)
class Letter:
    """A raised letter or another shape. It stands on z = 0; its foremost point or face, at z = height, faces +z.

    The object frame has its origin at the footprint's centre of area. The pad sees the letter as one reads it: x to
    the right, y up, z towards the pad. A sensor pose [x, y, theta] in this frame turns and shifts the pad's own
    x and y, so nothing is mirrored.

    name: what a scan calls it. contours: (k, 2) mm each, the footprint: outer outlines counter-clockwise,
    holes clockwise. height: thickness, mm. rounding: radius (mm) of the pressed face's edge, 0 for a sharp
    one. The footprint is that of the whole letter; the flat of a rounded face is smaller by the radius.
    relief: the mesh of a shape that is more than its footprint raised, in the object frame; its footprint is
    the region that lies less than FELT mm behind the foremost point.

    Letters are equal when their names and digests are. They can be pickled.
    """

    name: str
    contours: tuple[FloatArray, ...]
    height: float = HEIGHT
    rounding: float = 0.0
    relief: Relief | None = None

    @cached_property
    def footprint(self) -> CrossSection:
        """Give the face's region in plan as a manifold3d.CrossSection, mm, centre of area at 0."""
        from manifold3d import CrossSection

        return CrossSection(list(self.contours))

    @cached_property
    def solid(self) -> Manifold:
        """Give the solid as a manifold3d.Manifold, mm, from z = 0 to the pressed face at z = height."""
        if self.relief is not None:
            return self.relief.solid
        if self.rounding:
            from tactsim.models.parts import rounded_solid

            return rounded_solid(self.contours, self.rounding, self.height)
        return self.footprint.extrude(self.height)

    @cached_property
    def parts(self) -> tuple[ConvexPart, ...]:
        """Cut the letter into convex parts that tile it without overlap, as `parts.parts_of` does."""
        from tactsim.models.parts import parts_of

        return parts_of(self)

    @cached_property
    def symmetry(self) -> int | float:
        """Find the order of the rotational symmetry: 1, 2, ... or math.inf for a disc, ring or dome.

        With relief, what lies less than FELT mm behind the foremost point is looked at.
        """
        if self.relief is not None:
            return self.relief.symmetry
        return rotational_order(self.contours)

    @property
    def flat_depth(self) -> float:
        """Tell how far below its foremost point the letter is a flat face with upright sides, mm.

        Infinite if nothing else of it can be seen from above. A press that sinks in by less feels the face alone.
        """
        if self.relief is not None:
            return self.relief.flat_depth
        return 0.0 if self.rounding else math.inf

    @cached_property
    def area(self) -> float:
        """Area of the footprint, mm^2."""
        return float(_moments(self.contours)[0])

    @cached_property
    def inertia_over_mass(self) -> float:
        """Second moment of the footprint about its centre of area, per area, mm^2 (the paper's [24])."""
        area, _, second = _moments(self.contours)
        return float(np.trace(second) / area)

    @cached_property
    def radius(self) -> float:
        """Give the largest distance of a point of the footprint from the centre of area, mm."""
        return float(max(np.max(np.hypot(*contour.T)) for contour in self.contours))

    @cached_property
    def volume(self) -> float:
        """Volume of the solid, mm^3."""
        return float(self.solid.volume())

    @property
    def mass(self) -> float:
        """Mass in kg at the assumed DENSITY."""
        return DENSITY * self.volume

    @cached_property
    def digest(self) -> str:
        """Hash what is pressed: footprint, height, rounding and mesh, not the name. 64 hex digits.

        Readings can be cached under it.
        """
        mesh = () if self.relief is None else (self.relief.vertices, self.relief.triangles.astype(float))
        content = hashlib.sha256(np.array([self.height, self.rounding], dtype="<f8").tobytes())
        for array in (*self.contours, *mesh):
            content.update(np.array(array.shape, dtype="<i8").tobytes())
            content.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return content.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Letter) and (self.name, self.digest) == (other.name, other.digest)

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    def __getstate__(self) -> dict[str, object]:
        # Cached properties are left out: they can be computed again, and manifold3d's objects do not pickle.
        return {field.name: getattr(self, field.name) for field in fields(self)}


@lru_cache(maxsize=256)
def letter(name: str, *, height: float = HEIGHT, rounding: float = 0.0) -> Letter:
    """Build a letter of the catalogue, a capital or a digit, `height` mm thick.

    rounding: radius (mm) of the pressed face's edge. Raises InputError for a name that is not in the
    catalogue, a height that is not positive, or a radius too large for the height or the strokes.
    """
    from tactsim.models.glyphs import GLYPHS

    if name not in GLYPHS:
        raise unknown("letter", name, GLYPHS)
    return raised(name, GLYPHS[name](), height=height, rounding=rounding)


def raised(name: str, footprint: CrossSection, *, height: float = HEIGHT, rounding: float = 0.0) -> Letter:
    """Make a Letter of a region in plan (mm), moved so that its centre of area is the origin.

    Raises InputError as `letter` does.
    """
    if not 0 < height <= LARGEST_HEIGHT:
        raise InputError(
            f"{name!r}: height is {height:g} mm; it must lie between 0 and {LARGEST_HEIGHT:g} mm"
        )
    if not 0 <= rounding < height:
        raise InputError(
            f"{name!r}: rounding is {rounding:g} mm; it must be less than the height, {height:g} mm"
        )
    area, first, _ = _moments(footprint.to_polygons())
    centred = footprint.translate(tuple(-first / area)).simplify(1e-6)
    # A CrossSection keeps its corners on a grid of 1e-8 mm: one made of these corners will have the same.
    contours = type(footprint)(centred.to_polygons()).to_polygons()
    for contour in contours:
        contour.setflags(write=False)
    if rounding:
        from tactsim.models.parts import inset

        try:
            inset(contours, rounding)
        except InputError as error:
            raise InputError(f"{name!r}: {error}") from error
    return Letter(name, tuple(contours), float(height), float(rounding))


def relief(name: str, solid: Manifold) -> Letter:
    """Make a Letter of a solid (manifold3d.Manifold, mm), whose upper side (+z) is pressed.

    The solid is moved so that it stands on z = 0 and its footprint's centre of area is the origin.
    Raises InputError if it is empty or damaged, or thicker than LARGEST_HEIGHT.
    """
    from manifold3d import Error

    from tactsim.models.height_field import Relief

    if solid.status() != Error.NoError or solid.is_empty():
        raise InputError(f"{name!r}: the solid is empty or damaged ({solid.status().name})")
    bottom, top = solid.bounding_box()[2], solid.bounding_box()[5]
    if top - bottom > LARGEST_HEIGHT:
        raise InputError(f"{name!r}: height is {top - bottom:.4g} mm; the most is {LARGEST_HEIGHT:g} mm")
    # Straightened, because a fine mesh's outline has thousands of corners that nobody sees or feels.
    footprint = Relief.of(solid).footprint().simplify(1e-3)
    area, first, _ = _moments(footprint.to_polygons())
    x, y = first / area
    contours = footprint.translate((-x, -y)).to_polygons()
    for contour in contours:
        contour.setflags(write=False)
    return Letter(name, tuple(contours), top - bottom, relief=Relief.of(solid, (-x, -y, -bottom)))


def _moments(contours: list[FloatArray] | tuple[FloatArray, ...]) -> tuple[float, FloatArray, FloatArray]:
    """Integrate 1, [x, y] and [x, y] [x, y]^T over the region inside closed polygons (Green's theorem)."""
    area, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for a in contours:
        b = np.roll(a, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        area += cross.sum() / 2
        first += cross @ (a + b) / 6
        s = a + b
        second += ((s * cross[:, None]).T @ s + (a * cross[:, None]).T @ a + (b * cross[:, None]).T @ b) / 24
    return area, first, second


TOLERANCE = 0.05  # mm: an outline that moves by less counts as unchanged; a taxel measures 1.8 mm
LARGEST_ORDER = 64  # the turn of a higher order moves an outline hardly more than the tolerance
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)


def rotational_order(contours: Sequence[FloatArray], tolerance: float = TOLERANCE) -> int | float:
    """Find the largest n up to LARGEST_ORDER for which turns by 2 pi / n leave the region as it is.

    contours: (k, 2) mm each; the turns are about the origin, the centre of area. The region counts as unchanged when no
    point of it or of its turned copy lies further than `tolerance` (mm) outside the other. Returns math.inf
    when every contour is a circle round the origin within the tolerance: a fine regular polygon is one.
    """
    from manifold3d import CrossSection

    if all(_is_circle(contour, tolerance) for contour in contours):
        return math.inf
    region = CrossSection(list(contours))
    grown = region.offset(tolerance)
    order = 1
    for prime in PRIMES:
        while order * prime <= LARGEST_ORDER and _unchanged(region, grown, order * prime):
            order *= prime
    return order


def _is_circle(contour: FloatArray, tolerance: float) -> bool:
    """Tell whether a closed polygon stays between two circles about the origin, `tolerance` mm apart."""
    along = np.roll(contour, -1, axis=0) - contour
    place = np.clip(-np.sum(contour * along, axis=1) / np.sum(along**2, axis=1), 0, 1)
    nearest = np.hypot(*(contour + place[:, None] * along).T)
    return bool(np.hypot(*contour.T).max() - nearest.min() <= tolerance)


def _unchanged(region: CrossSection, grown: CrossSection, order: int) -> bool:
    """Tell whether every turn by a multiple of 2 pi / order keeps the region inside its grown self."""
    # A turn by +angle tests whether the copy sticks out of the region; a turn by -angle tests the reverse.
    # All multiples are tried, because one small turn moves no point far.
    turns = (sign * 360 * k / order for k in range(1, order // 2 + 1) for sign in (1, -1))
    return all((region.rotate(degrees) - grown).is_empty() for degrees in turns)
