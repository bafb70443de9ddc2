"""Read the face to press from a mesh file: the highest one, which must be flat and face +z."""

from __future__ import annotations

import struct
import warnings
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from manifold3d import CrossSection
    from trimesh import Trimesh

MOST_FACES = 500_000
FLATNESS = 0.01  # mm below the highest point that still belong to the face
LEVEL_SHARE = 0.5  # least share of the section there that must be level
LARGEST = 1e4  # mm: no coordinate of a thing that a pad could feel is larger
_SCALE = {"stl": 1.0, "obj": 1.0, "glb": 1000.0}  # to mm; glTF prescribes metres


def highest_face(content: bytes, kind: str, most_corners: int) -> tuple[CrossSection, float]:
    """Read a mesh of `kind` "stl", "obj" or "glb": the outline of its highest face and its thickness, mm.

    most_corners: the most corners that the outline may have before overlapping bodies are united.

    Raises InputError if the file is damaged, too large or refers to other files, if the mesh is not
    watertight, or if its highest part is not a flat face.
    """
    from manifold3d import Error, Manifold, Mesh64

    _check_claims(content, kind)
    mesh = _load(content, kind)
    if not mesh.is_watertight:
        pairs, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        raise InputError(
            f"the mesh is not watertight: {np.count_nonzero(counts != 2):,} of its {len(pairs):,} edges do not "
            "join two faces; repair it, for example in MeshLab or Blender"
        )
    triangles = np.asarray(mesh.faces, dtype=np.uint64)
    solid = Manifold(Mesh64(np.ascontiguousarray(mesh.vertices, dtype=float), triangles))
    if solid.status() != Error.NoError:
        raise InputError("the mesh's faces do not agree on what is inside; make its normals consistent")
    if solid.volume() < 0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
        solid = Manifold(Mesh64(np.ascontiguousarray(mesh.vertices, dtype=float), triangles))
    bottom, top = float(mesh.bounds[0, 2]), float(mesh.bounds[1, 2])
    if not top - bottom > 2 * FLATNESS:
        raise InputError(
            f"the mesh is only {top - bottom:.2g} mm thick along z (lengths are mm in .stl and .obj, metres in .glb)"
        )
    heights = mesh.vertices[:, 2][mesh.faces]
    traced = np.count_nonzero((heights.min(axis=1) < top - FLATNESS) & (heights.max(axis=1) > top - FLATNESS))
    if traced > most_corners:
        raise InputError(
            f"the face's outline has {traced:,} corners, the most is {most_corners:,}: simplify it"
        )
    face = solid.slice(top - FLATNESS)
    corners = mesh.vertices[triangles.astype(np.intp)]
    flat = (corners[:, :, 2] >= top - FLATNESS).all(axis=1)
    sides = corners[flat, 1:, :2] - corners[flat, :1, :2]
    upward = float(np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum() / 2)
    # The section includes the rim of a rounded edge, which is not level. A dome's section is nearly all rim.
    if upward < LEVEL_SHARE * face.area():
        raise InputError(
            "what is highest (largest z) is not flat: of the mesh's section just below the top only "
            f"{100 * upward / face.area():.0f} % is a level face; turn the face to press towards +z"
        )
    return face, top - bottom


def _load(content: bytes, kind: str) -> Trimesh:
    import trimesh

    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # Without a resolver, nothing but these bytes is read. Processing would hide values that are not finite.
            mesh = trimesh.load_mesh(BytesIO(content), file_type=kind, process=False)
            mesh.apply_scale(_SCALE[kind])
            _check_corners(mesh)
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
    except InputError:
        raise
    except Exception as error:
        # A parser may raise anything on untrusted bytes; to the user every exception means the same.
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"not a whole {kind.upper()} file: {reason}") from error
    return mesh


def _check_corners(mesh: Trimesh) -> None:
    if not len(mesh.faces):
        raise InputError("there is no face in it")
    if not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise InputError("a face names a corner that is not there")
    if not np.isfinite(mesh.vertices).all():
        raise InputError("a corner of the mesh is not a finite number")
    if np.abs(mesh.vertices).max() > LARGEST:
        raise InputError(
            f"a corner of the mesh is {np.abs(mesh.vertices).max():.3g} mm from the origin; "
            f"the most is {LARGEST:g} mm (lengths are mm in .stl and .obj, metres in .glb)"
        )


def _check_claims(content: bytes, kind: str) -> None:
    """Refuse a file that claims too many faces, before anything is built from it."""
    if kind == "stl":
        faces = _stl_faces(content)
    elif kind == "obj":
        _check_text(content, "OBJ")
        faces = content.count(b"\nf ")
    else:
        faces = _glb_faces(content)
    if faces > MOST_FACES:
        raise InputError(f"it holds about {faces:,} faces; the most is {MOST_FACES:,}: simplify the mesh")


def _stl_faces(content: bytes) -> int:
    if len(content) >= 84:
        (faces,) = struct.unpack_from("<I", content, 80)
        if len(content) == 84 + 50 * faces:
            return int(faces)
    if not content.lstrip()[:5].lower() == b"solid":
        raise InputError(
            f"not a whole STL file: its {len(content):,} bytes are not those that its header claims"
        )
    _check_text(content, "STL")
    if b"endsolid" not in content.lower():
        raise InputError("not a whole STL file: it has no 'endsolid'")
    return content.count(b"endfacet")


def _check_text(content: bytes, kind: str) -> None:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"not a whole {kind} file: it is not text in UTF-8") from error


class _Buffer(BaseModel):
    uri: str | None = None


class _Accessor(BaseModel):
    count: int = Field(ge=0)


class _Gltf(BaseModel):
    """The fields of glTF 2.0 that say how much there is to read, and from where."""

    accessors: list[_Accessor] = []
    nodes: list[dict[str, Any]] = []
    buffers: list[_Buffer] = []
    images: list[_Buffer] = []
    extensionsRequired: list[str] = []


def _glb_faces(content: bytes) -> int:
    """Bound the faces of a .glb by its JSON chunk, which comes first (glTF 2.0, section 4.4)."""
    if len(content) < 20 or content[:8] != b"glTF\2\0\0\0" or content[16:20] != b"JSON":
        raise InputError("not a GLB file (binary glTF 2.0)")
    (length,) = struct.unpack_from("<I", content, 12)
    try:
        tree = _Gltf.model_validate_json(content[20 : 20 + length])
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "its JSON"
        raise InputError(f"not a whole GLB file: {place}: {first['msg']}") from error
    if tree.extensionsRequired:
        raise InputError(f"it needs the glTF extension {tree.extensionsRequired[0]!r}; export it without")
    if any(part.uri is not None and not part.uri.startswith("data:") for part in tree.buffers + tree.images):
        raise InputError("it refers to other files; export it again as one self-contained .glb")
    # Three corners make a face. Placing a node costs as much as a hundred faces.
    return sum(accessor.count for accessor in tree.accessors) // 3 + 100 * len(tree.nodes)
