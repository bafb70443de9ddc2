"""The convex parts of a letter, which MuJoCo collides, its rounded edges, and its files for other tools.

MuJoCo collides convex bodies only, and each piece costs time in every press. The polygon is cut into triangles, and
then cuts are taken back, the longest first, wherever both corners stay convex (Hertel and Mehlhorn 1983). That leaves
at most two cuts at a reflex corner, so r reflex corners make at most 2 r + 1 pieces.

The edge's profile is a quarter circle of radius r: at the distance d < r inside the outline the face
lies r - sqrt(r^2 - (r - d)^2) below its plane. Distances are to the lines of the outline's edges and
corners are mitred, so each edge of the outline has one strip and every strip is convex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.files import write_bytes
from tactsim.core.poses import FloatArray
from tactsim.models.letter import DENSITY, FELT, Letter

if TYPE_CHECKING:
    from manifold3d import Manifold

STRAIGHT = 1e-8  # mm: corners nearer than this to the line between their neighbours are left out
CHORD_ERROR = 0.005  # mm, of the profile's chords
_CONVEX = 1e-6  # mm by which a corner may lie inside the line between its neighbours and count as convex
_SLIVER = 1e-6  # mm: thinner pieces are left out


class Rectangle(NamedTuple):
    """A rectangle in plan: centre [x, y] mm, half side lengths mm, angle (rad) of the first side to x."""

    centre: tuple[float, float]
    half_sizes: tuple[float, float]
    angle: float


@dataclass(frozen=True, eq=False)
class ConvexPart:
    """A convex piece of a letter, standing on z = 0 and reaching the pressed face at z = height.

    outline: (k, 2) mm, convex, counter-clockwise: the piece in plan. vertices: (m, 3) mm, the corners of
    the convex solid, whose hull is the piece.
    """

    outline: FloatArray
    vertices: FloatArray

    @cached_property
    def rectangle(self) -> Rectangle | None:
        """Describe the part as an upright box (within 1e-7 mm); None if it is not one."""
        top = self.vertices[:, 2] == self.vertices[:, 2].max()
        if len(self.outline) != 4 or np.count_nonzero(top) != 4:
            return None
        first, second = self.outline[1] - self.outline[0], self.outline[2] - self.outline[1]
        length, width = float(np.hypot(*first)), float(np.hypot(*second))
        closing = self.outline[0] + second - self.outline[3]
        if abs(first @ second) > 1e-7 * max(length, width) or np.hypot(*closing) > 1e-7:
            return None
        x, y = self.outline.mean(axis=0)
        return Rectangle((float(x), float(y)), (length / 2, width / 2), math.atan2(first[1], first[0]))


def parts_of(letter: Letter) -> tuple[ConvexPart, ...]:
    """Cut the letter into convex parts that tile it without overlap.

    With rounded edges the flat of the face comes first, then one strip along each edge of the outline.
    A shape with relief is one part if it is convex, and a prism's parts if it is flat for FELT mm below its
    face. Raises InputError if it is neither.
    """
    if letter.flat_depth < FELT and letter.relief is not None:
        if letter.relief.hull is None:
            raise InputError(
                f"{letter.name!r} has relief and is not convex: it cannot be cut into convex parts"
            )
        from manifold3d import CrossSection

        vertices = letter.relief.hull.vertices
        outline = CrossSection.hull_points(np.ascontiguousarray(vertices[:, :2])).to_polygons()[0]
        return (_part(outline, vertices),)
    flat: Sequence[FloatArray] = letter.contours
    edge = []
    if letter.rounding:
        flat = inset(letter.contours, letter.rounding)
        edge = strips(letter.contours, letter.rounding, letter.height)
    prisms = [_prism(outline, letter.height) for outline in convex_pieces(flat)]
    return tuple(_part(outline, vertices) for outline, vertices in (*prisms, *edge))


def _prism(outline: FloatArray, height: float) -> tuple[FloatArray, FloatArray]:
    """Give the outline and the corners of a prism that stands on z = 0."""
    levels = [np.column_stack([outline, np.full(len(outline), z)]) for z in (0.0, height)]
    return outline, np.concatenate(levels)


def _part(outline: FloatArray, vertices: FloatArray) -> ConvexPart:
    for array in (outline, vertices):
        array.setflags(write=False)  # letters are cached and shared
    return ConvexPart(outline, vertices)


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


def export(letter: Letter, path: str | Path) -> None:
    """Write `letter` in the format that the ending of `path` names, whole or not at all.

    .stl: the solid, mm, binary. .glb: the solid, metres and y up, as glTF prescribes. .xml: MJCF, metres, one fixed
    body with a box or a convex mesh for each part. In .stl and .xml x, y, z are the object frame's; in .glb (x, y, z)
    is (x, z, -y).

    Raises InputError for another ending or a place that cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".stl":
        content = _mesh(letter, np.eye(3), "stl")
    elif suffix == ".glb":
        content = _mesh(letter, 1e-3 * np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), "glb")
    elif suffix == ".xml":
        content = _mjcf(letter)
    else:
        raise InputError(f"cannot export to {path}: the formats are .stl, .glb and .xml (MJCF)")
    write_bytes(path, content)


def _mesh(letter: Letter, axes: FloatArray, kind: str) -> bytes:
    import trimesh

    solid = letter.solid.to_mesh64()
    mesh = trimesh.Trimesh(solid.vert_properties[:, :3] @ axes.T, solid.tri_verts, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name=letter.name, geom_name=letter.name)
    content = BytesIO()
    scene.export(content, file_type=kind)
    return content.getvalue()


def _mjcf(letter: Letter) -> bytes:
    root = ElementTree.Element("mujoco", model=letter.name)
    asset = ElementTree.SubElement(root, "asset")
    world = ElementTree.SubElement(root, "worldbody")
    body = ElementTree.SubElement(world, "body", name=letter.name)
    density = f"{DENSITY * 1e9:g}"  # kg / m^3
    for index, part in enumerate(letter.parts):
        name = f"{letter.name}-{index}"
        if part.rectangle is not None:
            (x, y), (half_x, half_y), angle = part.rectangle
            half_z = letter.height / 2
            ElementTree.SubElement(
                body, "geom", name=name, type="box", density=density,
                pos=_metres(x, y, half_z), size=_metres(half_x, half_y, half_z),
                quat=f"{np.cos(angle / 2)!s} 0 0 {np.sin(angle / 2)!s}",
            )  # fmt: skip
        else:
            ElementTree.SubElement(asset, "mesh", name=name, vertex=_metres(*part.vertices.ravel()))
            ElementTree.SubElement(body, "geom", name=name, type="mesh", mesh=name, density=density)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _metres(*lengths: float) -> str:
    return " ".join(repr(float(length) / 1000) for length in lengths)
