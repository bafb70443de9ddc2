"""A user's mesh: what is read, and the one line that says what is wrong."""

import numpy as np
import pytest
import trimesh

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.solids.symmetry import crossings


def write(path, vertices, faces):
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def mesh_of(name):
    solid = models.solid(name)
    return solid.vertices.copy(), solid.faces.copy()


def test_a_mesh_becomes_the_same_solid(tmp_path):
    vertices, faces = mesh_of("bracket")
    path = write(tmp_path / "mine.stl", vertices + [5, 6, 7], faces)
    solid = models.read_solid_file(path)
    assert solid.name == "mine"
    assert models.read_solid_file(path, "my bracket").name == "my bracket"
    known = models.solid("bracket")
    assert solid.volume == pytest.approx(known.volume, rel=1e-5)
    assert solid.inertia == pytest.approx(known.inertia, rel=1e-4, abs=1e-3)
    assert solid.vertices.min(axis=0) == pytest.approx(known.vertices.min(axis=0), abs=1e-4)
    assert solid.symmetry.order == 1


def test_a_mesh_that_cuts_through_itself_is_refused(tmp_path):
    # One leg of the tetrapod is bent back until it has passed through the one beside it.
    vertices, faces = mesh_of("tetrapod")
    leg = np.linalg.norm(vertices[:, :2], axis=1) < 7
    leg &= vertices[:, 2] > 9
    vertices[leg] += np.array([18.0, 0, -22]) * ((vertices[leg, 2:] - 9) / 18)
    path = write(tmp_path / "knot.stl", vertices, faces)
    with pytest.raises(
        InputError, match=r"knot\.stl: the mesh cuts through itself: \d+ pairs of its faces"
    ) as error:
        models.read_solid_file(path)
    assert "\n" not in str(error.value)


def test_crossing_faces_are_those_that_brute_force_finds():
    rng = np.random.default_rng(8)
    corners = rng.uniform(0, 10, (30, 1, 3)) + rng.uniform(-3, 3, (30, 3, 3))
    found = {tuple(pair) for pair in crossings(corners).tolist()}
    expected = {(a, b) for a in range(30) for b in range(a + 1, 30) if _cross(corners[a], corners[b])}
    assert expected
    assert found == expected


def _cross(one, other):
    """Cut each edge with the other's plane, and see whether the point is inside by its barycentric shares."""
    for edges, triangle in ((one, other), (other, one)):
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        for start, end in zip(edges, np.roll(edges, -1, axis=0), strict=True):
            before, after = (start - triangle[0]) @ normal, (end - triangle[0]) @ normal
            if before * after < 0:
                point = start + (end - start) * before / (before - after)
                shares = np.linalg.lstsq(
                    np.vstack([triangle.T, np.ones(3)]), np.append(point, 1), rcond=None
                )[0]
                if shares.min() > 0:
                    return True
    return False


def test_a_fine_mesh_of_a_large_thing_is_thinned_out_and_that_is_said(tmp_path, caplog):
    ball = trimesh.creation.icosphere(6, 50)
    ball.apply_scale([3, 1, 2])
    ball.export(tmp_path / "fine.stl")
    solid = models.read_solid_file(tmp_path / "fine.stl")
    assert len(ball.faces) > 80_000 > 20_000 >= len(solid.faces) > 2_000
    assert solid.volume == pytest.approx(ball.volume, rel=5e-3)
    assert "its 81,920 faces are thinned out to" in caplog.text
    assert "mm at most" in caplog.text


def test_what_is_no_solid_is_said_in_a_line(tmp_path):
    vertices, faces = mesh_of("egg")
    far = write(tmp_path / "large.stl", vertices * 9, faces)
    (tmp_path / "mine.step").write_text("x")
    for path, message in (
        (
            far,
            r"large\.stl: 'large': the solid measures 360 x 360 x 468 mm; its longest side must measure 5 to 300 mm",
        ),
        (
            tmp_path / "mine.step",
            r"mine\.step: solids are read from \.stl, \.obj, \.ply, \.3mf, \.glb, \.gltf files, not \.step",
        ),
        (tmp_path / "none.stl", r"cannot read solid .*none\.stl"),
    ):
        with pytest.raises(InputError, match=message):
            models.read_solid_file(path)
    with pytest.raises(InputError, match="is no name for a solid"):
        models.read_solid_file(write(tmp_path / "egg.stl", vertices, faces), "")
