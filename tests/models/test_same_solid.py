"""However a program writes a solid to a mesh file, the same solid is read."""

import functools
import math
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, Manifold, OpType

from tactsim import models
from tactsim.models.letter import TOLERANCE, rotational_order
from tactsim.models.mesh import read_solid

WITHIN = 0.005  # share of volume and footprint


def boxes(*bodies):
    """Make boxes of (size, middle), mm, each one by itself."""
    return [Manifold.cube(size, True).translate(middle) for size, middle in bodies]


@functools.cache
def known_solids():
    """Give solids as the bodies that a file has of them: (union of those outside, bodies)."""
    dart = CrossSection([np.array([(0, 0), (10, 4), (20, 0), (10, 20)], dtype=float)])
    outlines = {name: models.letter(name).footprint for name in "CL"} | {"dart": dart}
    made = {f"prism {name}": [outline.extrude(4)] for name, outline in outlines.items()}
    made |= {name: [models.solid(name).manifold] for name in ("bracket", "key")}
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


def as_text(draw, lines, ends=ENDS):
    """Write lines as one program or another does."""
    text = draw(st.sampled_from(ends)).join(lines) + draw(st.sampled_from(["", "\n", "\r\n\n"]))
    text = text.replace(" ", draw(st.sampled_from([" ", "\t", "  "])))
    return text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "latin-1", "utf-16"])))


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
    return as_text(draw, lines, [*ENDS, " "])


def obj(draw, vertices, polygons):
    number = draw(st.sampled_from(NUMBERS)).format
    corner = draw(st.sampled_from(["{0}", "{0}//1", "{0}/1", "{0}/1/1"])).format
    backwards = draw(st.booleans())
    lines = ["# Gr\u00fc\u00dfe", "mtllib a.mtl", "o thing"]
    more = draw(st.sampled_from(["", " 0.5 0.5 0.5"]))
    lines += ["v " + " ".join(map(number, vertex)) + more for vertex in vertices]
    lines += ["vn 0 0 1", "vt 0 0", "usemtl a", "s off", "g thing"]
    shift = -len(vertices) if backwards else 1
    note = draw(st.sampled_from(["", " # a face"]))
    lines += ["f " + " ".join(corner(index + shift) for index in face) + note for face in polygons]
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
        return (end.join(head + lines) + end).encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])))
    order = "<" if "little" in kind else ">"
    faces = b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in polygons)
    return (end.join(head) + end).encode() + vertices.astype(f"{order}f8").tobytes() + faces


def check_same(content, kind, expected):
    """Assert that what is read has the volume and the footprint of `expected`."""
    solid = read_solid(content, kind)
    assert solid.volume() == pytest.approx(expected.volume(), rel=WITHIN)
    assert solid.project().area() == pytest.approx(expected.project().area(), rel=WITHIN)


QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@QUICK
@given(data=st.data())
def test_triangles_in_any_order_and_file_are_the_same_solid(data):
    bodies = known_solids()[data.draw(st.sampled_from(sorted(known_solids())))]
    expected = Manifold.batch_boolean(bodies, OpType.Add)
    parts = [changed(data.draw, *part) for part in meshes_of(bodies)]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    polygons = [
        [int(start) + corner for corner in face]
        for start, (_, faces) in zip(starts, parts, strict=False)
        for face in faces
    ]
    write, kind = data.draw(
        st.sampled_from([(obj, "obj"), (ply, "ply"), (binary_stl, "stl"), (text_stl, "stl")])
    )
    check_same(write(data.draw, vertices, polygons), kind, expected)


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


def regular(sides, radius=12.0, phase=0.0):
    angle = phase + np.arange(sides) * 2 * math.pi / sides
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


EXPECTED = dict.fromkeys("HINSXZ0", 2) | {"O": math.inf}


def test_the_order_of_each_glyph():
    orders = {name: models.letter(name).symmetry for name in models.names()}
    assert {name: order for name, order in orders.items() if order != 1} == EXPECTED


@pytest.mark.parametrize("sides", [3, 4, 6, 15, 24, 30])
def test_regular_polygons_have_the_order_of_their_sides(sides):
    assert rotational_order([regular(sides, phase=0.123)]) == sides


@pytest.mark.parametrize("sides", [36, 97, 400])
def test_a_fine_regular_polygon_is_a_circle(sides):
    assert 12 * (1 - math.cos(math.pi / sides)) < TOLERANCE
    assert rotational_order([regular(sides)]) == math.inf


def test_a_ring_is_a_circle_unless_its_hole_is_off_the_centre():
    outer, inner = regular(64), regular(64, 8.0)[::-1]
    assert rotational_order([outer, inner]) == math.inf
    assert rotational_order([outer, inner + [0.2, 0]]) == 1


def test_a_small_notch_breaks_the_symmetry():
    ring = CrossSection.circle(12, 64) - CrossSection.circle(8, 64)
    notch = CrossSection.square((0.5, 0.5)).translate((11.7, 0))
    assert rotational_order((ring - notch).to_polygons()) == 1
    assert rotational_order((ring - notch - notch.rotate(120) - notch.rotate(240)).to_polygons()) == 3


def test_the_order_does_not_depend_on_the_orientation():
    for name, order in (("S", 2), ("A", 1)):
        turned = models.letter(name).footprint.rotate(201.3)
        assert rotational_order(turned.to_polygons()) == order


def test_deviations_below_the_tolerance_do_not_count_and_above_do():
    box = np.array([[-10, -3], [10, -3], [10, 3], [-10, 3]], dtype=float)
    for shift, order in ((0.8 * TOLERANCE, 2), (2.2 * TOLERANCE, 1)):
        dented = box.copy()
        dented[2, 0] += shift
        assert rotational_order([dented]) == order
