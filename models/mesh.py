"""Read a solid from a mesh file."""

from __future__ import annotations

import codecs
import re
import warnings
import zipfile
from io import BytesIO
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import trimesh
from manifold3d import Error, Manifold, Mesh64, OpType, triangulate
from numpy.typing import NDArray
from trimesh import Trimesh

from tactsim.core.documents import encoding_of, parse_json
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.shapes import UNITS

MOST_FACES = 500_000
MOST_BODIES = 2000  # uniting them takes a second or two
MOST_UNPACKED = 256 << 20  # bytes in a .3mf
LEAST_THICKNESS = 0.02  # mm
# Parts of a slicer's projects, and of extensions of 3MF, that are no part of the solid or change it.
_NO_SOLID = re.compile(
    rb"\b(NegativeVolume|ParameterModifier|negative_part|modifier_part|[Ss]upport_?(?:[Bb]lock|[Ee]nforc)er)\b"
    rb'|<(?:\w+:)?(beamlattice|booleanshape|levelset)\b|\b(type="(?:(?:solid)?support|surface|other)"|printable="0")'
)
GAP = 2e-5  # share of a mesh's size between corners that are meant to be one, as rounding leaves them
LARGEST = 1e4  # mm: no coordinate of a thing that a pad could feel is larger
WITHIN = 1e-6  # share of its volume that a body may reach out of another and count as inside it
# NumPy's codes of what it does not know by the same name.
_PLY_NUMBERS = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
}  # fmt: skip
# glTF prescribes metres and +Y up (section 3.4): its (x, y, z) is (x, -z, y) where z is up.
GLTF_TO_MM = 1000.0 * np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1e-3]])


def read_solid(content: bytes, kind: str) -> Manifold:
    """Read a mesh of `kind` "stl", "obj", "ply", "3mf", "glb" or "gltf" as a solid, mm, z up.

    Bodies are turned right side out and united. One inside another that is the other way round is a void in it.
    Facets with a repeated corner, and doubled ones, are dropped; polygons are cut into triangles.

    Raises InputError if the file is damaged, too large or refers to other files, or if the mesh is not
    watertight, is of too many bodies or has no thickness.
    """
    mesh = _load(content, kind)
    if not (thickness := mesh.extents[2]) > LEAST_THICKNESS:
        raise InputError(f"the mesh is only {thickness:.2g} mm thick along z ({UNITS})")
    return _united(_bodies(mesh))


def _bodies(mesh: Trimesh) -> list[tuple[Manifold, bool]]:
    """Part a mesh into its bodies, each right side out, and tell whether it was so in the file."""
    bodies = []
    for part in _closed_parts(mesh):
        trimesh.repair.fix_winding(part)
        sign = bool(np.linalg.det(part.triangles).sum() > 0)
        if not sign:
            part.invert()
        solid = _manifold(part)
        if solid.status() != Error.NoError:
            raise InputError("the mesh's faces do not agree on what is inside; make its normals consistent")
        if solid.volume() > 0:
            bodies.append((solid, sign))
    return bodies


def _closed_parts(mesh: Trimesh) -> list[Trimesh]:
    """Part a mesh into closed surfaces, without facets that have a repeated corner or are there twice.

    Raises InputError if a surface is not closed, or if they are too many.
    """
    faces = np.asarray(mesh.faces)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    # A facet that is there twice is one facet; between two bodies that share a wall it is none.
    for kept in (first, first[counts % 2 == 1]):
        mesh.faces = faces[np.sort(kept)]
        # Faces hang together at edges that join two of them.
        own = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
        if len(own) > MOST_BODIES:
            raise InputError(f"it is made of {len(own):,} bodies, the most is {MOST_BODIES:,}: unite them")
        parts = cast("list[Trimesh]", mesh.submesh(own, repair=False))
        if len(parts) and all(part.is_watertight for part in parts):
            return parts
    mesh.faces = faces[np.sort(first)]
    # Where bodies share edges, manifold3d finds which faces belong together, if they agree on what is inside.
    whole = _manifold(mesh)
    if whole.status() != Error.NoError or whole.is_empty():
        joined = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
        raise InputError(
            f"the mesh is not watertight: {np.count_nonzero(joined != 2):,} of its {len(joined):,} edges do not join "
            "two faces; repair it, for example in MeshLab or Blender"
        )
    pieces = [piece.to_mesh64() for piece in whole.decompose()]
    return [Trimesh(piece.vert_properties[:, :3], piece.tri_verts, process=False) for piece in pieces]


def _manifold(mesh: Trimesh) -> Manifold:
    return Manifold(Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))


def _united(bodies: list[tuple[Manifold, bool]]) -> Manifold:
    """Unite bodies; one that lies within another and had the other sign is taken away from it."""
    solids = [solid for solid, _ in bodies]
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
            (other for other in around if (bodies[index][0] - bodies[other][0]).volume() <= limit), None
        )
        if outer is None:
            roots.append(solids[index])
        elif bodies[outer][1] == bodies[index][1]:
            solids[outer] += solids[index]
        else:
            solids[outer] -= solids[index]
    return roots[0] if len(roots) == 1 else Manifold.batch_boolean(roots, OpType.Add)


def _load(content: bytes, kind: str) -> Trimesh:
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # NumPy's, of numbers that end in something else.
            warnings.simplefilter("error", DeprecationWarning)
            is_text = kind in ("obj", "ply") or (kind == "stl" and _binary_stl_faces(content) is None)
            if is_text and encoding_of(content) == "utf-16":
                content = content.decode("utf-16").encode("utf-8-sig")
            _check_claims(content, kind)
            if is_text:
                corners, polygons = {"obj": _obj, "ply": _ply, "stl": _text_stl}[kind](content)
                mesh = Trimesh(corners, _triangles(corners, polygons), process=False)
            else:
                if kind == "stl":  # without what follows its facets
                    faces = _binary_stl_faces(content) or 0
                    content = content[:80] + faces.to_bytes(4, "little") + content[84 : 84 + 50 * faces]
                elif kind == "3mf":
                    content = _one_model(content)
                # Without a resolver, nothing but these bytes is read. Processing would hide values that are not finite.
                # Its postprocessing makes bodies of one name in a 3MF one.
                scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False, postprocess=False)
                mesh = scene.to_mesh()
                if kind in ("glb", "gltf"):
                    mesh.apply_transform(GLTF_TO_MM)
                elif kind == "3mf" and scene.units:
                    mesh.apply_scale(trimesh.units.unit_conversion(scene.units, "mm"))
            _check_corners(mesh.vertices, mesh.faces)
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
            # A facet with a repeated corner leaves nothing open, so it is no reason to close gaps.
            kept = mesh.faces[(mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)]
            if not Trimesh(mesh.vertices, kept, process=False).is_watertight:
                same = np.arange(len(mesh.vertices))
                for corners in trimesh.grouping.clusters(mesh.vertices, GAP * mesh.extents.max()):
                    same[corners] = corners[0]
                mesh.faces = same[mesh.faces]
    except InputError:
        raise
    except Exception as error:
        # A parser may raise anything on untrusted bytes; to the user every exception means the same.
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"not a whole {kind.upper()} file: {reason}") from error
    return mesh


def _text(content: bytes) -> str:
    """Decode a text file, with or without a byte order mark; what is not ASCII is in names and comments only."""
    text = content.removeprefix(codecs.BOM_UTF8).decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _text_stl(content: bytes) -> tuple[FloatArray, list[list[int]]]:
    """Read the corners (v, 3) and facets of a text STL, which may have more than three corners.

    trimesh wants a line for each corner, three of them, and good normals.
    """
    text = re.sub(r"\b(?:end)?solid\b(?:(?!facet\s+normal)[^\n])*", "", _text(content).lower())  # names
    corners = np.array(re.findall(r"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text), dtype=float).reshape(-1, 3)
    ends = np.cumsum([len(re.findall(r"\bvertex\b", facet)) for facet in re.split(r"\bendfacet\b", text)])
    facets = np.split(np.arange(len(corners)), ends[:-1])
    return corners, [facet.tolist() for facet in facets if len(facet)]


def _check_archive(archive: zipfile.ZipFile) -> None:
    """Refuse a 3MF that is too large, or whose slicer's parts would be joined to the solid."""
    size = sum(part.file_size for part in archive.infolist())
    if size > MOST_UNPACKED:
        raise InputError(f"it unpacks to {size:,} bytes; the most is {MOST_UNPACKED:,}: simplify the mesh")
    for name in archive.namelist():
        if name.endswith((".config", ".model")) and (part := _NO_SOLID.search(archive.read(name))):
            what = part[part.lastindex or 0].decode()
            raise InputError(f"it holds a {what} beside the solid: export the solid without")


def _one_model(content: bytes) -> bytes:
    """Put all objects of a 3MF into its main model: trimesh gives a component all meshes of another file it names."""
    with zipfile.ZipFile(BytesIO(content)) as archive:
        _check_archive(archive)
        names = [name for name in archive.namelist() if name.endswith(".model")]
        mains = [name for name in names if name.lower() == "3d/3dmodel.model"] or names
        if len(mains) != 1:
            raise InputError("it holds no 3D/3dmodel.model")
        text = archive.read(mains[0]).replace(b"\0", b"")  # in UTF-16 letters are parted
        if not re.search(rb"<(\w+:)?item\b", text):
            raise InputError("its build is empty: place an object in it, and export it again")
        # Of instances with one part number trimesh keeps the last.
        if len(names) == 1 and "3d/3dmodel.model" in names[0].lower() and b"partnumber" not in text:
            return content
        models = {"/" + name.lstrip("/"): ElementTree.fromstring(archive.read(name)) for name in names}
    main = models["/" + mains[0].lstrip("/")]
    if len(units := {model.get("unit", "millimeter") for model in models.values()}) > 1:
        raise InputError(f"its parts are in {' and '.join(sorted(units))}: export it in one unit")
    for path, model in models.items():
        for tag, key in (("object", "id"), ("component", "objectid"), ("item", "objectid")):
            for element in model.iterfind(f".//{{*}}{tag}"):
                where = next(
                    (element.attrib.pop(name) for name in [*element.keys()] if name.endswith("}path")), path
                )
                element.set(key, f"{where} {element.get(key)}")
                element.attrib.pop("partnumber", None)
        if model is not main:
            main.find("{*}resources").extend(model.iterfind(".//{*}object"))  # type: ignore[union-attr]
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("3D/3dmodel.model", ElementTree.tostring(main))
    return packed.getvalue()


def _obj(content: bytes) -> tuple[FloatArray, list[list[int]]]:
    """Read the corners (v, 3) and polygons of an OBJ file; trimesh fans polygons, which is wrong for concave ones."""
    corners: list[list[float]] = []
    polygons = []
    for line in _text(content).replace("\\\n", " ").split("\n"):
        word, *values = line.partition("#")[0].split() or [""]
        if word == "v":
            corners.append([float(value) for value in values[:3]])
        elif word == "f":
            numbers = [int(value.split("/")[0]) for value in values]
            polygons.append([number - 1 if number > 0 else len(corners) + number for number in numbers])
    return np.reshape(corners, (-1, 3)), polygons


def _ply(content: bytes) -> tuple[FloatArray, list[list[int]]]:
    """Read the corners (v, 3) and polygons of a PLY file.

    trimesh fans polygons, and reads no binary files in which they have different numbers of corners.
    """
    parts = re.fullmatch(
        rb"(?:\xef\xbb\xbf)?ply\b(.*?)\bend_header[ \t]*(?:\r\n|\r|\n)(.*)", content, re.DOTALL
    )
    if parts is None:
        raise InputError("not a PLY file: it has no head from 'ply' to 'end_header'")
    head, body = parts.groups()
    elements: list[tuple[str, int, list[Any]]] = []  # name, count, (property, type of its count, type)
    order = ""

    def number(kind: str) -> str:
        return order + np.dtype(_PLY_NUMBERS.get(kind, kind)).char if order else "f8"

    for line in head.decode("latin-1").splitlines():
        match line.split():
            case ["format", form, *_]:
                order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form, "")
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", "list", size, kind, name]:
                elements[-1][2].append((name, number(size), number(kind)))
            case ["property", kind, name]:
                elements[-1][2].append((name, "", number(kind)))
    if not order:  # a text: all of its numbers as they would be in memory
        body = np.fromstring(body.decode("ascii"), sep=" ").tobytes()
    corners, polygons, place = np.empty((0, 3)), [], 0

    def take(kind: Any, count: int) -> NDArray[Any]:
        nonlocal place
        values = np.frombuffer(body, kind, count, place)
        place += values.nbytes
        return values

    for name, count, properties in elements:
        if not any(size for _, size, _ in properties):
            table = take([(label, kind) for label, _, kind in properties], count)
            if name == "vertex":
                corners = np.column_stack([table[axis] for axis in "xyz"]).astype(float)
            continue
        for _ in range(count):
            for label, size, kind in properties:
                values = take(kind, int(take(size, 1)[0]) if size else 1)
                if name == "face" and label in ("vertex_indices", "vertex_index"):
                    polygons.append([int(corner) for corner in values])
    return corners, polygons


def _triangles(corners: FloatArray, polygons: list[list[int]]) -> NDArray[np.int64]:
    """Cut polygons into triangles: (f, 3). A polygon that is there twice is cut the same way both times."""
    _check_corners(corners, np.array([corner for polygon in polygons for corner in polygon]))
    faces = [np.array([polygon for polygon in polygons if len(polygon) == 3], np.int64).reshape(-1, 3)]
    same = np.unique(corners, axis=0, return_inverse=True)[1]
    for polygon in polygons:
        if len(polygon) <= 3:
            continue
        # From the first corner in space towards the first of its neighbours, without repeated ones.
        around = np.roll(polygon, -int(same[polygon].argmin()))
        around = around[same[around] != np.roll(same[around], 1)]
        if len(around) < 3:
            continue
        backward = same[around[-1]] < same[around[1]]
        around = np.roll(around[::-1], 1) if backward else around
        outline = corners[around]
        # Seen along Newell's normal it runs counter-clockwise, and so it does along the nearest axis.
        normal = np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0)
        axis = int(np.abs(normal).argmax())
        plane = [(axis + 1) % 3, (axis + 2) % 3] if normal[axis] > 0 else [(axis + 2) % 3, (axis + 1) % 3]
        threes = around[triangulate([outline[:, plane]])]
        faces.append(threes[:, ::-1] if backward else threes)
    return np.concatenate(faces)


def _check_corners(corners: FloatArray, faces: NDArray[np.int64]) -> None:
    """Check corners (v, 3), mm, and the numbers of those that faces name."""
    if not len(faces):
        raise InputError("there is no face in it")
    if not 0 <= faces.min() <= faces.max() < len(corners):
        raise InputError("a face names a corner that is not there")
    if not np.isfinite(corners).all():
        raise InputError("a corner of the mesh is not a finite number")
    if (reach := np.abs(corners).max()) > LARGEST:
        raise InputError(
            f"a corner of the mesh is {reach:.3g} mm from the origin; the most is {LARGEST:g} mm ({UNITS})"
        )


def _check_claims(content: bytes, kind: str) -> None:
    """Refuse a file that claims too many faces, before anything is built from it."""
    if kind == "stl":
        faces = _binary_stl_faces(content)
        if faces is None:
            text = content.removeprefix(codecs.BOM_UTF8).lower()
            if not text.lstrip().startswith(b"solid") or b"endsolid" not in text:
                raise InputError(
                    "not a whole STL file: it is no text from 'solid' to 'endsolid', and its "
                    f"{len(content):,} bytes are not those that a binary header claims"
                )
            faces = text.count(b"endfacet")
    elif kind == "obj":
        faces = len(re.findall(rb"[\r\n]f\s", content))
    elif kind in ("glb", "gltf"):
        faces = _gltf_faces(content, kind)
    elif kind == "ply":
        if re.search(rb"element\s+tristrips\s+[1-9]", content[:10_000]):
            raise InputError(
                "it has strips of triangles (tristrips), which are not read; export it with faces"
            )
        faces = sum(map(int, re.findall(rb"element\s+face\s+(\d+)", content[:10_000])))
    else:
        faces = 0  # a 3MF claims none: `_check_archive` looks at its size
    if faces > MOST_FACES:
        raise InputError(f"it holds about {faces:,} faces; the most is {MOST_FACES:,}: simplify the mesh")


def _binary_stl_faces(content: bytes) -> int | None:
    """Count the facets that a binary STL claims and holds; None for a text, or a file cut short.

    A text has characters where the number stands: as a number they claim gigabytes, whatever the header says. A writer
    that streams leaves 0 or -1 there, or the number of a part: then the file's length tells.
    """
    faces = int.from_bytes(content[80:84], "little")
    held, rest = divmod(max(len(content) - 84, 0), 50)
    faces = held if faces in (0, 2**32 - 1) or (faces < held and not rest) else faces
    return faces if len(content) >= 84 + 50 * faces else None


def _gltf_faces(content: bytes, kind: str) -> int:
    """Bound the faces by the JSON of glTF, which comes first in a .glb (glTF 2.0, section 4.4)."""
    if kind == "glb":
        if len(content) < 20 or content[:8] != b"glTF\2\0\0\0" or content[16:20] != b"JSON":
            raise InputError("not a GLB file (binary glTF 2.0)")
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    tree = parse_json(content, "its JSON")
    if not str(tree.get("asset", {}).get("version")).startswith("2."):
        raise InputError("it is no glTF 2.0, which is what is read; export it as that")
    accessors = tree.get("accessors", [])
    instances = {"EXT_mesh_gpu_instancing"} & {*tree.get("extensionsUsed", [])}
    for name in [*tree.get("extensionsRequired", []), *instances]:
        if not name.startswith(("KHR_materials", "KHR_texture")):
            raise InputError(f"it needs the glTF extension {name!r}; export it without")
    if any(part.get("mode") == 6 for mesh in tree.get("meshes", []) for part in mesh["primitives"]):
        raise InputError("it has fans of triangles (mode 6), which are not read; export it with triangles")
    parts = [*tree.get("nodes", []), *tree.get("meshes", [])]
    if any("skin" in part or any(part.get("weights", [])) for part in parts):
        raise InputError("bones or shape keys move it: apply them, and export it without")
    if any("sparse" in accessor for accessor in accessors):
        raise InputError("it has sparse accessors, which are not read; export it without shape keys")
    if any(not buffer.get("uri", "data:").startswith("data:") for buffer in tree.get("buffers", [])):
        raise InputError("it refers to other files; export it again as one self-contained .glb")
    # Three corners make a face. Placing a node costs as much as a hundred faces.
    return sum(abs(accessor["count"]) for accessor in accessors) // 3 + 100 * len(tree.get("nodes", []))
