"""Read a solid from a mesh file."""

from __future__ import annotations

import codecs
import re
import warnings
import zipfile
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.shapes import UNITS

if TYPE_CHECKING:
    from manifold3d import Manifold
    from trimesh import Trimesh

MOST_FACES = 500_000
MOST_BODIES = 2000  # uniting them takes a second or two
MOST_UNPACKED = 256 << 20  # bytes in a .3mf
LEAST_THICKNESS = 0.02  # mm
LARGEST = 1e4  # mm: no coordinate of a thing that a pad could feel is larger
WITHIN = 1e-6  # share of its volume that a body may reach out of another and count as inside it
# glTF prescribes metres and +Y up (section 3.4): its (x, y, z) is (x, -z, y) where z is up.
GLTF_TO_MM = 1000.0 * np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1e-3]])


def read_solid(content: bytes, kind: str) -> Manifold:
    """Read a mesh of `kind` "stl", "obj", "ply", "3mf", "glb" or "gltf" as a solid, mm, z up.

    Bodies are turned right side out and united. One inside another that is the other way round is a void in it.
    Facets with a repeated corner, and doubled ones, are dropped; polygons are cut into triangles.

    Raises InputError if the file is damaged, too large or refers to other files, or if the mesh is not
    watertight, is of too many bodies or has no thickness.
    """
    _check_claims(content, kind)
    mesh = _load(content, kind)
    bottom, top = float(mesh.bounds[0, 2]), float(mesh.bounds[1, 2])
    if not top - bottom > LEAST_THICKNESS:
        raise InputError(f"the mesh is only {top - bottom:.2g} mm thick along z ({UNITS})")
    return _united(_bodies(mesh))


class _Body(NamedTuple):
    """A body, right side out, and whether it was so in the file."""

    solid: Manifold
    sign: bool


def _bodies(mesh: Trimesh) -> list[_Body]:
    """Part a mesh into its bodies, each right side out."""
    from manifold3d import Error, Manifold, Mesh64

    parts = _closed_parts(mesh)
    if len(parts) > MOST_BODIES:
        raise InputError(f"it is made of {len(parts):,} bodies, the most is {MOST_BODIES:,}: unite them")
    bodies = []
    for vertices, faces in parts:
        solid = Manifold(Mesh64(vertices, faces))
        sign = solid.volume() > 0
        if not sign:
            solid = Manifold(Mesh64(vertices, np.ascontiguousarray(faces[:, ::-1])))
        if solid.status() != Error.NoError:
            raise InputError("the mesh's faces do not agree on what is inside; make its normals consistent")
        if solid.volume() > 0:
            bodies.append(_Body(solid, sign))
    return bodies


def _closed_parts(mesh: Trimesh) -> list[tuple[FloatArray, NDArray[np.uint64]]]:
    """Part a mesh into closed surfaces, without facets that have a repeated corner or are there twice.

    Each has vertices (v, 3) mm and faces (f, 3). Raises InputError if a surface is not closed.
    """
    from manifold3d import Error, Manifold, Mesh64
    from trimesh.graph import connected_component_labels
    from trimesh.repair import fix_winding

    faces = np.asarray(mesh.faces)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    # A facet that is there twice is one facet; between two bodies that share a wall it is none.
    for kept in (first, first[counts % 2 == 1]):
        mesh.faces = faces[np.sort(kept)]
        if not len(kept):
            continue
        # Faces hang together at edges that join two of them.
        labels = connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
        edges = np.column_stack([np.repeat(labels, 3), mesh.edges_sorted])
        joined = np.unique(edges, axis=0, return_counts=True)[1]
        if (joined == 2).all():
            if not mesh.is_winding_consistent:
                fix_winding(mesh)
            rows = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])
            return [_compact(mesh.vertices, mesh.faces[own]) for own in rows]
    # Where bodies share edges, manifold3d finds which faces belong together, if they agree on what is inside.
    mesh.faces = faces[np.sort(first)]
    vertices, corners = _compact(mesh.vertices, mesh.faces)
    whole = Manifold(Mesh64(vertices, corners))
    if whole.status() != Error.NoError or whole.is_empty():
        joined = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
        raise InputError(
            f"the mesh is not watertight: {np.count_nonzero(joined != 2):,} of its {len(joined):,} edges do not join "
            "two faces; repair it, for example in MeshLab or Blender"
        )
    pieces = [piece.to_mesh64() for piece in whole.decompose()]
    return [_compact(piece.vert_properties[:, :3], piece.tri_verts) for piece in pieces]


def _compact(vertices: FloatArray, faces: NDArray[Any]) -> tuple[FloatArray, NDArray[np.uint64]]:
    """Keep the vertices that faces use."""
    used, corners = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(vertices[used], dtype=float), corners.reshape(-1, 3).astype(np.uint64)


def _united(bodies: list[_Body]) -> Manifold:
    """Unite bodies; one that lies within another and had the other sign is taken away from it."""
    from manifold3d import Manifold, OpType

    solids = [body.solid for body in bodies]
    boxes = np.reshape([solid.bounding_box() for solid in solids], (-1, 2, 3))
    volumes = np.array([solid.volume() for solid in solids])
    order = np.argsort(volumes, kind="stable").tolist()
    roots = []
    # From the smallest on, so that what is within a body is in it before the body itself is put into another.
    for place, index in enumerate(order):
        low, high = boxes[index]
        within = (boxes[:, 0] <= low).all(axis=1) & (boxes[:, 1] >= high).all(axis=1)
        around = [larger for larger in order[place + 1 :] if within[larger]]
        limit = WITHIN * volumes[index]
        outer = next(
            (other for other in around if (bodies[index].solid - bodies[other].solid).volume() <= limit), None
        )
        if outer is None:
            roots.append(solids[index])
        elif bodies[outer].sign == bodies[index].sign:
            solids[outer] += solids[index]
        else:
            solids[outer] -= solids[index]
    return roots[0] if len(roots) == 1 else Manifold.batch_boolean(roots, OpType.Add)


def _load(content: bytes, kind: str) -> Trimesh:
    import trimesh

    if kind == "obj":
        content = _triangulated(_text(content))
    elif kind == "stl":
        content = _whole_stl(content)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            warnings.simplefilter(
                "error", DeprecationWarning
            )  # NumPy's, of numbers that end in something else
            # Without a resolver, nothing but these bytes is read. Processing would hide values that are not finite.
            scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False)
            mesh = scene.to_mesh()
            if kind in ("glb", "gltf"):
                mesh.apply_transform(GLTF_TO_MM)
            elif kind == "3mf" and scene.units:
                mesh.apply_scale(trimesh.units.unit_conversion(scene.units, "mm"))
            _check_corners(mesh)
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
    except InputError:
        raise
    except Exception as error:
        # A parser may raise anything on untrusted bytes; to the user every exception means the same.
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"not a whole {kind.upper()} file: {reason}") from error
    return mesh


def _text(content: bytes) -> str:
    """Decode a text file, with or without a byte order mark; what is no UTF-8 is Latin-1, as in names and comments."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _whole_stl(content: bytes) -> bytes:
    """Cut off what follows a binary STL's facets; give a text STL plain ends of lines and no names."""
    faces = _binary_stl_faces(content)
    if faces is not None:
        return content[: 84 + 50 * faces]
    return re.sub(r"(?im)^\s*(end)?solid\b.*$", r"\1solid", _text(content)).encode()


def _triangulated(text: str) -> bytes:
    """Write an OBJ's corners and faces alone, with its polygons cut into triangles: trimesh fans them."""
    from manifold3d import triangulate

    lines = [line.split() for line in text.replace("\\\n", " ").split("\n")]
    try:
        corners = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=float).reshape(-1, 3)
        faces, known = [], 0
        for line in lines:
            known += line[:1] == ["v"]
            if line[:1] != ["f"]:
                continue
            numbers = [int(word.split("/")[0]) for word in line[1:]]
            polygon = [number - 1 if number > 0 else known + number for number in numbers]
            if len(polygon) < 3 or not 0 <= min(polygon) <= max(polygon) < len(corners):
                raise InputError("a face names a corner that is not there")
            if len(polygon) == 3:
                faces.append(polygon)
                continue
            points = corners[polygon]
            # Newell's normal; seen along it, the polygon runs counter-clockwise.
            normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
            plane = np.linalg.svd(normal[None])[2][1:]
            plane = plane if np.linalg.det([*plane, normal]) > 0 else plane[::-1]
            faces += [[polygon[corner] for corner in three] for three in triangulate([points @ plane.T])]
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"not a whole OBJ file: {error}") from error
    return "\n".join(
        [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
        + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    ).encode()


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
            f"the most is {LARGEST:g} mm ({UNITS})"
        )


def _check_claims(content: bytes, kind: str) -> None:
    """Refuse a file that claims too many faces, before anything is built from it."""
    if kind == "stl":
        faces = _binary_stl_faces(content)
        if faces is None:
            text = content.lower()
            if not text.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"solid"):
                raise InputError(
                    f"not a whole STL file: its {len(content):,} bytes are not those that its header claims"
                )
            if b"endsolid" not in text:
                raise InputError("not a whole STL file: it has no 'endsolid'")
            faces = text.count(b"endfacet")
    elif kind == "obj":
        faces = len(re.findall(rb"[\r\n]f\s", content))
    elif kind in ("glb", "gltf"):
        faces = _gltf_faces(content, kind)
    else:
        faces = 0
        if kind == "3mf":
            _check_archive(content)
    if faces > MOST_FACES:
        raise InputError(f"it holds about {faces:,} faces; the most is {MOST_FACES:,}: simplify the mesh")


def _binary_stl_faces(content: bytes) -> int | None:
    """Count the facets that a binary STL claims and holds; None for a text, or a file cut short."""
    if len(content) < 84:
        return None
    faces = int.from_bytes(content[80:84], "little")
    whole = len(content) >= 84 + 50 * faces
    return faces if whole and b"facet" not in content[:1000].lower() else None


def _check_archive(content: bytes) -> None:
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            size = sum(part.file_size for part in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise InputError(f"not a whole 3MF file: {error}") from error
    if size > MOST_UNPACKED:
        raise InputError(f"it unpacks to {size:,} bytes; the most is {MOST_UNPACKED:,}: simplify the mesh")


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


def _gltf_faces(content: bytes, kind: str) -> int:
    """Bound the faces by the JSON of glTF, which comes first in a .glb (glTF 2.0, section 4.4)."""
    if kind == "glb":
        if len(content) < 20 or content[:8] != b"glTF\2\0\0\0" or content[16:20] != b"JSON":
            raise InputError("not a GLB file (binary glTF 2.0)")
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    try:
        tree = _Gltf.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "its JSON"
        raise InputError(f"not a whole {kind.upper()} file: {place}: {first['msg']}") from error
    if tree.extensionsRequired:
        raise InputError(f"it needs the glTF extension {tree.extensionsRequired[0]!r}; export it without")
    if any(part.uri is not None and not part.uri.startswith("data:") for part in tree.buffers + tree.images):
        raise InputError("it refers to other files; export it again as one self-contained .glb")
    # Three corners make a face. Placing a node costs as much as a hundred faces.
    return sum(accessor.count for accessor in tree.accessors) // 3 + 100 * len(tree.nodes)
