"""Scans of objects in space: where the touches lie, and what a scan says."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tactsim import models
from tactsim.core import InputError, rigid
from tactsim.solids import (
    SpaceOptions,
    SpacePress,
    random_starts,
    scan_solids,
    solids_of,
    touch_grid,
)
from tactsim.solids.scan import SpaceScan

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
