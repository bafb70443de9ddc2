"""`Solid`: volume, mass and inertia against closed forms, points on its surface, and what is refused."""

import pickle

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from scipy.stats import chisquare

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.letter import DENSITY
from tactsim.solids import mirrored, solid_of


def test_a_box_weighs_and_turns_as_the_textbook_says():
    a, b, c = 20.0, 30.0, 50.0
    box = solid_of("box", Manifold.cube((a, b, c)).translate((7, -80, 900)))
    assert box.volume == pytest.approx(a * b * c, rel=1e-12)
    assert box.mass == pytest.approx(0.0315)
    assert box.vertices.min(axis=0) == pytest.approx([-a / 2, -b / 2, -c / 2], abs=1e-9)
    assert box.radius == pytest.approx(np.sqrt(a * a + b * b + c * c) / 2)
    expected = box.mass / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    assert box.inertia == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["key", "mug"])
def test_moments_are_those_that_another_library_finds(name):
    solid = models.solid(name)
    mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    assert mesh.is_watertight
    assert solid.volume == pytest.approx(mesh.volume)
    assert mesh.center_mass == pytest.approx([0, 0, 0], abs=1e-6)
    assert solid.inertia == pytest.approx(DENSITY * mesh.moment_inertia, abs=1e-6 * np.trace(solid.inertia))
    assert solid.areas.sum() == pytest.approx(mesh.area)


def test_points_on_the_surface_are_even_in_area_and_normals_look_out():
    rng = np.random.default_rng(3)
    box = solid_of("box", Manifold.cube((20, 30, 50)))
    points, normals = box.sample_surface(6000, rng)
    side = np.array([10.0, 15.0, 25.0])
    assert np.sum(points * normals, axis=1) == pytest.approx(np.abs(normals) @ side)
    counts = [np.count_nonzero(normals @ axis > 0.5) for axis in np.concatenate([np.eye(3), -np.eye(3)])]
    areas = np.array([1500, 1000, 600] * 2)
    # Faces get their share to within one for each of their two triangles.
    assert np.abs(counts - 6000 * areas / areas.sum()).max() <= 2
    cells = np.floor((points[normals[:, 0] > 0.5, 1:] + side[1:]) / [6, 10]).astype(int)
    assert chisquare(np.bincount(cells @ [5, 1], minlength=25)).pvalue > 1e-3
    # The order says nothing of the place.
    assert abs(np.corrcoef(np.arange(6000), points[:, 2])[0, 1]) < 0.06


def test_solids_are_equal_by_name_and_shape_and_pickle():
    gear = models.solid("gear")
    assert gear.symmetry.order == 24
    back = pickle.loads(pickle.dumps(gear))
    assert back == gear
    assert hash(back) == hash(gear)
    assert back != models.solid("gear-2")
    assert back != solid_of("wheel", gear.manifold)


def test_a_mirror_image_is_another_solid_and_back_again():
    key = models.solid("key")
    image = mirrored(key)
    assert image.name == "mirrored key"
    assert image.volume == pytest.approx(key.volume)
    assert image.inertia == pytest.approx(np.diag([-1, 1, 1]) @ key.inertia @ np.diag([-1, 1, 1]))
    twice = mirrored(image, "key")
    assert np.sort(twice.vertices, axis=0) == pytest.approx(np.sort(key.vertices, axis=0), abs=1e-5)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (Manifold(), "empty or damaged"),
        (Manifold.cube((301, 5, 5)), r"301 x 5 x 5 mm; its longest side must measure 5 to 300 mm: scale it"),
        (Manifold.cube((4, 3, 4)), "4 x 3 x 4 mm; its longest side must measure 5 to 300 mm"),
        (Manifold.sphere(20, 400), r"has 80,000 faces, the most is 20,000: simplify it"),
    ],
)
def test_what_cannot_be_touched_is_refused(shape, message):
    with pytest.raises(InputError, match=message):
        solid_of("thing", shape)
