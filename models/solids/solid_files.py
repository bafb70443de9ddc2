"""Read a solid from a user's mesh file."""

from __future__ import annotations

from pathlib import Path

from tactsim.core.errors import InputError, short
from tactsim.core.files import read_bytes
from tactsim.core.scan import is_label
from tactsim.models.mesh import read_solid
from tactsim.models.shapes import ENDINGS, LARGEST_FILE
from tactsim.models.solids.solid import Solid, solid_of
from tactsim.models.solids.triangles import crossings


def read_solid_file(path: str | Path, name: str | None = None) -> Solid:
    """Read a solid to touch from a mesh file: mm, z up; in .glb and .gltf metres, y up.

    name: what a scan calls it, by default the file's name without its ending. The solid keeps its axes; the origin
    becomes the centre of mass. Bodies that overlap are united.

    Raises InputError if the file cannot be read or is damaged, if the mesh is open or cuts through itself, if it
    measures more than `LARGEST_SOLID` mm along an axis, or if it has more than `MOST_TRIANGLES` faces.
    """
    path = Path(path)
    name = path.stem if name is None else name
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise InputError(f"{path}: solids are read from {', '.join(ENDINGS)} files, not {suffix or 'this'}")
    try:
        content = read_bytes(path, LARGEST_FILE)
    except InputError as error:
        raise InputError(f"cannot read solid {path}: {error}") from error
    if not is_label(name):
        raise InputError(f"{short(name)} is no name for a solid; give one of 1 to 100 printable characters")
    try:
        solid = solid_of(name, read_solid(content, suffix[1:]))
        crossing = crossings(solid.corners)
        if len(crossing):
            raise InputError(
                f"the mesh cuts through itself: {len(crossing):,} pairs of its faces cross; repair it, for example in "
                "MeshLab or Blender"
            )
        return solid
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
