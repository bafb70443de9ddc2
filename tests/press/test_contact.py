"""Contact forces against closed forms and brute force: balance, tilt, rounded edges."""

import numpy as np
import pytest
from exact_readings import integral
from level_world import level_press, level_scan
from manifold3d import CrossSection
from scipy.optimize import root

from tactsim import models
from tactsim.core import InputError, Pad, transform
from tactsim.press import balance, press_letter
from tactsim.press.bed import Level, levels
from tactsim.press.clip import covers, edges_of
from tactsim.press.scan_poses import grid_poses
from tactsim.press.spread import felt_along
from tactsim.press.touches import Touches

PAD = Pad()


def press(name, poses, options, rounding=0.0):
    """Press with MuJoCo, whatever is pressed: where it rests, and the force on each contact."""
    touches = Touches.of(models.letter(name, rounding=rounding), poses, (options.tilt_x, options.tilt_y))
    return balance.press(touches, level_scan(press=options)).settled().load


@pytest.mark.parametrize("force", [0.001, 100.0])
def test_contacts_balance_the_force(force):
    poses = grid_poses()
    load = press("A", poses, level_press(force=force))
    bed, forces = load.bed, load.forces
    total = np.bincount(bed.press, forces, len(poses))
    assert total == pytest.approx(np.full(len(poses), force), rel=1e-6)
    assert (forces >= 0).all()


def test_a_rigid_sphere_presses_as_on_independent_springs():
    """Winkler: F = pi R k d^2 and p(r) = k (d - r^2 / 2R), on and off the middle of the pad."""
    radius, stiffness, force = 50.0, 1.0, 2.0  # mm, N/mm^3, N
    depth = np.sqrt(force / (np.pi * radius * stiffness))
    gaps = np.linspace(0, 1.5 * depth, 61)
    angle = 2 * np.pi * np.arange(180) / 180
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring *= np.sqrt(np.pi / (90 * np.sin(2 * np.pi / 180)))  # a polygon of the circle's area
    circles = [ring * np.sqrt(2 * radius * gap) for gap in gaps]
    face = [
        Level(edges_of([outer, inner[::-1]]), (low + high) / 2)
        for inner, outer, low, high in zip(circles[:-1], circles[1:], gaps[:-1], gaps[1:], strict=True)
    ]
    poses = np.array([[0.0, 0.0, 0.0], [1.3, -0.4, 0.5]])
    options = level_scan(press=level_press(stiffness=1e3 * stiffness))
    maps = balance.press(Touches.of(models.letter("O"), poses), options, face).readings(options)
    # The closed form as a stack of thin discs: p is the integral of k over the depth.
    steps = (np.arange(60) + 0.5) / 60 * depth
    for reading, pose in zip(maps, poses, strict=True):
        x, y, turn = -pose[0], -pose[1], -pose[2]
        centre = (x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn))
        expected = sum(
            integral(
                CrossSection.circle(np.sqrt(2 * radius * (depth - step)), 256).translate(centre), PAD, 1.0
            )
            for step in steps
        ) * (stiffness * depth / 60 * 1e3 / 1.8**2)
        assert np.abs(reading - expected).max() < 2e-3 * expected.max()


def rest_by_brute_force(letter, pose, options):
    """Minimise the energy of layer and wrist with a spring at each point of a fine grid: points mm, and N each."""
    fine = 0.05
    left, right, low, high = PAD.load_bounds
    x, y = np.meshgrid(np.arange(left + fine / 2, right, fine), np.arange(low + fine / 2, high, fine))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    unit = options.stiffness * 1e-3 * fine**2

    def loads(q):
        (cos_x, cos_y), (sin_x, sin_y) = np.cos(q[1:]), np.sin(q[1:])
        plane = np.array([[cos_y, 0.0], [sin_x * sin_y, cos_x]])  # of the face, seen along the pad's normal
        on_face = points @ np.linalg.inv(plane).T
        touching = covers(letter.contours, transform(pose, on_face))
        depth = q[0] + points[:, 1] * np.tan(q[1]) - points[:, 0] * np.tan(q[2]) / np.cos(q[1])
        return unit * np.where(touching, np.maximum(depth, 0), 0)

    def imbalance(q):
        load = loads(q)
        about_x = load @ points[:, 1] / np.cos(q[1]) ** 2
        about_x -= load @ points[:, 0] * np.tan(q[2]) * np.tan(q[1]) / np.cos(q[1])
        about_y = -load @ points[:, 0] / (np.cos(q[2]) ** 2 * np.cos(q[1]))
        bend = options.wrist_stiffness * (q[1:] - (options.tilt_x, options.tilt_y))
        return np.array([load.sum() - options.force, (about_x + bend[0]) / 5, (about_y + bend[1]) / 5])

    start = np.array([0.5, options.tilt_x, options.tilt_y])  # so deep that all of it touches
    found = root(imbalance, start, method="hybr", options={"eps": 1e-5, "xtol": 1e-10})
    assert np.abs(found.fun).max() < 2e-3 * options.force, found
    return points, loads(found.x)


@pytest.mark.parametrize(
    ("name", "pose", "press_options"),
    [
        ("O", [-3.4, 6.0, 0.3], {"tilt_x": 0.02, "wrist_stiffness": 500.0}),
        ("A", [0.0, 0.0, 2.0], {"tilt_x": 0.1, "tilt_y": -0.05, "wrist_stiffness": 3000.0, "force": 5.0}),
    ],
)
def test_a_wrist_gives_way_until_it_balances_the_layer(name, pose, press_options):
    letter, options = models.letter(name), level_press(**press_options)
    load = press(name, np.array([pose]), options)
    points, forces = rest_by_brute_force(letter, np.array(pose), options)
    assert load.forces.sum() == pytest.approx(options.force, rel=1e-9)
    pixel = 0.05**2
    columns = felt_along(points[:, 0], PAD.column_edges, 1.0)
    rows = felt_along(points[:, 1], PAD.row_edges, 1.0)
    truth = (
        1e3 * np.einsum("ir,ic,i->rc", rows, columns, forces).ravel() / (PAD.taxel_width * PAD.taxel_height)
    )
    reading = load.readings(level_scan(press=options))[0]
    # The brute force itself is as coarse as its pixels: they are in or out, along the outline and the line of contact.
    assert pixel * len(points) > 150
    assert np.abs(reading - truth).max() < 5e-3 * truth.max()


def test_a_level_of_a_rounded_edge_lies_at_its_mean_gap():
    """A quarter circle of radius r stands r - sqrt(r^2 - s^2) behind the front, s mm outside the flat."""
    radius = 0.7
    flat, *rounded = levels(models.letter("I", rounding=radius), level_press())
    assert flat.gap == 0
    reach = [np.abs(level.edges[..., 0]).max() for level in (flat, *rounded)]  # the outer side of each
    assert reach[-1] - reach[0] == pytest.approx(radius, abs=1e-6)
    for level, inner, outer in zip(rounded, reach[:-1], reach[1:], strict=True):
        middle = np.linspace(inner, outer, 2001)[:-1] + (outer - inner) / 4000 - reach[0]
        gap = radius - np.sqrt(np.maximum(radius**2 - middle**2, 0))
        assert level.gap == pytest.approx(gap.mean(), abs=1e-4 * radius)


@pytest.mark.parametrize("pose", [[0, 0], [0, 0, np.nan], "A"])
def test_a_pose_that_is_none_is_refused(pose):
    with pytest.raises((InputError, ValueError)):
        press_letter(models.letter("E"), pose)


def test_a_letter_that_tips_over_is_refused():
    options = level_scan(press=level_press(force=5.0, tilt_x=0.1, wrist_stiffness=20.0))
    with pytest.raises(
        InputError, match=r"'E' pressed at x = 10\.2 mm, y = 0 mm, 0\.4 rad does not settle: .*wrist"
    ):
        press_letter(models.letter("E"), [10.2, 0.0, 0.4], options)


def test_a_step_that_leaves_the_pad_is_shortened():
    """A corner touches and the wrist gives way: Newton's first step lifts the letter off every spring."""
    pad = Pad(
        rows=20, columns=20, unread_rows=0, unread_columns=0, seam=None, taxel_width=1.9, taxel_height=1.9
    )
    options = level_scan(pad=pad, press=level_press(force=0.0013, wrist_stiffness=2.96))
    touches = Touches.of(models.letter("E"), np.array([[-11.87, -0.43, -0.31]]), (-0.048, 0.147))
    load = balance.press(touches, options).settled().load
    assert load.forces.sum() == pytest.approx(0.0013, rel=1e-5)
