"""Shapes with relief against closed forms of domes, cylinders and cones, and against brute force on a fine grid."""

import numpy as np
import pytest
from attached_scenes import springs
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from level_world import level_press, level_scan
from manifold3d import CrossSection, Manifold
from scipy.spatial.transform import Rotation

import tactsim
from tactsim import models
from tactsim.core import InputError, Pad
from tactsim.core.poses import transform
from tactsim.models.height_field import Relief
from tactsim.press import press_letter
from tactsim.press.engine import ideal_readings, press_at
from tactsim.press.relief import press
from tactsim.press.scan_poses import grid_poses
from tactsim.press.touches import Touches

PAD = Pad()
POSES = np.array([[0, 0, 0], [1.3, -0.4, 0.5], [0.95, 0.95, 1.0], [-6.0, 2.5, 2.2]])


def options(force=2.0, **press):
    return level_scan(press=level_press(force=force, **press))


def brute_force(gap, pose, force, *, stiffness=1.0, tilt=(0.0, 0.0), fine=0.02):
    """Press a height field on a fine grid of springs: the reading, kPa, and the depth, mm.

    gap: of points (n, 2) in the object's frame, mm; infinite where there is nothing.
    """

    def behind(x, y):
        away = gap(transform(pose, np.stack([x.ravel(), y.ravel()], axis=-1))).reshape(x.shape)
        return away - y * tilt[0] + x * tilt[1]

    kpa, _, depth = springs(PAD, behind, force / stiffness, fine=fine, beyond=0.0)
    return stiffness * kpa, depth


def field_of(facets):
    """Look down at facets (m, 3, 3), [x, y, gap]: a function that gives the gap at points."""

    def gap(points):
        result = np.full(len(points), np.inf)
        low, high = facets[:, :, :2].min(axis=1), facets[:, :, :2].max(axis=1)
        for (a, b, c), least, most in zip(facets, low, high, strict=True):
            near = np.flatnonzero(((points > least) & (points < most)).all(axis=1))
            s, t = np.linalg.solve(np.array([b[:2] - a[:2], c[:2] - a[:2]]).T, (points[near] - a[:2]).T)
            inside = (s >= -1e-12) & (t >= -1e-12) & (s + t <= 1 + 1e-12)
            there = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
            result[near[inside]] = np.minimum(result[near[inside]], there[inside])
        return result

    return gap


def dome(radius, depth, rings=40, sectors=96):
    """Revolve the cap of a sphere that a press of `depth` can meet, on a short post."""
    reach = min(1.3 * np.sqrt(2 * radius * depth - depth**2), 0.99 * radius)
    r = reach * np.linspace(0, 1, rings)
    z = np.sqrt(radius**2 - r**2) - radius
    outline = np.concatenate([[[0, z[-1] - 3], [reach, z[-1] - 3]], np.stack([r, z], axis=1)[::-1]])
    return CrossSection([outline]).revolve(sectors), reach


def sphere_gap(radius, reach):
    def gap(points):
        r = np.hypot(*points.T)
        return np.where(r < reach, radius - np.sqrt(np.maximum(radius**2 - r**2, 0)), np.inf)

    return gap


def worst(letter, gap, given, poses=POSES, tilt=(0.0, 0.0), fine=0.02):
    """Press by both ways: the largest difference of a taxel as a share of the peak, and the depths of brute force."""
    pressed = press(Touches.of(letter, poses, tilt), given)
    assert not pressed.blanks
    errors, depths = [], []
    for reading, pose in zip(pressed.readings(given), poses, strict=True):
        expected, depth = brute_force(
            gap, pose, given.press.force, stiffness=1e-3 * given.press.stiffness, tilt=tilt, fine=fine
        )
        errors.append(np.abs(reading - expected).max() / expected.max())
        depths.append(depth)
    return max(errors), depths


@pytest.mark.parametrize(("radius", "force"), [(3.0, 0.1), (50.0, 30.0)])
def test_a_sphere(radius, force):
    """Winkler: F = pi R k d^2 for a paraboloid, pi k d^2 (R - d / 3) for a cap."""
    about = np.sqrt(force / (np.pi * radius))
    solid, reach = dome(radius, about)
    error, (depth, *_) = worst(
        models.relief("dome", solid), sphere_gap(radius, reach), options(force, thickness=5)
    )
    if 2 * radius * depth < 5.6**2:  # else it reaches beyond the pad
        assert np.pi * depth**2 * (radius - depth / 3) == pytest.approx(force, rel=1e-3)
    assert error < 1e-3


def test_a_step():
    """Both sides carry while F / A is more than k times the step; with 2 N on 8 x 8 mm at 0.02 mm they do."""
    step = 0.02
    solid = Manifold.cube((8, 8, 4)) + Manifold.cube((8, 8, 4 - step)).translate((8, 0, 0))
    letter = models.relief("step", solid)

    def gap(points):
        inside = (np.abs(points) < (8, 4)).all(axis=1)
        return np.where(inside, np.where(points[:, 0] < 0, 0, step), np.inf)

    # Steps of the grid along the outlines of a level pad.
    poses = np.array([[0.0, 0.0, 0.0], [1.3, -0.4, 0.5]])
    error, _ = worst(letter, gap, options(0.5), poses)
    assert error < 3e-3


@pytest.mark.long
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    pose=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-4, 4)),
    force=st.sampled_from([0.5, 4.0, 20.0]),
    tilt=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
def test_any_rock_presses_as_springs_on_a_fine_grid(seed, pose, force, tilt):
    """A convex hull of random points, pressed anywhere and tilted."""
    points = np.random.default_rng(seed).normal(size=(30, 3)) * (4, 4, 1)
    letter = models.relief("rock", Manifold.hull_points(points))
    given = options(force, thickness=10)
    pressed = press(Touches.of(letter, np.array([pose]), tilt), given)
    gap = field_of(letter.relief.seen_from_above.facets)
    expected, depth = brute_force(gap, np.array(pose), force, tilt=tilt, fine=0.05)
    if pressed.blanks:
        assert depth > 0.99 * letter.height
    else:
        peak = max(expected.max(), 10 * force)  # kPa; less where it lies beside the taxels that are read
        assert np.abs(pressed.readings(given)[0] - expected).max() < 0.01 * peak


def total(pressed):
    """Sum what the cells carry: N, and the moments about the pad's middle, N mm."""
    x_lines, y_lines = PAD.grid_lines(2)
    x, y = np.meshgrid((x_lines[:-1] + x_lines[1:]) / 2, (y_lines[:-1] + y_lines[1:]) / 2)
    force, along_x, along_y = pressed.load.moments[:3, 0]
    return force.sum(), (along_x + x.ravel() * force).sum(), (along_y + y.ravel() * force).sum()


def test_a_wrist_gives_way_until_it_balances_the_contact():
    """The wrist's moments about the pad's middle are those of the contact; then both sides' tilts agree."""
    force, wrist = 10.0, 100.0
    solid, reach = dome(40, 1.5)
    letter, pose = models.relief("dome", solid), np.array([[2.0, -1.0, 0.4]])
    tilt = np.array([[0.01, -0.02]])
    pressed = press(Touches(letter, pose, tilt), options(force, wrist_stiffness=wrist))
    carried, about_y, about_x = total(pressed)
    assert carried == pytest.approx(force, rel=1e-9)
    found = tilt[0] + np.array([-about_x, about_y]) / wrist
    expected, _ = brute_force(sphere_gap(40, reach), pose[0], force, tilt=found)
    reading = pressed.readings(options(force))[0]
    assert np.abs(reading - expected).max() < 2e-3 * expected.max()
    assert np.abs(found - tilt[0]).max() > 0.005


def test_a_layer_gives_way_by_no_more_than_its_thickness():
    """Past it the layer is just stiff enough: F = pi k t^2 (R - t / 3) gives k."""
    radius, thickness = 10.0, 0.4
    solid, reach = dome(radius, 1.0)
    letter, given = models.relief("dome", solid), options(30.0, thickness=thickness)
    stiffness = 30.0 / (np.pi * thickness**2 * (radius - thickness / 3))
    assert stiffness > 1
    expected, depth = brute_force(sphere_gap(radius, reach), POSES[0], 30.0, stiffness=stiffness)
    assert depth == pytest.approx(thickness, rel=1e-3)
    assert press(Touches.of(letter, POSES[:1]), given).readings(given)[0] == pytest.approx(
        expected, abs=1e-3 * expected.max()
    )


def test_presses_beside_the_shape_read_nothing_and_each_stands_alone():
    solid, _ = dome(10, 1.0)
    letter, given = models.relief("dome", solid), options()
    poses = np.concatenate([POSES, [[40.0, 0, 0], [0, -30.0, 1.0]]])
    pressed = press(Touches.of(letter, poses), given)
    readings = pressed.readings(given)
    assert pressed.work["presses"] == 4
    assert pressed.work["no_contact"] == 2
    assert not readings[4:].any()
    alone = press(Touches.of(letter, poses[3:4]), given)
    assert np.array_equal(alone.load.moments[:, 0], pressed.load.moments[:, 3])


def test_a_shape_that_is_buried_or_tips_over_is_a_blank_with_its_reason():
    low, _ = dome(10, 0.1)
    flat = models.relief("dome", low.trim_by_plane((0, 0, 1), -0.2))
    assert flat.height == pytest.approx(0.2)
    pressed = press(Touches.of(flat, POSES[:1]), options(30.0))
    assert "more than its height" in pressed.blanks[0]
    assert not pressed.readings(options()).any()
    solid, _ = dome(10, 1.0)
    beside = Touches.of(models.relief("dome", solid), np.array([[6.0, 0, 0], [0.0, 0, 0]]))
    pressed = press(beside, options(30.0, wrist_stiffness=10.0))
    assert list(pressed.blanks) == [0]
    assert "tips over" in pressed.blanks[0]


def test_the_engine_is_chosen_by_how_far_a_press_can_sink_in():
    """A stud on a plate, 1.5 mm high: a layer of 1 mm feels the stud alone, one of 2 mm may feel the plate."""
    solid = Manifold.cube((30, 20, 2)) + Manifold.cylinder(3.5, 4, 4, 128).translate((15, 10, 0))
    letter = models.relief("stud", solid)
    touches = Touches.of(letter, POSES)
    assert press_at(touches, options()).work["engine_exact"] == len(POSES)
    given = options(40.0, thickness=2, stiffness=300)
    pressed = press_at(touches, given)
    assert pressed.work["engine_relief"] == len(POSES)
    alone = ideal_readings(touches, options(40.0, stiffness=300))[0]
    assert pressed.readings(given).max() < 0.99 * alone.max()


def test_the_mesh_of_a_rounded_letter_is_pressed_as_its_levels_are_by_mujoco():
    rounded = models.letter("E", rounding=0.5)
    poses = grid_poses()[::31]
    expected, work = ideal_readings(Touches.of(rounded, poses), options())
    assert work["engine_bed"]
    found, work = ideal_readings(Touches.of(models.relief("E", rounded.solid), poses), options())
    assert work["engine_relief"]
    assert np.abs(found - expected).max() < 5e-3 * expected.max()


def test_what_relief_is_not_pressed_by():
    letter = models.relief("ball", Manifold.sphere(10, 24))
    with pytest.raises(InputError, match="'ball' has relief"):
        press_letter(letter, [0, 0, 0], options(dynamics="full"))
    for engine in ("exact", "bed"):
        with pytest.raises(InputError, match=f"{engine} cannot press this: 'ball' has relief"):
            press_letter(letter, [0, 0, 0], options(engine=engine))
    with pytest.raises(InputError, match="collide cannot press this: 'E' is pressed from a side"):
        press_letter(models.letter("E"), [0, 0, 0], options(engine="collide"), rotation=np.eye(3))


# --- from any side


def test_a_turned_letter_is_the_letter_turned():
    """An E with round edges, which hides parts of itself from most sides, against a turned copy seen from above."""
    solid = models.letter("E", rounding=0.5).solid
    letter, turns = models.relief("E", solid), Rotation.random(3, random_state=3).as_matrix()
    where = np.array([*letter.relief.vertices.mean(axis=0)])
    poses = np.array([[*(where @ turn)[:2], 0.0] for turn in turns]) + (0.7, -0.3, 0.2)
    for turn, pose in zip(turns, poses, strict=True):
        reading = press_letter(letter, pose, options(), rotation=turn).ideal
        assert reading.max() > 0
        turned = letter.solid.transform(np.column_stack([turn.T, np.zeros(3)]))
        moved = models.relief("E", turned)
        # `relief` moves its origin to the footprint's centre; undo that.
        shift = moved.relief.vertices.min(axis=0) - Relief.of(turned).vertices.min(axis=0)
        there = press(Touches.of(moved, (pose + (*shift[:2], 0))[None]), options()).readings(options())[0]
        assert np.abs(reading - there).max() < 1e-6 * there.max()


def test_a_press_from_a_side_by_the_public_face():
    ball = models.relief("ball", Manifold.sphere(8, 256))
    above = tactsim.press(ball, [0, 0, 0.4]).ideal
    turn = Rotation.from_euler("x", 90, degrees=True)  # the pad's normal is the object's -y then
    pose = [0, (np.array([0, 0, 8.0]) @ turn.as_matrix())[1], 0.4]
    assert tactsim.press(ball, pose, rotation=turn).ideal == pytest.approx(above, abs=2e-3 * above.max())


def test_mujoco_alone_presses_a_convex_shape_alike():
    """Its lattice has errors of its own at an outline, but a ball has none."""
    ball = models.relief("ball", Manifold.sphere(10, 96))
    for pose in ([0.0, 0.0, 0.0], [1.0, -2.0, 0.3]):
        usual = press_letter(ball, pose, options()).ideal
        collided = press_letter(ball, pose, options(engine="collide")).ideal
        assert np.abs(collided - usual).max() < 5e-3 * usual.max()
