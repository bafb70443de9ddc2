"""The convex parts of a letter, which MuJoCo collides, and its files for other tools.

MuJoCo collides convex bodies only, and each piece costs time in every press. The polygon is cut into triangles, and
then cuts are taken back, the longest first, wherever both corners stay convex (Hertel and Mehlhorn 1983). That leaves
at most two cuts at a reflex corner, so r reflex corners make at most 2 r + 1 pieces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.files import write_bytes
from tactsim.core.poses import FloatArray
from tactsim.models.letter import DENSITY, FELT, Letter

STRAIGHT = 1e-8  # mm: corners nearer than this to the line between their neighbours are left out
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
        from tactsim.models.rounding import inset, strips

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
