"""A user's own shape: a mesh, or the outline of a drawing raised like a letter."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.files import read_bytes
from tactsim.core.poses import FloatArray
from tactsim.models.height_field import FLATNESS, Relief
from tactsim.models.letter import HEIGHT, LARGEST_HEIGHT, Letter, raised, relief

if TYPE_CHECKING:
    from manifold3d import CrossSection

LARGEST_REACH = 500.0  # mm from the centre of area; how far a scan reaches depends on the pad
LEAST_AREA = 1.0  # mm^2, a third of one taxel of the pad
MOST_CORNERS = 2000  # corners of the face's outline after straightening
DETAIL = 0.01  # mm: finer detail is left out; of a small shape less in proportion
# mm by which an outline may be off where it is straightened; a dot of 1 mm loses 0.4 % of its area
STRAIGHT = 0.003
SMALL = 20.0  # mm
TOUCHING = 1e-5  # mm: corners and edges nearer than this are moved apart by twice as much
MOST_TRACED = 20_000  # corners before straightening, whose time grows with the square of their number
UPRIGHT = 1e-6  # share of its volume by which a mesh may differ from its face raised
LARGEST_FILE = 64 << 20  # bytes
ENDINGS = (".stl", ".obj", ".ply", ".3mf", ".glb", ".gltf")
DRAWINGS = (".svg", ".svgz")
UNITS = (
    "lengths are mm in .stl, .obj and .ply, metres in .glb and .gltf, and as the file says in .3mf and .svg"
)


def shape(
    path: str | Path, *, height: float | None = None, name: str | None = None, rounding: float = 0.0
) -> Letter:
    """Read a shape to press from a file.

    path: a mesh or a drawing. A mesh is watertight, in mm and z up (.stl, .obj, .ply, .3mf) or in metres and y up
    (.glb, .gltf); its upper side is pressed. A flat face with upright sides becomes a letter, anything else a shape
    with relief. Of a drawing (.svg, .svgz) what a renderer fills is pressed, as it is seen, raised like a letter; what
    is left out of it is logged.
    height: thickness in mm; by default the mesh's own, or HEIGHT for a drawing. name: what a scan calls the
    shape, by default the file's name without its ending. rounding: radius (mm) of the face's edge.

    Raises InputError if the file cannot be read, is damaged or refers to others, if the mesh is not
    watertight, if the footprint is too small, larger than 500 mm to a side or too detailed, or if a height or
    rounding is given for a shape with relief, which has its own.
    """
    path = Path(path)
    name = path.stem if name is None else name
    if not (name.isprintable() and 0 < len(name) <= 40) or name == "none":  # which means none of the known
        raise InputError(
            f"{path}: {name!r} is no name for a shape; give one of 1 to 40 printable characters, but 'none'"
        )
    suffix = path.suffix.lower()
    if suffix not in (*ENDINGS, *DRAWINGS):
        raise InputError(
            f"{path}: shapes are read from {', '.join(ENDINGS)} and .svg files, not {suffix or 'this'}"
        )
    content = read_file(path)
    try:
        if suffix in DRAWINGS:
            from tactsim.models.svg import filled_region

            region, remarks = filled_region(content)
            for remark in remarks:
                logging.getLogger(__name__).warning("%s: %s", path, remark)
            letter = _raised(name, region, HEIGHT if height is None else height, rounding)
        else:
            letter = _shape_of_mesh(name, content, suffix[1:], height, rounding)
        _check_reach(np.concatenate(letter.contours))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return letter


def _shape_of_mesh(name: str, content: bytes, kind: str, height: float | None, rounding: float) -> Letter:
    """Make a letter of a mesh if it is a raised outline, else a shape with relief."""
    from tactsim.models.mesh import read_solid

    solid = read_solid(content, kind)
    bottom, top = solid.bounding_box()[2], solid.bounding_box()[5]
    if top - bottom > LARGEST_HEIGHT:
        raise InputError(
            f"the mesh is {top - bottom:.4g} mm thick along z, the most is {LARGEST_HEIGHT:g} ({UNITS})"
        )
    outline = solid.project().area()
    _check_area(outline)
    if solid.volume() > (1 + UPRIGHT) * outline * (top - bottom):
        raise InputError(
            "the mesh cuts through itself: it has more volume than its outline raised; repair it, as in Blender"
        )
    if Relief.of(solid).flat_depth == math.inf:
        face = solid.slice(top - FLATNESS)
        if abs(face.area() * (top - bottom) - solid.volume()) <= UPRIGHT * solid.volume():
            return _raised(name, face, top - bottom if height is None else height, rounding)
    if height is not None or rounding:
        raise InputError(
            "height and rounding are for a flat face with upright sides; this mesh has relief, change the mesh instead"
        )
    return relief(name, solid)


def _raised(name: str, footprint: CrossSection, height: float, rounding: float) -> Letter:
    """Raise a region that was cleaned, and is neither too small nor too detailed."""
    _check_detail(footprint.num_vert(), MOST_TRACED)
    footprint = cleaned(footprint)
    _check_detail(footprint.num_vert(), MOST_CORNERS)
    _check_area(footprint.area())
    return raised(name, footprint, height=height, rounding=rounding)


def cleaned(region: CrossSection) -> CrossSection:
    """Close gaps and cut off necks and whiskers thinner than DETAIL, and straighten outlines within STRAIGHT.

    Of a shape smaller than SMALL both shrink in proportion.

    What is left has no slivers and touches itself nowhere, so that it can be cut into parts.
    """
    from manifold3d import CrossSection, JoinType

    if region.is_empty():
        return region
    left, low, right, high = region.bounds()
    scale = min(max(right - left, high - low) / SMALL, 1.0)
    detail = DETAIL * scale
    for step in (detail / 2, -detail, detail / 2):
        region = region.offset(step, JoinType.Miter, 10.0)
    # Straightening can make contours cross or shrink to a line. A new region of the same contours has neither.
    region = CrossSection(region.simplify(STRAIGHT * scale).to_polygons())
    if 0 < region.num_vert() <= MOST_CORNERS and _touches_itself(region.to_polygons()):
        region = region.offset(-TOUCHING, JoinType.Miter, 10.0).simplify(TOUCHING / 10)
    return region


def _touches_itself(contours: list[FloatArray]) -> bool:
    """Tell whether a corner lies nearer than TOUCHING to an edge that is not its own."""
    corners = np.concatenate(contours)
    along = np.concatenate([np.roll(contour, -1, axis=0) - contour for contour in contours])
    place = np.arange(len(corners))
    before = np.concatenate(
        [np.roll(own, 1) for own in np.split(place, np.cumsum([*map(len, contours)])[:-1])]
    )
    for index, corner in enumerate(corners):
        offset = corner - corners
        nearest = np.clip(np.sum(offset * along, axis=1) / np.sum(along**2, axis=1), 0, 1)[:, None] * along
        near = np.hypot(*(offset - nearest).T) < TOUCHING
        near[[index, before[index]]] = False
        if near.any():
            return True
    return False


def read_file(path: Path, what: str = "shape") -> bytes:
    """Read a user's file. Raises InputError if it cannot be read, is empty or is larger than LARGEST_FILE."""
    try:
        content = read_bytes(path, LARGEST_FILE)
    except InputError as error:
        raise InputError(f"cannot read {what} {path}: {error}") from error
    if not content:
        raise InputError(f"{what} {path}: it is empty; a mesh is {', '.join(ENDINGS)}, a drawing .svg")
    return content


def _check_detail(corners: int, most: int) -> None:
    if corners > most:
        raise InputError(f"the face's outline has {corners:,} corners, the most is {most:,}: simplify it")


def _check_area(area: float) -> None:
    if area < LEAST_AREA:
        raise InputError(
            f"the face to press covers {area:.2g} mm^2, and a pad feels none below {LEAST_AREA:g} mm^2 ({UNITS})"
        )


def _check_reach(corners: np.ndarray) -> None:
    reach = np.abs(corners).max(axis=0)
    if reach.max() > LARGEST_REACH:
        raise InputError(
            f"the face reaches {reach[0]:.4g} mm sideways and {reach[1]:.4g} mm up or down from its centre of "
            f"area; the most is {LARGEST_REACH:g} mm: scale it down ({UNITS})"
        )
