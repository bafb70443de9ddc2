"""Read a solid from a user's mesh file."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError, short
from tactsim.core.scan import is_label
from tactsim.models.shapes import ENDINGS, read_file
from tactsim.solids.body import MOST_TRIANGLES, Solid, solid_of
from tactsim.solids.triangles import crossings

if TYPE_CHECKING:
    from manifold3d import Manifold

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
