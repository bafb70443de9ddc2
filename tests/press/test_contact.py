"""Contact forces against closed forms and brute force: balance, foundations, tilt, rounded edges."""

import mujoco
import numpy as np
import pytest
from manifold3d import CrossSection

from tactsim import models
from tactsim.bench.stress.exact import integral
from tactsim.core import InputError, Pad
from tactsim.press import PressOptions, ScanOptions, press_letter
from tactsim.press.bed import Level, lay_bed
from tactsim.press.clip import covers, edges_of
from tactsim.press.contact_forces import contact_forces
from tactsim.press.engine import ideal_readings
from tactsim.press.levels import levels
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import grid_poses
from tactsim.press.spread import contact_map

PAD = Pad()


def press(name, poses, options, rounding=0.0):
    letter = models.letter(name, rounding=rounding)
    bed = lay_bed(levels(letter, options), poses, *PAD.grid_lines(options.cells_per_taxel))
    return bed, contact_forces(bed, poses, letter, options)


@pytest.mark.parametrize("force", [0.001, 2.0, 100.0])
def test_contacts_balance_the_force(force):
    poses = grid_poses()
    bed, forces = press("A", poses, PressOptions(force=force))
    total = np.bincount(bed.press, forces, len(poses))
    assert total == pytest.approx(np.full(len(poses), force), rel=1e-6)
    assert (forces >= 0).all()


def test_pressure_under_a_level_face_is_even():
    poses = grid_poses()
    bed, forces = press("K", poses, PressOptions())
    area = np.bincount(bed.press, bed.area, len(poses))
    assert forces / bed.area == pytest.approx(2.0 / area[bed.press], rel=1e-6)


def test_a_press_does_not_depend_on_the_ones_before():
    poses = grid_poses()[:24]
    bed, forces = press("R", poses, PressOptions())
    backwards, reversed_forces = press("R", poses[::-1], PressOptions())
    for index in range(len(poses)):
        first = forces[bed.press == index]
        again = reversed_forces[backwards.press == len(poses) - 1 - index]
        assert np.array_equal(first, again)


def test_a_sliver_is_laid_out_beside_a_full_press_as_alone():
    letter, options = models.letter("I"), ScanOptions()
    edge = np.concatenate(letter.contours)[:, 0].max() - options.pad.load_bounds[0]
    poses = np.array([[edge - 1e-7, 0, 0], [0, 0, 0]])
    grid = options.pad.grid_lines(2)
    alone, both = (lay_bed(levels(letter, options.press), poses[:n], *grid) for n in (1, 2))
    assert 1e-7 < alone.area.sum() < 1e-5
    assert alone.area.tolist() == both.area[: both.start[1]].tolist()


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
    poses = np.array([[0.0, 0.0, 0.0], [1.3, -0.4, 0.5], [0.95, 0.95, 1.0]])
    bed = lay_bed(face, poses, *PAD.grid_lines(2))
    forces = contact_forces(bed, poses, models.letter("O"), PressOptions(stiffness=1e3 * stiffness))
    maps = contact_map(bed, forces / bed.area, None, PAD, 2, 1.0)
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


def brute_force_tilt(letter, pose, options):
    """Solve the foundation under a tilted face point by point on a fine grid: (points, 2) mm and N each."""
    fine = 0.05
    left, right, low, high = PAD.load_bounds
    x, y = np.meshgrid(np.arange(left + fine / 2, right, fine), np.arange(low + fine / 2, high, fine))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    on_letter = points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    points = points[covers(letter.contours, on_letter)]
    gap = -points[:, 1] * options.tilt_x + points[:, 0] * options.tilt_y
    order = np.sort(gap)
    # depth d with sum k a (d - gap)+ = F: the first of the sorted gaps that fits
    unit = options.stiffness * 1e-3 * fine**2
    depths = (options.force / unit + np.cumsum(order)) / np.arange(1, len(order) + 1)
    depth = depths[np.searchsorted(order - depths, 0) - 1]
    return points, unit * np.maximum(depth - gap, 0)


@pytest.mark.parametrize(("tilt_x", "tilt_y"), [(0.01, 0.0), (0.0, 0.02), (-0.05, 0.03)])
def test_a_rigidly_tilted_face_presses_one_side(tilt_x, tilt_y):
    letter, pose = models.letter("E"), np.array([-3.4, 3.4, 0.7])
    options = PressOptions(tilt_x=tilt_x, tilt_y=tilt_y, cells_per_taxel=8)
    bed, forces = press("E", pose[None], options)
    points, load = brute_force_tilt(letter, pose, options)
    assert forces.sum() == pytest.approx(2.0, rel=1e-6)
    # The same resultant, and the same load in each quarter of the pad.
    assert forces @ bed.centroid == pytest.approx(load @ points, abs=0.01)
    for sign_x in (-1, 1):
        for sign_y in (-1, 1):
            ours = forces[(bed.centroid * (sign_x, sign_y) > 0).all(axis=1)].sum()
            theirs = load[(points * (sign_x, sign_y) > 0).all(axis=1)].sum()
            assert ours == pytest.approx(theirs, abs=0.01)


@pytest.mark.parametrize("force", [0.001, 2.0])
def test_a_level_press_is_found_in_one_step_of_newton_s_method(force, monkeypatch):
    steps = []

    def count(model, data, step=mujoco.mj_step):
        steps.append(data.time)
        step(model, data)

    monkeypatch.setattr(mujoco, "mj_step", count)
    poses = grid_poses()[60:70]
    press("E", poses, PressOptions(force=force))
    assert len(steps) == len(poses)


def test_hinges_give_way_until_they_balance_the_contact():
    stiffness = 500.0  # N mm / rad
    options = PressOptions(tilt_x=0.02, tilt_stiffness=stiffness)
    pose = np.array([-3.4, 6.0, 0.3])
    bed, forces = press("O", pose[None], options)
    depth = forces / bed.area / (options.stiffness * 1e-3)
    touching = depth > 1e-6
    plane = np.column_stack([np.ones(touching.sum()), bed.centroid[touching]])
    fit, *_ = np.linalg.lstsq(plane, depth[touching], rcond=None)
    assert plane @ fit == pytest.approx(depth[touching], abs=1e-3 * depth.max())
    tilt_x, tilt_y = fit[2], -fit[1]  # rad: the face's slopes
    assert not 0.0199 < tilt_x < 0.0201
    assert stiffness * (tilt_x - 0.02) == pytest.approx(-forces @ bed.centroid[:, 1], rel=0.01)
    assert stiffness * tilt_y == pytest.approx(forces @ bed.centroid[:, 0], rel=0.01)
    assert forces.sum() == pytest.approx(2.0, rel=1e-6)


def test_stiff_hinges_are_a_rigid_tilt_and_no_tilt_is_none():
    pose = np.array([[1.0, -2.0, 0.4]])
    _, rigid = press("S", pose, PressOptions(tilt_x=0.01, tilt_y=-0.01))
    _, stiff = press("S", pose, PressOptions(tilt_x=0.01, tilt_y=-0.01, tilt_stiffness=1e7))
    assert stiff == pytest.approx(rigid, abs=1e-4)
    _, level = press("S", pose, PressOptions())
    _, held = press("S", pose, PressOptions(tilt_stiffness=1e7))
    assert held == pytest.approx(level, abs=1e-5)


def test_a_rounded_edge_nears_the_sharp_one_as_its_radius_vanishes():
    poses = grid_poses()[40:60]
    options = ScanOptions()
    sharp, _ = ideal_readings(models.letter("H"), poses, options)
    peak = sharp.max(axis=1, keepdims=True)
    change = [
        np.abs(ideal_readings(models.letter("H", rounding=radius), poses, options)[0] - sharp) / peak
        for radius in (0.4, 0.1, 0.01)
    ]
    assert change[0].max() > 4 * change[1].max() / 2
    assert change[1].max() > change[2].max()
    assert change[2].max() < 5e-3


def test_a_level_of_a_rounded_edge_lies_at_its_mean_gap():
    """A quarter circle of radius r stands r - sqrt(r^2 - s^2) behind the front, s mm outside the flat."""
    radius = 0.7
    flat, *rounded = levels(models.letter("I", rounding=radius), PressOptions())
    assert flat.gap == 0
    reach = [np.abs(level.edges[..., 0]).max() for level in (flat, *rounded)]  # the outer side of each
    assert reach[-1] - reach[0] == pytest.approx(radius, abs=1e-6)
    for level, inner, outer in zip(rounded, reach[:-1], reach[1:], strict=True):
        middle = np.linspace(inner, outer, 2001)[:-1] + (outer - inner) / 4000 - reach[0]
        gap = radius - np.sqrt(np.maximum(radius**2 - middle**2, 0))
        assert level.gap == pytest.approx(gap.mean(), abs=1e-4 * radius)


def test_a_rounded_edge_is_finely_enough_cut(monkeypatch):
    poses, options = grid_poses()[::24], ScanOptions()
    letter = models.letter("E", rounding=0.5)
    coarse, _ = ideal_readings(letter, poses, options)
    monkeypatch.setattr("tactsim.press.levels.ROUNDING_LEVELS", 48)
    fine, _ = ideal_readings(letter, poses, options)
    assert np.abs(coarse - fine).max() < 2e-3 * fine.max()


def test_a_soft_bed_under_a_rounded_letter_balances_too():
    options = PressOptions(stiffness=50.0, force=50.0)
    bed, forces = press("B", grid_poses()[::17], options, rounding=0.3)
    assert np.bincount(bed.press, forces) == pytest.approx(50.0, rel=1e-5)


def test_a_rounded_letter_cannot_be_pressed_by_its_parts():
    options = ScanOptions(press=PressOptions(skip=Skips(parts=False)))
    with pytest.raises(InputError, match="rounded"):
        press_letter(models.letter("E", rounding=0.2), [0, 0, 0], options)


@pytest.mark.parametrize("pose", [[0, 0], [0, 0, np.nan], [0, np.inf, 0], "A"])
def test_a_pose_that_is_none_is_refused(pose):
    with pytest.raises((InputError, ValueError)):
        press_letter(models.letter("E"), pose)


def test_a_letter_that_turns_over_is_refused():
    # Hinges this soft let it turn until its plane meets the springs of larger beds, which wait far away.
    pad = Pad(rows=20, columns=20, unread_columns=0, seam=None)
    options = PressOptions(force=0.01, tilt_x=0.2, tilt_stiffness=1.0)
    poses = np.array([[0.0, 0.0, 0.4]])
    bed = lay_bed(levels(models.letter("E"), options), poses, *pad.grid_lines(2, gap_cells=True))
    with pytest.raises(InputError, match=r"'E' pressed at x = 0 mm, y = 0 mm, 0\.4 rad does not settle"):
        contact_forces(bed, poses, models.letter("E"), options)
