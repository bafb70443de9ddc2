"""Surfaces learned from touches of solids known in closed form, and what they say of an object's pose."""

import numpy as np
import pytest
import toy_solids as toy

from tactsim.core import InputError, rigid
from tactsim.estimators.space.space_field import SpaceField, SpaceMapOptions


@pytest.fixture(scope="module")
def scan():
    return toy.toy_scan(180, 1, ("ball", "block", "tee"))


@pytest.fixture(scope="module")
def field(scan):
    return SpaceField.learn(scan, SpaceMapOptions())


def test_the_stiffness_is_found(field):
    assert field.touching.stiffness == pytest.approx(toy.STIFFNESS, rel=0.25)


def test_the_learned_surface_is_the_solids(field):
    for label, surface in zip(field.labels, map(field.surface, range(3)), strict=True):
        away = toy.SOLIDS[label].distance(surface.points)
        assert np.median(np.abs(away)) < 0.35
        assert np.quantile(np.abs(away), 0.75) < 0.5  # the pad does not get into the tee's inner corners


def test_objects_and_poses_are_told_apart(scan, field):
    rng = np.random.default_rng(2)
    test = scan.where("test")
    for number, label in enumerate(field.labels):
        mine = test.labels == label
        field.reset()
        field.append(test.readings[mine], test.poses[mine])
        own = field.log_p(number, rigid.IDENTITY[None])[0]
        others = [field.log_p(other, rigid.IDENTITY[None])[0] for other in range(3) if other != number]
        away = toy.placed(np.repeat(rigid.IDENTITY[None], 50, axis=0), rng, mm=2.0, rad=0.2)
        assert own > max(others) + 100
        assert own > field.log_p(number, away).max()


def test_turning_the_world_changes_nothing(scan, field):
    rng = np.random.default_rng(3)
    test = scan.where("test")
    world = np.concatenate([rng.uniform(-30, 30, 3), rigid.random_rotations(1, rng)[0]])
    states = toy.placed(np.repeat(rigid.IDENTITY[None], 20, axis=0), rng, mm=1.0, rad=0.1)
    field.reset()
    field.append(test.readings[:5], test.poses[:5])
    before = field.log_p(0, states)
    field.reset()
    field.append(test.readings[:5], rigid.compose(world, test.poses[:5]))
    np.testing.assert_allclose(field.log_p(0, rigid.compose(world, states)), before, rtol=1e-9)


def test_touches_add_up(scan, field):
    test = scan.where("test")
    field.reset()
    field.append(test.readings[:4], test.poses[:4])
    whole = field.log_p(1, rigid.IDENTITY[None])
    parts = [field.log_p(1, rigid.IDENTITY[None], first, first + 1) for first in range(4)]
    np.testing.assert_allclose(whole, np.sum(parts, axis=0))


def test_a_touch_is_foreseen(field):
    rng = np.random.default_rng(4)
    solid = toy.SOLIDS["ball"]
    points, normals = solid.surface(10, rng)
    start = toy.toward(points, -normals, rng)
    rest, ideal, met = toy.press(solid, start)
    assert met.all()
    travel, image = field.foresee(field.labels.index("ball"), rigid.IDENTITY[None], start)
    np.testing.assert_allclose(travel, np.linalg.norm(rest[:, :3] - start[:, :3], axis=1), atol=0.6)
    assert np.abs(image - ideal).mean() < 0.15 * ideal.max()
    away = start + np.array([0.0, 0.0, 200.0, 0.0, 0.0, 0.0, 0.0])
    travel, image = field.foresee(0, rigid.IDENTITY[None], away)
    assert (travel == toy.STROKE).all()
    assert not image.any()


def test_a_scan_without_training_touches_is_refused(scan):
    with pytest.raises(InputError, match="no touches with split 'train'"):
        SpaceField.learn(scan.where("test"), SpaceMapOptions())
