import math

import mujoco
import numpy as np
import pytest
import trimesh

from tactsim import models
from tactsim.core.errors import InputError

LETTERS = [{"name": "A"}, {"name": "O"}, {"name": "R", "rounding": 0.3, "height": 2.5}]


@pytest.fixture(params=LETTERS, ids=lambda options: options["name"])
def letter(request):
    return models.letter(**request.param)


def test_stl_and_glb_load_again_with_the_same_volume_and_shape(letter, tmp_path):
    for suffix, millimetre in (("stl", 1.0), ("glb", 1e-3)):
        path = tmp_path / f"letter.{suffix}"
        models.export(letter, path)
        mesh = trimesh.load_mesh(path)
        if suffix == "glb":
            mesh.vertices = mesh.vertices[:, [0, 2, 1]] * [1, -1, 1]  # y is up there
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        assert mesh.is_watertight
        assert mesh.volume / millimetre**3 == pytest.approx(letter.volume, rel=1e-6)
        assert mesh.bounds[:, 2] / millimetre == pytest.approx([0, letter.height], abs=1e-6)
        again = models.shape(path, name=letter.name)
        # Coordinates of 32 bits, and gaps thinner than 0.01 mm closed where arcs meet.
        assert (again.footprint - letter.footprint).area() < 5e-3
        assert (letter.footprint - again.footprint).area() < 5e-3


def test_mjcf_loads_with_the_same_mass_and_inertia(letter, tmp_path):
    path = tmp_path / "letter.xml"
    models.export(letter, path)
    model = mujoco.MjModel.from_xml_path(str(path))
    body = model.body(letter.name)
    assert model.ngeom == len(letter.parts)
    assert body.mass[0] == pytest.approx(letter.mass, rel=1e-6)
    if not letter.rounding:
        assert body.ipos * 1000 == pytest.approx([0, 0, letter.height / 2], abs=1e-4)
        about_z = letter.mass * letter.inertia_over_mass * 1e-6
        assert _inertia(body)[2, 2] == pytest.approx(about_z, rel=1e-4)


def _inertia(body):
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    turn = turn.reshape(3, 3)
    return turn @ np.diag(body.inertia) @ turn.T


def test_boxes_in_mjcf_lie_on_their_parts(tmp_path):
    letter = models.letter("E")
    models.export(letter, tmp_path / "e.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "e.xml"))
    assert set(model.geom_type) == {int(mujoco.mjtGeom.mjGEOM_BOX)}
    for index, part in enumerate(letter.parts):
        low, high = part.outline.min(axis=0), part.outline.max(axis=0)
        size = model.geom_size[index][:2] * 1000
        angle = 2 * math.atan2(model.geom_quat[index][3], model.geom_quat[index][0])
        along = np.abs([math.cos(angle), math.sin(angle)])
        extent = size[0] * along + size[1] * along[::-1]
        assert model.geom_pos[index][:2] * 1000 == pytest.approx((low + high) / 2, abs=1e-9)
        assert extent == pytest.approx((high - low) / 2, abs=1e-9)


def test_an_unknown_format_and_a_place_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"\.stl, \.glb and \.xml"):
        models.export(models.letter("I"), tmp_path / "letter.step")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        models.export(models.letter("I"), tmp_path / "file" / "below.stl")
