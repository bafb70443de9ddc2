import copy
import json
import os
import re
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection
from refusals import refusal

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.mesh import read_solid


def write_mesh(folder, mesh, kind="stl"):
    path = folder / f"thing.{kind}"
    mesh = mesh.copy()
    if kind in ("glb", "gltf"):
        mesh.vertices = 1e-3 * mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]  # metres, y up
    if kind == "gltf":
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), embed_buffers=True)
        path.write_bytes(files["model.gltf"])
    else:
        mesh.export(path)
    return path


def box(*size, at=(0, 0, 0)):
    return trimesh.creation.box(size, transform=trimesh.transformations.translation_matrix(at))


# --- meshes that are good


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "3mf", "glb", "gltf"])
def test_a_box_is_a_rectangle_of_its_thickness(tmp_path, kind):
    shape = models.shape(write_mesh(tmp_path, box(20, 10, 3, at=(7, -50, 11)), kind))
    assert shape.name == "thing"
    assert shape.area == pytest.approx(200, rel=1e-4)
    assert shape.height == pytest.approx(3, abs=1e-4)
    assert shape.inertia_over_mass == pytest.approx((20**2 + 10**2) / 12, rel=1e-4)
    assert [part.rectangle is not None for part in shape.parts] == [True]
    assert shape.symmetry == 2


@pytest.mark.parametrize(("unit", "millimetres"), [("inch", 25.4), ("micron", 0.001)])
def test_a_3mf_file_says_its_unit(tmp_path, unit, millimetres):
    path = write_mesh(tmp_path, box(20 / millimetres, 10 / millimetres, 3 / millimetres), "3mf")
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content.replace(b'unit="millimeter"', f'unit="{unit}"'.encode()))
    assert models.shape(path).area == pytest.approx(200, rel=1e-4)


def test_objects_in_files_of_their_own_in_a_3mf(tmp_path):
    """As Bambu Studio and Orca write them: one file with two parts, and one whose object has the same number."""
    path = write_mesh(tmp_path, trimesh.Scene([box(20, 10, 3), box(6, 6, 3)]), "3mf")
    with zipfile.ZipFile(path) as archive:
        objects = re.findall(
            rb'<object [^>]*id="[12]".*?</object>', archive.read("3D/3dmodel.model"), re.DOTALL
        )
    objects = [part.replace(b'id="2"', b'id="1"') for part in objects]
    namespaces = b'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:p="p"'
    wrapped = b'<model unit="millimeter" %s><resources>%s</resources><build>%s</build></model>'
    parts = [objects[0] + objects[1].replace(b'id="1"', b'id="2"'), objects[1]]
    placed = b'<object id="1"><components>%s</components></object>' % b"".join(
        b'<component p:path="/3D/%d.model" objectid="%d" transform="1 0 0 0 1 0 0 0 1 0 %d 0"/>' % place
        for place in [(0, 1, 0), (0, 2, 20), (1, 1, 40)]
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", wrapped % (namespaces, placed, b'<item objectid="1"/>'))
        for number, part in enumerate(parts):
            archive.writestr(f"3D/{number}.model", wrapped % (namespaces, part, b""))
    assert models.shape(path).area == pytest.approx(200 + 36 + 36, rel=1e-4)
    with zipfile.ZipFile(path, "a") as archive:
        inches = wrapped.replace(b"millimeter", b"inch") % (namespaces, parts[1], b"")
        archive.writestr("3D/9.model", inches)
    assert "its parts are in inch and millimeter" in refusal(path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("Metadata/model_settings.config", '<part id="1" subtype="modifier_part"/>')
    assert "a modifier_part beside the solid" in refusal(path)
    item = b'<item objectid="1"/>'
    plain = wrapped % (namespaces, objects[0], item)
    beside = b'<item objectid="1" partnumber="7" transform="1 0 0 0 1 0 0 0 1 %d 0 0"/>'
    # As SolidWorks names bodies and the parts around them.
    bodies = [re.sub(rb'name="[^"]*"', b'name="Body"', part) for part in objects]
    bodies[1] = bodies[1].replace(b'id="1"', b'id="2"')
    bodies += [
        b'<object id="%d3" name="Part(%d)"><components><component objectid="%d" '
        b'transform="1 0 0 0 1 0 0 0 1 %d 0 0"/></components></object>' % (place, place, place, 30 * place)
        for place in (1, 2)
    ]
    for name, content, expected in (
        ("3D/3dmodel.model", plain.replace(b"</mesh>", b"<b:beamlattice/></mesh>"), "a beamlattice"),
        ("3D/3dmodel.model", plain.replace(b"<mesh>", b"<v:levelset/><mesh>"), "a levelset"),
        ("3D/3dmodel.model", plain.replace(b"<object ", b'<object type="support" '), 'a type="support"'),
        ("3D/3dmodel.model", plain.replace(item, item[:-2] + b' printable="0"/>'), 'a printable="0"'),
        ("3D/3dmodel.model", plain.replace(item, b""), "its build is empty"),
        ("3D/3dmodel.model", plain.replace(item, beside % 0 + beside % 30), 400),
        (
            "3D/3dmodel.model",
            wrapped % (namespaces, b"".join(bodies), b'<item objectid="13"/><item objectid="23"/>'),
            236,
        ),
        ("3D/none", plain, "no 3D/3dmodel.model"),
        ("3D/main.model", plain, 200),
    ):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(name, content)
        if isinstance(expected, int):
            assert models.shape(path).area == pytest.approx(expected, rel=1e-4)
        else:
            assert expected in refusal(path)


def test_normals_that_are_no_numbers_do_no_harm(tmp_path, caplog):
    path = tmp_path / "thing.stl"
    text = box(20, 10, 3).export(file_type="stl_ascii")
    path.write_text(re.sub("facet normal .*", "facet normal -nan(ind) 1.#QNAN 0", text))
    assert models.shape(path).area == pytest.approx(200)
    assert not caplog.records


def test_corners_that_rounding_moved_apart_are_one(tmp_path):
    mesh = trimesh.creation.cylinder(8, 4, sections=100)
    corners = mesh.triangles + np.random.default_rng(0).uniform(-5e-5, 5e-5, mesh.triangles.shape)
    path = write_mesh(
        tmp_path,
        trimesh.Trimesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), process=False),
    )
    assert models.shape(path).area == pytest.approx(mesh.volume / 4, rel=1e-3)


@pytest.mark.parametrize("flat", [[], [[0, 0, 1]]])
def test_a_facet_with_a_repeated_corner_closes_no_gap(flat):
    """A closed mesh is taken as it is: what a boolean leaves in it may be finer than what rounding leaves."""
    ring = CrossSection.square((40, 40), True) - CrossSection.square((20, 20), True)
    solid = (ring - CrossSection.square((30, 2e-4))).extrude(4).to_mesh64()
    corners, faces = solid.vert_properties[:, :3], [*solid.tri_verts.tolist(), *flat]
    content = trimesh.Trimesh(corners, faces, process=False).export(file_type="ply")
    assert read_solid(content, "ply").genus() == 0


def test_only_the_highest_face_is_pressed(tmp_path):
    plate = box(40, 40, 2, at=(0, 0, -3)).union(box(12, 8, 6), engine="manifold")
    shape = models.shape(write_mesh(tmp_path, plate))
    assert shape.area == pytest.approx(96, rel=1e-4)
    assert shape.height == pytest.approx(7, abs=1e-4)
    assert shape.flat_depth == pytest.approx(5, abs=1e-4)
    assert [part.rectangle is not None for part in shape.parts] == [True]


def test_a_rounded_letter_is_read_with_its_rim(tmp_path):
    rounded = models.letter("E", rounding=0.5)
    path = tmp_path / "e.stl"
    models.export(rounded, path)
    shape = models.shape(path)
    assert shape.relief is not None
    assert shape.flat_depth == 0
    assert shape.area == pytest.approx(rounded.area, rel=1e-4)
    assert shape.volume == pytest.approx(rounded.volume, rel=1e-6)


def test_name_height_and_rounding_can_be_given(tmp_path):
    path = write_mesh(tmp_path, box(20, 10, 3))
    shape = models.shape(path, name="brick", height=5, rounding=0.5)
    assert (shape.name, shape.height, shape.rounding) == ("brick", 5.0, 0.5)
    assert shape.volume < 1000
    assert "rounding" in refusal(path, rounding=6)
    assert "height" in refusal(path, height=-1)
    for name in ("", "a\nb", "x" * 41, "none"):
        with pytest.raises(InputError, match="name"):
            models.shape(path, name=name)


# --- meshes that are not


def test_an_open_mesh_says_how_many_edges_are_open(tmp_path):
    mesh = box(10, 10, 4)
    mesh.update_faces(np.arange(12) != 3)
    assert "not watertight: 3 of" in refusal(write_mesh(tmp_path, mesh))


def test_a_body_that_overlaps_itself(tmp_path):
    """A band of more than one turn, as a sweep makes it: its volume counts the overlap twice."""
    turn = np.linspace(0, 2.5 * np.pi, 11)
    section = np.array([(6, 0), (10, 0), (10, 4), (6, 4)])
    x, z = (1 + 0.01 * turn[:, None]) * section[:, 0], np.tile(section[:, 1], (11, 1))
    corners = np.stack([x * np.cos(turn[:, None]), x * np.sin(turn[:, None]), z], axis=-1).reshape(-1, 3)
    sides = [
        [4 * i + j, 4 * i + (j + 1) % 4, 4 * i + 4 + (j + 1) % 4, 4 * i + 4 + j]
        for i in range(10)
        for j in range(4)
    ]
    faces = trimesh.geometry.triangulate_quads([*sides, [3, 2, 1, 0], [40, 41, 42, 43]])
    path = write_mesh(tmp_path, trimesh.Trimesh(corners, faces, process=False))
    assert "cuts through itself" in refusal(path)


BODIES = {  # boxes, which of them are inside out, footprint and volume
    "apart, two inside out": ([box(10, 10, 4), box(9, 9, 4, at=(15, 0, 0)), box(4, 4, 4, at=(-9, 0, 0))], [0, 2],
                              197, 788),
    "overlapping": ([box(10, 10, 4), box(10, 10, 4, at=(5, 0, 0))], [1], 150, 600),
    "touching at an edge": ([box(10, 10, 4), box(10, 10, 4, at=(10, 10, 0))], [], 200, 800),
    "sharing a wall": ([box(10, 10, 4), box(10, 10, 4, at=(10, 0, 0))], [], 200, 800),
    "one of two there twice": ([box(10, 10, 4), box(10, 10, 4), box(9, 9, 4, at=(15, 0, 0))], [], 181, 724),
    "a void, all inside out": ([box(20, 20, 20), box(10, 10, 10, at=(3, 0, 0))], [0], 400, 7000),
    "a solid in a solid": ([box(20, 20, 20), box(10, 10, 10)], [], 400, 8000),
    "a core in a void": ([box(20, 20, 20), box(10, 10, 10), box(4, 4, 4)], [1], 400, 7064),
    "a void beside a body": ([box(20, 20, 20), box(9, 9, 9), box(5, 5, 20, at=(20, 0, 0))], [1], 425, 8000 - 729 + 500),
}  # fmt: skip


@pytest.mark.parametrize("name", BODIES)
def test_bodies_are_turned_right_side_out_and_joined(tmp_path, name):
    bodies, inverted, area, volume = BODIES[name]
    bodies = [body.copy() for body in bodies]
    for index in inverted:
        bodies[index].invert()
    path = write_mesh(tmp_path, trimesh.util.concatenate(bodies))
    assert models.shape(path).area == pytest.approx(area, rel=1e-5)
    assert models.shape(path).volume == pytest.approx(volume, rel=1e-5)
    assert models.read_solid_file(path).volume == pytest.approx(volume, rel=1e-5)


def test_what_is_no_polygon_of_a_ply_is_no_face(tmp_path):
    corners = "".join(f"{x} {y} {z}\n" for x, y, z in [(0, 0, 0), (9, 0, 0), (0, 9, 0), (0, 0, 9)])
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    path = tmp_path / "thing.ply"
    path.write_text(f"{head}end_header\n{corners}")
    assert "there is no face in it" in refusal(path)


def test_height_and_rounding_are_not_for_relief(tmp_path):
    path = write_mesh(tmp_path, trimesh.creation.icosphere(3, 8))
    assert models.shape(path).relief is not None
    assert "relief" in refusal(path, height=5)
    assert "relief" in refusal(path, rounding=0.1)


def test_sizes_that_no_pad_covers_or_feels(tmp_path):
    assert "reaches 600 mm sideways" in refusal(write_mesh(tmp_path, box(1200, 10, 4)))
    assert models.shape(write_mesh(tmp_path, box(32, 10, 4))).area == pytest.approx(320, rel=1e-4)
    assert "metres in .glb" in refusal(write_mesh(tmp_path, box(0.02, 0.02, 4)))
    assert "mm thick" in refusal(write_mesh(tmp_path, box(20, 20, 0.004)))
    assert "mm from the origin" in refusal(write_mesh(tmp_path, box(1e30, 10, 4)))
    path = tmp_path / "mm.glb"
    box(20, 10, 3).export(path)  # in mm, where glTF prescribes metres
    assert "metres in .glb" in refusal(path)


@pytest.mark.parametrize("bad", ["nan", "1e999"])
def test_corners_that_are_not_numbers(tmp_path, bad):
    path = write_mesh(tmp_path, box(10, 10, 4), "obj")
    path.write_text(re.sub(r"-5\.0+", bad, path.read_text(), count=1))
    assert f" {bad}" in path.read_text()
    assert "not a finite number" in refusal(path)


SIDES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def test_facets_of_a_text_stl_may_have_four_corners(tmp_path):
    """And a facet of two corners is none."""
    corner = np.array([(x, y, z) for z in (0, 3) for y in (0, 10) for x in (0, 20)])
    facets = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in corner[list(side)]) for side in SIDES]
    path = tmp_path / "thing.stl"

    def write(facets):
        body = "".join(f"facet normal 0 0 0\nouter loop\n{one}endloop\nendfacet\n" for one in facets)
        path.write_text(f"solid thing\n{body}endsolid thing\n")

    write(facets)
    assert models.shape(path).area == pytest.approx(200)
    write([*facets[:5], "vertex 0 0 0\nvertex 1 0 0\n"])
    assert "not watertight" in refusal(path)


@pytest.mark.parametrize("count", [0, 11, -1])
def test_a_binary_stl_whose_writer_left_its_count_has_the_facets_that_it_holds(tmp_path, count):
    path = tmp_path / "thing.stl"
    whole = box(20, 10, 3).export(file_type="stl")
    for behind in (b"", b"and a few words") if count != 11 else (b"",):
        path.write_bytes(whole[:80] + struct.pack("<i", count) + whole[84:] + behind)
        assert models.shape(path).area == pytest.approx(200)
    path.write_bytes(bytes(84))
    assert "there is no face in it" in refusal(path)


def test_strips_of_triangles_are_refused_by_their_name(tmp_path):
    path = tmp_path / "thing.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    path.write_text(
        f"{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    assert "strips of triangles" in refusal(path)


def test_a_million_faces_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / "thing.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", 1_000_000) + bytes(50_000_000))
    assert "1,000,000 faces" in refusal(path)
    path = tmp_path / "thing.obj"
    path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0" + b"\nf 1 2 3" * 600_000)
    assert "600,000 faces" in refusal(path)
    path = tmp_path / "thing.stl"
    with path.open("wb") as stream:
        stream.truncate(1 << 30)
    assert "larger than 67,108,864 bytes" in refusal(path)


def heap(count):
    """Lay boxes over one another, all as high."""
    rng = np.random.default_rng(0)
    body = trimesh.creation.box((6, 4, 4))
    angle, shift = rng.uniform(0, 7, count), rng.uniform(-3, 3, (count, 2))
    x, y, z = body.vertices.T
    turned = np.stack([np.outer(np.cos(angle), x) - np.outer(np.sin(angle), y) + shift[:, :1],
                       np.outer(np.sin(angle), x) + np.outer(np.cos(angle), y) + shift[:, 1:],
                       np.tile(z, (count, 1))], axis=-1)  # fmt: skip
    faces = (body.faces[None] + 8 * np.arange(count)[:, None, None]).reshape(-1, 3)
    return trimesh.Trimesh(turned.reshape(-1, 3), faces, process=False)


@pytest.mark.long
def test_a_heap_of_boxes_is_refused_soon_and_one_just_small_enough_is_read(tmp_path):
    path = tmp_path / "heap.stl"
    heap(20_000).export(path)
    assert "20,000 bodies" in refusal(path)
    heap(2000).export(path)
    assert 100 < models.shape(path).area < 200


def test_paths_that_are_no_files(tmp_path):
    assert "No such file" in refusal(tmp_path / "missing.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "not a regular file" in refusal(tmp_path / "folder.stl")
    os.mkfifo(tmp_path / "pipe.stl")
    assert "not a regular file" in refusal(tmp_path / "pipe.stl")
    assert ".glb, .gltf and .svg" in refusal(tmp_path / "thing.step")


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
GLTF = {
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}],
}  # fmt: skip


def glb(tree):
    text = tree if isinstance(tree, bytes) else json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(TRIANGLE), b"BIN\0") + TRIANGLE
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"buffers": [{"byteLength": 36, "uri": "../../etc/passwd"}]}, "other files"),
        ({"asset": {"version": "1.0"}, "meshes": {}, "accessors": {"a": {}}}, "no glTF 2.0"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco"),
        ({"extensionsUsed": ["EXT_mesh_gpu_instancing"]}, "EXT_mesh_gpu_instancing"),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "faces; the most"),
        ({"accessors": [{"componentType": 5126, "count": 10**5, "type": "VEC3"}]}, "not a whole GLB"),
        ({"accessors": [{"count": -5}]}, "not a whole GLB"),
        ({"accessors": [{"count": 3, "sparse": {"count": 3}}]}, "sparse accessors"),
        ({"extensionsRequired": ["KHR_materials_unlit"]}, "not watertight"),
        ({"nodes": [{"mesh": 0}] * 100_000}, "faces; the most"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "not watertight"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 6}]}]}, "fans of triangles"),
        ({"nodes": [{"mesh": 0, "skin": 0}]}, "bones or shape keys"),
        ({"nodes": [{"mesh": 0, "weights": [0.0, 0.5]}]}, "bones or shape keys"),
    ],
)
def test_hostile_glb(tmp_path, change, expected):
    path = tmp_path / "thing.glb"
    path.write_bytes(glb({**copy.deepcopy(GLTF), **change}))
    assert expected in refusal(path)
