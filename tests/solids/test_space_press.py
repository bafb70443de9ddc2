"""Touches in space against closed forms, and those of a scan."""

import math
from types import SimpleNamespace

import meshes
import mujoco
import numpy as np
import pytest
from level_world import level_press, level_scan
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial import cKDTree

import tactsim
from tactsim import models
from tactsim.core import InputError, Pad, rigid
from tactsim.models.height_field import Relief
from tactsim.press import relief
from tactsim.press.touches import Touches
from tactsim.solids import SpaceOptions, SpacePress, random_starts, scan_solids, solids_of, touch_grid
from tactsim.solids.press import advanced
from tactsim.solids.scan import SpaceScan

FORCE, STIFFNESS = 2.0, 0.05  # N, N/mm^3
BELOW = np.array([[0.0, 0, -60, 1, 0, 0, 0]])  # looks along +z


def press(solid, **options):
    return SpacePress([solid], SpaceOptions(**options))


def touch(solid, start=BELOW, **options):
    return press(solid, **options).touch(solid.name, start)


def travel_until(load, front):
    """Solve for the travel at which a closed form of the load (N a N/mm^3), by depth, gives the force."""
    return 60 + front + brentq(lambda depth: STIFFNESS * load(depth) - FORCE, 0, 5)


def test_a_ball_sinks_in_as_its_cap_says():
    found = touch(meshes.ball())
    # The volume of a cap: pi d^2 (R - d / 3).
    assert found.travel[0] == pytest.approx(
        travel_until(lambda d: math.pi * d**2 * (15 - d / 3), -15), abs=3e-3
    )
    assert found.met.all()
    assert found.force[0] == pytest.approx(FORCE, rel=1e-9)
    assert found.true[0] == pytest.approx([0, 0, found.travel[0] - 60, 1, 0, 0, 0])


def test_a_rod_sinks_in_as_its_segment_says():
    found = touch(meshes.rod())
    y_low, y_high = SpaceOptions().pad.load_bounds[2:]

    def segment(d):
        return 100 * math.acos(1 - d / 10) - (10 - d) * math.sqrt(20 * d - d**2)

    assert found.travel[0] == pytest.approx(
        travel_until(lambda d: (y_high - y_low) * segment(d), -10), abs=3e-3
    )


def test_an_edge_sinks_in_as_a_right_angle_does():
    found = touch(meshes.roof())
    y_low, y_high = SpaceOptions().pad.load_bounds[2:]
    assert found.travel[0] == pytest.approx(
        travel_until(lambda d: (y_high - y_low) * d**2, -10 * math.sqrt(2)), abs=5e-3
    )


def test_a_flat_face_is_pressed_evenly():
    """Without a point spread each taxel reads the force over the pad's area, whatever the stiffness."""
    found = touch(meshes.box(40, 40, 40), sensor={"psf_sigma": 0.0})
    x_low, x_high, y_low, y_high = SpaceOptions().pad.load_bounds
    even = 1e3 * FORCE / ((x_high - x_low) * (y_high - y_low))
    assert found.readings == pytest.approx(np.full((1, 36), even), rel=1e-9)


@pytest.mark.parametrize(("name", "count"), [("key", 8), ("star-knob", 4)])
def test_touches_agree_with_the_exact_press_of_facets(name, count):
    """The press of relief integrates over each facet that is seen; it sees the object from outside, so y is turned."""
    solid = models.solid(name)
    starts = random_starts(solid, count, np.random.default_rng(1))
    found = touch(solid, starts)
    turns = rigid.matrix(starts[:, 3:]) * (1.0, -1.0, -1.0)
    poses = np.einsum("ni,nij->nj", starts[:, :3], turns) * (1.0, 1.0, 0.0)
    exact = level_scan(press=level_press(stiffness=1e3 * STIFFNESS, thickness=3.0))
    shape = Relief(solid.vertices, solid.faces)
    pressed = [
        relief.press(Touches.of(SimpleNamespace(relief=shape.turned(turn)), pose[None]), exact).readings(
            exact
        )
        for turn, pose in zip(turns, poses, strict=True)
    ]
    expected = np.concatenate(pressed).reshape(-1, 6, 6)[:, ::-1].reshape(-1, 36)
    assert found.met.all()
    off = np.abs(found.readings - expected).max(axis=1) / expected.max(axis=1)
    assert np.median(off) < 1e-3
    assert off.max() < 0.015


def test_a_stroke_that_ends_early_leaves_the_pad_with_less():
    whole = touch(meshes.ball())
    found = touch(meshes.ball(), stroke=float(whole.travel[0]) - 0.3)
    assert found.travel[0] == pytest.approx(whole.travel[0] - 0.3)
    assert found.met.all()
    assert 0 < found.force[0] < FORCE


def test_a_layer_is_pressed_by_its_thickness_at_most():
    found = touch(meshes.needle())
    assert found.travel[0] == pytest.approx(60 - 10 + 3)
    assert found.force[0] == pytest.approx(FORCE)


def test_what_lies_behind_the_start_is_met_all_the_same():
    """The pad comes from outside along its line, wherever the stroke is said to begin."""
    inside = BELOW + np.array([0, 0, 60.0, 0, 0, 0, 0])
    far, near = touch(meshes.ball()), touch(meshes.ball(), inside)
    assert near.true == pytest.approx(far.true, abs=1e-9)
    assert near.readings == pytest.approx(far.readings, rel=1e-9)


def test_turning_the_world_changes_nothing():
    rng = np.random.default_rng(4)
    world = np.concatenate([rng.normal(0, 20, 3), rigid.random_rotations(1, rng)[0]])
    solid = meshes.roof(25, 14)
    start = rigid.compose(np.concatenate([np.zeros((20, 3)), rigid.random_rotations(20, rng)], 1), BELOW)
    moved = meshes.roof(25, 14)
    moved.vertices = rigid.transform(world, solid.vertices)
    here, there = touch(solid, start), touch(moved, rigid.compose(world, start))
    assert there.travel == pytest.approx(here.travel, abs=1e-3)
    assert there.readings == pytest.approx(here.readings, abs=0.5)


@pytest.mark.parametrize("body", ["cylinder", "sphere"])
def test_a_curved_pad_on_a_flat_face_sinks_in_as_its_curve_says(body):
    found = touch(meshes.box(40, 40, 40), body=body, radius=20.0, sensor={"psf_sigma": 0.0})
    length = SpaceOptions().pad.load_bounds[3] * 2

    def load(d):
        edge = math.sqrt(20**2 - (20 - d) ** 2)

        # Depth along z, times the part along z of the normal, twice over a surface larger by one.
        def spring(x):
            return (d - 20 + math.sqrt(400 - x**2)) * math.sqrt(400 - x**2) / 20

        if body == "cylinder":
            return 2 * length * quad(spring, 0, edge)[0]
        return quad(lambda r: 2 * math.pi * r * spring(r), 0, edge)[0]

    assert found.travel[0] == pytest.approx(travel_until(load, -20), abs=3e-3)


def test_a_body_too_small_for_the_pad_is_refused():
    with pytest.raises(InputError, match="radius is 4 mm, and the pad reaches too far round such a cylinder"):
        press(meshes.ball(), body="cylinder", radius=4.0)


def test_the_robot_states_where_it_believes_the_pad_to_be():
    one = press(meshes.box(40, 40, 40), placement_mm=0.5, placement_rad=0.0)
    start = np.repeat(BELOW, 400, 0)
    found = one.touch("box", start, np.random.default_rng(1))
    off = found.true[:, :3] - found.stated[:, :3]
    assert off.std(axis=0) == pytest.approx(np.full(3, 0.5), rel=0.15)
    # Its own stroke it knows: where the pad truly stops is where the object is.
    assert found.true[:, 2].std() < 1e-9


def test_what_the_sensor_reports_has_its_noise():
    one = press(meshes.ball())
    found = one.touch("ball", np.repeat(BELOW, 50, 0))
    said = one.sensed(found, np.random.default_rng(2))
    assert (said.readings - found.readings).std() == pytest.approx(2.0, rel=0.1)
    assert said.true is found.true


def test_an_unknown_object_and_a_start_that_is_no_pose_are_refused():
    with pytest.raises(InputError, match="object"):
        press(meshes.ball()).touch("bal", BELOW)
    with pytest.raises(InputError, match="a rotation's has length 1"):
        press(meshes.ball()).touch("ball", BELOW * 2)
    with pytest.raises(InputError, match="table of poses"):
        press(meshes.ball()).touch("ball", BELOW[0])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"radius": 20.0}, "a flat pad has no radius: give body = cylinder or sphere"),
        ({"body": "sphere"}, "a pad on a sphere needs its radius, mm"),
        ({"spacing": 0.01}, "choose a larger spacing or fewer taxels"),
        ({"force": float("nan")}, "finite"),
    ],
)
def test_what_makes_no_touch_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        SpaceOptions(**given)


FEW = SpaceOptions(objects=("key", "egg"), points=20, turns=2, tests=5)


def test_a_scan_has_what_was_asked_for_and_can_be_kept(tmp_path):
    said = []
    scan, work = scan_solids(FEW, progress=lambda done, total: said.append((done, total)))
    assert scan.objects == ("key", "egg")
    assert [len(scan.where(split, "egg")) for split in ("train", "test")] == [40, 5]
    assert work["presses"] == len(scan) == 90
    assert said == [(40, 90), (45, 90), (85, 90), (90, 90)]
    assert scan.meta["stroke"] == FEW.stroke
    assert scan.meta["objects"]["egg"]["axis"] is not None
    scan.save(tmp_path / "few.npz")
    assert SpaceScan.load(tmp_path / "few.npz").digest == scan.digest


def test_an_object_is_touched_alike_whatever_else_is():
    both, _ = scan_solids(FEW)
    alone, _ = scan_solids(FEW.model_copy(update={"objects": ("egg",)}))
    assert (both.where(label="egg").readings == alone.readings).all()
    assert (both.where(label="egg").poses == alone.poses).all()


def test_the_grid_is_even_over_the_surface_and_looks_into_the_object():
    egg = models.solid("egg")
    starts = touch_grid(egg, 100, 3, 0.0, np.random.default_rng(0))
    normal = rigid.turned(starts[:, 3:], np.array([0.0, 0, 1]))
    # Every point of the pad starts outside the sphere that holds the object.
    assert (-np.sum(starts[:, :3] * normal, axis=1) > egg.radius).all()
    assert normal[0::3] == pytest.approx(normal[1::3])
    between = rigid.angle_between(starts[0::3, 3:], starts[1::3, 3:])
    assert between == pytest.approx(np.full(100, 2 * np.pi / 3))
    found = SpacePress([egg], SpaceOptions()).touch("egg", starts[::3])
    # An egg is convex: the pad meets it where it aims. No two of 100 points lie much nearer than an even share of the
    # surface says, and no place is far from one.
    assert found.met.all()
    surface, _ = egg.sample_surface(2000, np.random.default_rng(1))
    even = np.sqrt(egg.areas.sum() / 100)
    apart = cKDTree(found.true[:, :3]).query(found.true[:, :3], 2)[0][:, 1]
    assert apart.min() > 0.6 * even
    assert cKDTree(found.true[:, :3]).query(surface)[0].max() < 1.2 * even


def test_all_but_the_first_touch_at_a_point_lean_within_a_cone():
    egg, lean = models.solid("egg"), 1.0
    facing, leaning = (touch_grid(egg, 200, 3, most, np.random.default_rng(0)) for most in (0.0, lean))
    np.testing.assert_array_equal(leaning[::3], facing[::3])
    normals = [rigid.turned(starts[:, 3:], np.array([0.0, 0, 1])) for starts in (facing, leaning)]
    angle = np.arccos(np.clip(np.sum(normals[0] * normals[1], axis=1), -1, 1)).reshape(-1, 3)[:, 1:]
    assert angle.max() <= lean + 1e-9
    # Even over the cone's directions: half of them lie in the part of half its area.
    middle = np.arccos((1 + np.cos(lean)) / 2)
    assert np.mean(angle < middle) == pytest.approx(0.5, abs=3 * 0.5 / np.sqrt(angle.size))
    # A leaning pad aims at the same point.
    points = egg.sample_surface(20_000, np.random.default_rng(1))[0]
    for starts, n in zip((facing, leaning), normals, strict=True):
        along = np.sum((points[None, :, :] - starts[:20, None, :3]) * n[:20, None], axis=2)
        beside = np.linalg.norm(
            points[None] - starts[:20, None, :3] - along[..., None] * n[:20, None], axis=2
        )
        assert beside.min(axis=1).max() < 0.7


def test_touches_from_anywhere_start_outside():
    ring = models.solid("ring")
    starts = random_starts(ring, 300, np.random.default_rng(2))
    normal = rigid.turned(starts[:, 3:], np.array([0.0, 0, 1]))
    assert (-np.sum(starts[:, :3] * normal, axis=1) > ring.radius).all()
    assert np.abs(normal.mean(axis=0)).max() < 0.15


def test_objects_that_do_not_exist_or_are_named_twice_are_refused():
    with pytest.raises(InputError, match="solid"):
        solids_of(SpaceOptions(objects=("bold",)))
    with pytest.raises(InputError, match="two objects are called 'egg'"):
        solids_of(SpaceOptions(objects=("egg", "egg")))
    with pytest.raises(InputError, match="nothing to touch"):
        solids_of(SpaceOptions(objects=()))


_, X_HIGH, _, Y_HIGH = Pad().load_bounds


def scene(solid):
    """Make a model of a convex solid, fixed."""
    spec = mujoco.MjSpec()
    spec.option.gravity = (0, 0, 0)
    spec.option.timestep = 5e-4
    spec.add_mesh(name="solid").uservert = (solid.vertices / 1e3).ravel().tolist()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="solid", friction=(0.01, 0, 0))
    return spec


def test_a_pad_that_mujoco_presses_on_an_egg_reads_nearly_the_same():
    """An egg touches at one place, so the load of hard contacts stands within 0.2 mm of where a soft layer's does."""
    solid = models.solid("egg")
    start = touch_grid(solid, 2, 1, 0.0, np.random.default_rng(5))
    found = SpacePress([solid], SpaceOptions()).touch("egg", start)
    for near, expected in zip(advanced(start, found.travel - 4), found.readings, strict=True):
        spec = scene(solid)
        body = spec.worldbody.add_body(pos=near[:3] / 1e3, quat=near[3:])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1), damping=5.0)
        body.add_geom(
            name="finger", type=mujoco.mjtGeom.mjGEOM_BOX, size=(X_HIGH / 1e3, Y_HIGH / 1e3, 0.002),
            pos=(0, 0, -0.002), mass=0.1,
        )  # fmt: skip
        attached = tactsim.press.attach(spec, "finger", stiffness=1e3 * STIFFNESS)
        model = spec.compile()
        data, reader = mujoco.MjData(model), attached.bind(model)
        data.qfrc_applied[0] = FORCE
        for _ in range(400):
            mujoco.mj_step(model, data)
        read = reader.read(data)
        assert read.force == pytest.approx(FORCE, rel=0.01)
        assert np.abs(read.kpa - expected).max() < 0.1 * expected.max()
        x, y = Pad().taxel_xy.T
        assert (read.kpa @ x - expected @ x, read.kpa @ y - expected @ y) == pytest.approx(
            (0, 0), abs=0.2 * expected.sum()
        )
