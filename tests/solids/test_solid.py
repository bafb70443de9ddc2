"""`Solid`: volume, mass and inertia against closed forms, points on its surface, and what is refused."""

import math
import pickle

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from numba import njit
from scipy.stats import chisquare
from toy_solids import distances

from tactsim import models
from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.models.letter import DENSITY
from tactsim.solids import mirrored, solid_of
from tactsim.solids.feeling_kernels import feel_all
from tactsim.solids.symmetry import crossings
from tactsim.solids.voxels import INSIDE, OUTSIDE, UNKNOWN, first_hit, redistance, settle, sparse


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


TWELVE = (
    "bolt", "nut", "key", "mug", "gear", "spool", "bracket", "egg", "cone", "star-knob", "ring", "tetrapod",
)  # fmt: skip
# How many turns leave each as it is, as one sees on the object itself.
ORDERS = {"nut": 12, "key": 1, "gear": 24, "spool": math.inf, "egg": math.inf, "star-knob": 5, "tetrapod": 12}


@pytest.mark.parametrize(
    "name", [*TWELVE, *(pytest.param(name, marks=pytest.mark.long) for name in models.solid_names(50)[12:])]
)
def test_each_is_one_body_of_20_to_60_mm_that_cuts_nowhere_through_itself(name):
    solid = models.solid(name)
    assert 20 <= np.ptp(solid.vertices, axis=0).max() <= 60
    assert len(solid.faces) <= 5000
    assert len(solid.manifold.decompose()) == 1
    assert solid.areas.min() > 1e-5
    assert len(crossings(solid.corners)) == 0


@pytest.mark.parametrize("name", ORDERS)
def test_symmetry_is_that_of_the_object(name):
    symmetry = models.solid(name).symmetry
    assert symmetry.order == ORDERS[name]
    if math.isinf(symmetry.order):
        assert len(symmetry.rotations) == (2 if name == "spool" else 1)  # whose ends are alike
        assert np.abs(symmetry.axis) == pytest.approx([0, 0, 1], abs=1e-6)


def test_names_are_the_twelve_then_variants():
    assert models.solid_names() == TWELVE
    fifty = models.solid_names(50)
    assert fifty[:12] == TWELVE
    assert fifty[12] == "bolt-2"
    for count in (0, 51):
        with pytest.raises(InputError, match="1 to 50 solids"):
            models.solid_names(count)


@pytest.mark.long
def test_no_two_of_fifty_are_the_same():
    assert len({models.solid(name).digest for name in models.solid_names(50)}) == 50


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(InputError, match="unknown solid 'star knob': did you mean 'star-knob'"):
        models.solid("star knob")


RADIUS, CELL = 12.0, 0.8


def dense():
    axis = np.arange(-18.0, 18.1, CELL)
    return np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij")), axis=0) - RADIUS


@pytest.fixture(scope="module")
def ball():
    return sparse(np.full(3, -18.0), CELL, dense().astype(np.float32), 3.0)


@pytest.mark.long
def test_distances_are_the_spheres_near_it_and_bounds_far_away(ball):
    points = np.random.default_rng(0).uniform(-40, 40, (20_000, 3))
    true, found = np.linalg.norm(points, axis=1) - RADIUS, distances(ball, points)
    near = np.abs(true) < 3 - 2 * CELL
    np.testing.assert_allclose(found[near], true[near], atol=0.02)
    assert (np.abs(found) <= np.abs(true) + CELL).all()
    assert (np.sign(found) == np.sign(true))[np.abs(true) > 0.1].all()
    assert len(ball.nodes) < ball.block.size  # blocks far from the surface hold nothing


def test_distances_are_made_of_any_values_with_the_same_zeros():
    true = dense().astype(np.float32)
    level = np.clip(3 * true, -1, 1).astype(np.float32)
    found = np.empty_like(level)
    redistance(found, level, CELL)
    off = (found - true)[np.abs(true) < 4]
    assert np.abs(off).max() < 0.3 * CELL
    assert np.abs(off).mean() < 0.1 * CELL


def test_what_is_unknown_takes_the_nearest_side():
    side = np.full((9, 3, 3), UNKNOWN, dtype=np.int8)
    side[0], side[8] = INSIDE, OUTSIDE
    settle(side)
    assert (side[:4] == INSIDE).all()
    assert (side[5:] == OUTSIDE).all()


def test_rays_meet_the_sphere_where_it_is(ball):
    rng = np.random.default_rng(1)
    turns = rigid.matrix(rigid.random_rotations(500, rng))
    aside, depth = rng.uniform(-5, 5, (500, 2)), rng.uniform(-0.5, 2.5, 500)
    along = np.sqrt(RADIUS**2 - (aside**2).sum(axis=1))
    local = np.column_stack([aside, depth - along])  # so deep is the surface over the middle of the pad
    places = np.ascontiguousarray(np.einsum("nij,nj->ni", turns, local))
    found = np.empty((500, 1))
    feel_all(ball, np.zeros((1, 3)), places, np.ascontiguousarray(turns), 3.0, 1.0, found)
    pressed = depth > 0
    np.testing.assert_allclose(found[pressed, 0], depth[pressed], atol=0.06)
    # Ahead of the pad the distance counts, which is no more than the way along the ray.
    assert (found[~pressed, 0] >= depth[~pressed] - 0.05).all()
    assert (found[~pressed, 0] <= 0).all()


def test_a_ray_that_meets_nothing_ends(ball):
    @njit
    def hit(voxels, x, begin, end):
        return first_hit(voxels, x, 0.0, -30.0, 0.0, 0.0, 1.0, begin, end)

    assert hit(ball, 0.0, 0.0, 50.0) == pytest.approx(30 - RADIUS, abs=0.02)
    assert hit(ball, 13.0, 0.0, 50.0) == 50.0
    assert hit(ball, 0.0, 25.0, 50.0) == 25.0  # begins inside
