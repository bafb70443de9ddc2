"""However a program writes a solid to a mesh file, the same solid is read."""

import functools
import io
import json
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, Manifold, OpType

from tactsim import models
from tactsim.models.mesh import read_solid

WITHIN = 0.005  # share of volume and footprint


def boxes(*bodies):
    """Make boxes of (size, middle), mm, each one by itself."""
    return [Manifold.cube(size, True).translate(middle) for size, middle in bodies]


@functools.cache
def known_solids():
    """Give solids as the bodies that a file has of them: (union of those outside, bodies)."""
    dart = CrossSection([np.array([(0, 0), (10, 4), (20, 0), (10, 20)], dtype=float)])
    outlines = {name: models.letter(name).footprint for name in "CELS"} | {"dart": dart}
    made = {f"prism {name}": [outline.extrude(4)] for name, outline in outlines.items()}
    made |= {name: [models.solid(name).manifold] for name in ("bracket", "mug", "key", "tetrapod")}
    made["two boxes"] = boxes(((10, 10, 4), (0, 0, 0)), ((8, 8, 4), (15, 0, 0)))
    made["overlapping boxes"] = boxes(((10, 10, 4), (0, 0, 0)), ((10, 10, 4), (5, 3, 1)))
    return made


def meshes_of(bodies):
    """Give each body's (vertices (v, 3) mm, polygons, lists of vertices)."""
    parts = []
    for body in bodies:
        mesh = body.to_mesh64()
        parts.append(
            (np.array(mesh.vert_properties[:, :3]), [list(map(int, face)) for face in mesh.tri_verts])
        )
    return parts


def prism(outline, height=4.0):
    """Make a prism's mesh with one polygon for each flat face."""
    count = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(count, z)]) for z in (0.0, height)])
    sides = [[i, (i + 1) % count, (i + 1) % count + count, i + count] for i in range(count)]
    return vertices, [[*range(count - 1, -1, -1)], [*range(count, 2 * count)], *sides]


def changed(draw, vertices, polygons):
    """Write the same facets in another order, from other corners, some twice, some with a repeated corner."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    polygons = [list(np.roll(face, rng.integers(len(face)))) for face in polygons]
    kinds = draw(
        st.sets(st.sampled_from(["order", "twice", "twice reversed", "repeated", "numbers", "flip some"]))
    )
    if draw(st.booleans()):
        polygons = [face[::-1] for face in polygons]
    if "flip some" in kinds:
        polygons = [face[::-1] if rng.random() < 0.1 else face for face in polygons]
    some = [polygons[index] for index in rng.integers(len(polygons), size=3)]
    if "twice" in kinds:
        polygons = [*polygons, *[list(np.roll(face, 1)) for face in some]]
    if "twice reversed" in kinds:
        polygons = [*polygons, *[face[::-1] for face in some]]
    if "repeated" in kinds:
        polygons = [*polygons, *[[face[0], face[0], face[1]] for face in some]]
        polygons += [[face[0], face[1], face[0]] for face in some]
        polygons = [
            [*face[:2], face[1], *face[2:]] if len(face) > 3 and rng.random() < 0.5 else face
            for face in polygons
        ]
    if "order" in kinds:
        polygons = [polygons[index] for index in rng.permutation(len(polygons))]
    if "numbers" in kinds:
        place = rng.permutation(len(vertices))
        vertices = vertices[np.argsort(place)]
        polygons = [[int(place[corner]) for corner in face] for face in polygons]
    return vertices, polygons


def triangles(vertices, polygons):
    """Give the corners of polygons of three corners, (f, 3, 3)."""
    return vertices[np.array(polygons)]


def binary_stl(draw, vertices, polygons):
    corners = triangles(vertices, polygons)
    records = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    records["corners"], records["more"] = corners, draw(st.sampled_from([0, 0xFFFF]))
    head = draw(st.sampled_from([b"", b"solid thing", b"facet of \xff", b"\xef\xbb\xbfsolid"]))
    tail = draw(st.sampled_from([b"", b"\0\0", b"\n trailing", b"endsolid", b"\0" * 60]))
    return (
        head.ljust(80, draw(st.sampled_from([b" ", b"\0"])))
        + struct.pack("<I", len(corners))
        + records.tobytes()
        + tail
    )


NUMBERS = ["{:.9g}", "{:.8e}", "{:+.7f}", "{:.6E}"]
ENDS = ["\n", "\r\n", "\r", "\n\n"]


def as_text(draw, lines):
    """Write lines as one program or another does."""
    text = draw(st.sampled_from(ENDS)).join(lines) + draw(st.sampled_from(["", "\n", "\r\n\n"]))
    text = text.replace(" ", draw(st.sampled_from([" ", "\t", "  "])))
    return text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "latin-1"])))


def text_stl(draw, vertices, polygons):
    number = draw(st.sampled_from(NUMBERS)).format
    name = draw(st.sampled_from(["", " thing", " Gr\u00fc\u00dfe", " a facet of a vertex", " endsolid"]))
    indent = draw(st.sampled_from(["", "   "]))
    lines = [f"solid{name}"]
    for corners in triangles(vertices, polygons):
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [indent + "vertex " + " ".join(map(number, corner)) for corner in corners]
        lines += ["endloop", "endfacet"]
    lines.append(f"endsolid{name}")
    if draw(st.booleans()):
        lines = [line.upper() for line in lines]
    return as_text(draw, lines)


def obj(draw, vertices, polygons):
    number = draw(st.sampled_from(NUMBERS)).format
    corner = draw(st.sampled_from(["{0}", "{0}//1", "{0}/1", "{0}/1/1"])).format
    backwards = draw(st.booleans())
    lines = ["# Gr\u00fc\u00dfe", "mtllib a.mtl", "o thing"]
    more = draw(st.sampled_from(["", " 0.5 0.5 0.5"]))
    lines += ["v " + " ".join(map(number, vertex)) + more for vertex in vertices]
    lines += ["vn 0 0 1", "vt 0 0", "usemtl a", "s off", "g thing"]
    shift = -len(vertices) if backwards else 1
    lines += ["f " + " ".join(corner(index + shift) for index in face) for face in polygons]
    return as_text(draw, lines)


def ply(draw, vertices, polygons):
    """Write PLY, as text or in either order of bytes."""
    kind = draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]))
    name = draw(st.sampled_from(["vertex_indices", "vertex_index"]))
    end = draw(st.sampled_from(["\n", "\r\n"])) if kind == "ascii" else "\n"
    head = ["ply", f"format {kind} 1.0", "comment made", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(polygons)}", f"property list uchar int {name}", "end_header"]
    if kind == "ascii":
        lines = [" ".join(map(repr, vertex)) for vertex in vertices.tolist()]
        lines += [" ".join(map(str, (len(face), *face))) for face in polygons]
        return (end.join(head + lines) + end).encode()
    order = "<" if "little" in kind else ">"
    faces = b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in polygons)
    return (end.join(head) + end).encode() + vertices.astype(f"{order}f8").tobytes() + faces


UNITS_OF_3MF = {"millimeter": 1.0, "micron": 1e-3, "centimeter": 10.0, "inch": 25.4, "meter": 1000.0, "": 1.0}


def three_mf(draw, parts):
    """Write one object a body, moved there by its item."""
    unit = draw(st.sampled_from([*UNITS_OF_3MF]))
    shift = np.array(draw(st.sampled_from([(0.0, 0.0, 0.0), (3.0, -4.0, 5.0)])))
    objects, items = "", ""
    for index, (vertices, faces) in enumerate(parts, 1):
        places = (vertices - shift) / UNITS_OF_3MF[unit]
        corners = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in places.tolist())
        three = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
        objects += (
            f'<object id="{index}" type="model"><mesh><vertices>{corners}</vertices>'
            f"<triangles>{three}</triangles></mesh></object>"
        )
        move = " ".join(map(repr, (shift / UNITS_OF_3MF[unit]).tolist()))
        items += f'<item objectid="{index}" transform="1 0 0 0 1 0 0 0 1 {move}"/>'
    named = f' unit="{unit}"' if unit else ""
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?><model{named} '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f"<resources>{objects}</resources><build>{items}</build></model>"
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr(
            "_rels/.rels",
            '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship '
            'Target="/3D/3dmodel.model" Id="rel0" '
            'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
        )
        archive.writestr("3D/3dmodel.model", model)
    return content.getvalue()


def glb(draw, parts):
    """Write one node a body in metres, y up; nodes are moved, turned, scaled or mirrored; corners are shared or not."""
    look = draw(st.sampled_from(["plain", "scaled", "matrix", "mirrored", "nested"]))
    listed = draw(st.booleans())
    nodes, meshes, accessors, views, data = [], [], [], [], b""

    def add(array, kind, component):
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind}
        )
        if kind == "VEC3":
            accessors[-1] |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        data += array.tobytes() + bytes(-array.nbytes % 4)
        return len(accessors) - 1

    for vertices, faces in parts:
        places = 1e-3 * vertices[:, [0, 2, 1]] * [1, 1, -1]
        corners = np.array(faces)
        node = {"mesh": len(meshes)}
        if look in ("scaled", "nested"):  # as of a program that works in mm
            places, node["scale"] = places * 1000, [1e-3] * 3
            node["translation"], places = [0.5, 0, -0.25], places - np.array([500, 0, -250.0])
        elif look == "matrix":
            node["matrix"] = [
                0,
                1,
                0,
                0,
                -1,
                0,
                0,
                0,
                0,
                0,
                1,
                0,
                0,
                0,
                0,
                1,
            ]  # a quarter turn about z, by columns
            places = places @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        elif look == "mirrored":
            node["scale"], places, corners = [-1, 1, 1], places * [-1, 1, 1], corners[:, ::-1]
        if listed:
            points = add(places.astype("<f4"), "VEC3", 5126)
            primitive = {
                "attributes": {"POSITION": points},
                "indices": add(corners.astype("<u4").ravel(), "SCALAR", 5125),
            }
        else:
            points = add(places[corners].reshape(-1, 3).astype("<f4"), "VEC3", 5126)
            primitive = {"attributes": {"POSITION": points}}
        meshes.append({"primitives": [primitive]})
        nodes.append(node)
    roots = [*range(len(nodes))]
    if look == "nested":
        nodes.append({"children": roots, "translation": [0.001, 0.002, 0.003]})
        roots = [len(nodes) - 1]
    tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes, "meshes": meshes,
            "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}]}  # fmt: skip
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def check_same(content, kind, expected):
    """Assert that what is read has the volume and the footprint of `expected`."""
    solid = read_solid(content, kind)
    assert solid.volume() == pytest.approx(expected.volume(), rel=WITHIN)
    assert solid.project().area() == pytest.approx(expected.project().area(), rel=WITHIN)


QUICK = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@QUICK
@given(data=st.data())
def test_triangles_in_any_order_and_file_are_the_same_solid(data):
    bodies = known_solids()[data.draw(st.sampled_from(sorted(known_solids())))]
    expected = Manifold.batch_boolean(bodies, OpType.Add)
    kind = data.draw(st.sampled_from(["stl", "text stl", "obj", "ply", "3mf", "glb"]))
    parts = [changed(data.draw, *part) for part in meshes_of(bodies)]
    if kind in ("3mf", "glb"):
        content = (three_mf if kind == "3mf" else glb)(data.draw, parts)
    else:
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        vertices = np.concatenate([vertices for vertices, _ in parts])
        polygons = [
            [int(start) + corner for corner in face]
            for start, (_, faces) in zip(starts, parts, strict=False)
            for face in faces
        ]
        write = {"stl": binary_stl, "text stl": text_stl, "obj": obj, "ply": ply}[kind]
        content = write(data.draw, vertices, polygons)
    check_same(content, kind.split()[-1], expected)


@QUICK
@given(data=st.data())
def test_polygons_of_any_outline_are_cut_as_they_are_meant(data):
    name = data.draw(st.sampled_from(["C", "E", "L", "S", "T", "5", "W"]))
    (outline,) = models.letter(name).contours
    vertices, polygons = prism(outline)
    turn = data.draw(st.sampled_from([0.0, 30.0, 90.0, 200.0]))
    tilt = np.radians(data.draw(st.sampled_from([0.0, 0.0, 40.0, 90.0])))
    expected = models.letter(name).footprint.extrude(4).rotate((0, 0, turn)).rotate((np.degrees(tilt), 0, 0))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    vertices = vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    c, s = np.cos(tilt), np.sin(tilt)
    vertices = vertices @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    write, kind = data.draw(st.sampled_from([(obj, "obj"), (ply, "ply")]))
    check_same(write(data.draw, *changed(data.draw, vertices, polygons)), kind, expected)


@QUICK
@given(data=st.data())
def test_a_void_stays_a_void(data):
    outer = Manifold.cube((20, 20, 20), True)
    inner = models.solid("egg").manifold.scale((0.3, 0.3, 0.3))
    parts = meshes_of([outer, inner])
    parts[1] = (parts[1][0], [face[::-1] for face in parts[1][1]])
    vertices = np.concatenate([part[0] for part in parts])
    polygons = parts[0][1] + [[corner + len(parts[0][0]) for corner in face] for face in parts[1][1]]
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    polygons = [polygons[index] for index in rng.permutation(len(polygons))]
    if data.draw(st.booleans()):
        polygons = [face[::-1] for face in polygons]
    write, kind = data.draw(
        st.sampled_from([(obj, "obj"), (ply, "ply"), (binary_stl, "stl"), (text_stl, "stl")])
    )
    check_same(write(data.draw, vertices, polygons), kind, outer - inner)
