"""Surfaces learned from touches of solids known in closed form, and what they say of an object's pose."""

import numpy as np
import pytest
import toy_solids as toy

from tactsim.core import rigid
from tactsim.estimators.filters.trust import Trust
from tactsim.solids.field import SpaceField, SpaceMapOptions, conformal


@pytest.fixture(scope="module")
def scan():
    return toy.toy_scan(120, 1, ("ball", "block", "tee"))


@pytest.fixture(scope="module")
def field(scan):
    return SpaceField.learn(scan, SpaceMapOptions())


@pytest.mark.long
def test_the_stiffness_is_found(field):
    assert field.touching.stiffness == pytest.approx(toy.STIFFNESS, rel=0.25)


@pytest.mark.long
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
        assert own > max(others) + 4 * field.touches  # what one touch says is bounded
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


def touched(field, scan, label, count=10):
    """Give a field the first test touches of an object."""
    test = scan.where("test")
    mine = np.flatnonzero(test.labels == label)[:count]
    field.reset()
    field.append(test.readings[mine], test.poses[mine])
    return field.labels.index(label)


def test_a_belief_is_the_surer_beyond_its_right_the_more_touches_meet_the_object_and_where_they_are_chosen(
    scan, field
):
    assert all(trust(1) <= 1 and trust(20) <= trust(4) for trust in field.trust)
    met, missed = scan.where("test").readings[:1], np.zeros((1, 36))
    other = SpaceField({}, field.rays, field.touching, 2.0, (Trust(own=1, shared=0.5), Trust(own=3)))
    factors = [other.too_sure]
    for reading, chosen in ((met, False), (missed, False), (met, False), (met, True), (met, False)):
        other.append(reading, rigid.IDENTITY[None], chosen)
        factors.append(other.too_sure)
    np.testing.assert_allclose(factors, [1.5, 1.5, 1.5, 2, 3, 3])
    other.reset()
    assert other.too_sure == factors[0]


def test_a_further_score_exceeds_the_conformal_one_as_seldom_as_is_said():
    rng = np.random.default_rng(0)
    scores = rng.exponential(size=(4000, 20))
    limits = np.array([conformal(some[:-1].tolist(), 0.9) for some in scores])
    assert (scores[:, -1] <= limits).mean() == pytest.approx(0.9, abs=0.02)  # 18 of 20
    assert conformal([3.0, 1.0], 0.9) == 3.0


def test_poses_climb_to_where_touches_agree(scan, field):
    rng = np.random.default_rng(5)
    number = touched(field, scan, "tee")
    start = toy.placed(np.repeat(rigid.IDENTITY[None], 40, axis=0), rng, mm=1.0, rad=0.08)
    reached, information, log_p = field.climb(number, start, 6)
    np.testing.assert_allclose(log_p, field.log_p(number, reached))
    assert (log_p >= field.log_p(number, start)).all()
    true = field.log_p(number, rigid.IDENTITY[None])[0]
    before, after = np.median(field.log_p(number, start)), np.median(log_p)
    assert before < true - 10
    assert after > before + 2 / 3 * (true - before)
    np.testing.assert_allclose(information, np.swapaxes(information, 1, 2), atol=1e-6)
    assert np.linalg.eigvalsh(information).min() > 0
