"""Write a letter for other programs: STL and GLB for printing and viewing, MJCF for MuJoCo."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.files import write_bytes
from tactsim.core.poses import FloatArray
from tactsim.models.letter import DENSITY, Letter


def export(letter: Letter, path: str | Path) -> None:
    """Write `letter` in the format that the ending of `path` names, whole or not at all.

    .stl: the solid, mm, binary. .glb: the solid, metres and y up, as glTF prescribes. .xml: MJCF, metres, one fixed
    body with a box or a convex mesh for each part. In .stl and .xml x, y, z are the object frame's; in .glb (x, y, z)
    is (x, z, -y).

    Raises InputError for another ending or a place that cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".stl":
        content = _mesh(letter, np.eye(3), "stl")
    elif suffix == ".glb":
        content = _mesh(letter, 1e-3 * np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), "glb")
    elif suffix == ".xml":
        content = _mjcf(letter)
    else:
        raise InputError(f"cannot export to {path}: the formats are .stl, .glb and .xml (MJCF)")
    write_bytes(path, content)


def _mesh(letter: Letter, axes: FloatArray, kind: str) -> bytes:
    import trimesh

    solid = letter.solid.to_mesh64()
    mesh = trimesh.Trimesh(solid.vert_properties[:, :3] @ axes.T, solid.tri_verts, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name=letter.name, geom_name=letter.name)
    content = BytesIO()
    scene.export(content, file_type=kind)
    return content.getvalue()


def _mjcf(letter: Letter) -> bytes:
    root = ElementTree.Element("mujoco", model=letter.name)
    asset = ElementTree.SubElement(root, "asset")
    world = ElementTree.SubElement(root, "worldbody")
    body = ElementTree.SubElement(world, "body", name=letter.name)
    density = f"{DENSITY * 1e9:g}"  # kg / m^3
    for index, part in enumerate(letter.parts):
        name = f"{letter.name}-{index}"
        if part.rectangle is not None:
            (x, y), (half_x, half_y), angle = part.rectangle
            half_z = letter.height / 2
            ElementTree.SubElement(
                body, "geom", name=name, type="box", density=density,
                pos=_metres(x, y, half_z), size=_metres(half_x, half_y, half_z),
                quat=f"{np.cos(angle / 2)!s} 0 0 {np.sin(angle / 2)!s}",
            )  # fmt: skip
        else:
            ElementTree.SubElement(asset, "mesh", name=name, vertex=_metres(*part.vertices.ravel()))
            ElementTree.SubElement(body, "geom", name=name, type="mesh", mesh=name, density=density)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _metres(*lengths: float) -> str:
    return " ".join(repr(float(length) / 1000) for length in lengths)
