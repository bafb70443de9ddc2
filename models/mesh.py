"""Read a solid from a mesh file."""

from __future__ import annotations

import struct
import warnings
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from manifold3d import Manifold
    from trimesh import Trimesh

MOST_FACES = 500_000
MOST_BODIES = 2000  # uniting them takes a second or two
LEAST_THICKNESS = 0.02  # mm
LARGEST = 1e4  # mm: no coordinate of a thing that a pad could feel is larger
_SCALE = {"stl": 1.0, "obj": 1.0, "glb": 1000.0}  # to mm; glTF prescribes metres


def read_solid(content: bytes, kind: str) -> Manifold:
    """Read a mesh of `kind` "stl", "obj" or "glb" as a solid, mm; bodies that overlap are united.

    Raises InputError if the file is damaged, too large or refers to other files, or if the mesh is not
    watertight, is of too many bodies or has no thickness.
    """
    from manifold3d import Error, Manifold, Mesh64, OpType

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
    if not top - bottom > LEAST_THICKNESS:
        raise InputError(
            f"the mesh is only {top - bottom:.2g} mm thick along z (lengths are mm in .stl and .obj, metres in .glb)"
        )
    bodies = mesh.body_count
    if bodies > MOST_BODIES:
        raise InputError(f"it is made of {bodies:,} bodies, the most is {MOST_BODIES:,}: unite them")
    return Manifold.batch_boolean(solid.decompose(), OpType.Add) if bodies > 1 else solid


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
