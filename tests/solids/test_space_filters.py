"""The filters in space on solids known in closed form: contract, brute force, symmetry and mirror images."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import toy_solids as toy
from space_contract import SPACE_CHECKS, SpaceCase
from synthetic import make_scan

from tactsim import estimators
from tactsim.core import InputError, rigid
from tactsim.estimators.contract.checks import objects_are_recognised
from tactsim.estimators.filters.states import Weights
from tactsim.solids import pose_search
from tactsim.solids.field import surface_of
from tactsim.solids.particles import MovedParticles, born, mean_around, widened
from tactsim.solids.pose_search import PointReader
from tactsim.solids.voxels import sparse

SPACE = ("space-refined",)
# mm, the pad's way
PASSED = np.array([[x, y, -z] for x in (-4.0, 4.0) for y in (-4.0, 4.0) for z in (5.0, 12.0)])
TAXELS = np.column_stack([toy.PAD.taxel_xy, np.zeros(36)])
# The options that take time: how many poses are tried, and for how many contacts. Of four touches one has no search.
QUICK = {
    "rotations": 3, "voxel": 12.0, "cells": 60, "halvings": 3, "particles": 60, "rounds": 6,
    "seeds": 150, "searches": 3,
}  # fmt: skip
# Enough to tell two objects apart; the brute-force test keeps the default seeds.
FEW = {"seeds": 150, "cells": 150, "particles": 150}
HOOK = (
    ((14.0, 4.0, 4.0), (0.0, 0.0, 0.0)),
    ((4.0, 9.0, 4.0), (10.0, 13.0, 0.0)),
    ((4.0, 4.0, 8.0), (-10.0, 0.0, 12.0)),
)


def hook(side):
    """A solid that is not its own mirror image; side 1 or -1."""
    return toy.Union(tuple(toy.Box(half, (side * x, y, z)) for half, (x, y, z) in HOOK))


@cache
def charted(solid, cell, reach=34.0):
    """Sample a solid's signed distances: voxels, and its surface."""
    axis = np.arange(-reach, reach + cell, cell)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    corner, distance = np.full(3, -reach), solid.distance(grid).astype(np.float32)
    felt = np.ones(distance.shape, dtype=bool)
    return sparse(corner, cell, distance, 3.0), surface_of(corner, cell, distance, felt, 2.0)


class ToyField:
    """log p of a touch: how far what is touched is from the surface, and what the pad passed is within; both normal."""

    too_sure = 1.0

    def __init__(self, solids, width=1.5, cell=0.8):
        charts = {label: charted(solid, cell) for label, solid in solids.items()}
        self.maps = {label: voxels for label, (voxels, _) in charts.items()}
        self.surfaces = [surface for _, surface in charts.values()]
        self.labels, self.width = tuple(solids), width
        self.touching = SimpleNamespace(stiffness=toy.STIFFNESS, noise=np.full(36, 2.0))
        self.reader = PointReader(TAXELS, toy.STIFFNESS, 2.0)
        self.reset()

    def reset(self):
        self.points = []

    @property
    def touches(self):
        return len(self.points)

    def append(self, readings, sensors, chosen=False):
        for reading, sensor in zip(readings, sensors, strict=True):
            seen = self.reader.read(reading[None], sensor[None])
            way = np.concatenate(
                [PASSED, [[0.0, 0.0, -z] for z in range(0 if not seen.points[0] else 4, 40, 4)]]
            )
            self.points.append(
                [rigid.transform(sensor, one) for one in (seen.point[0, : seen.points[0], :3], way)]
            )

    def surface(self, label):
        return self.surfaces[label]

    def reach(self, label):
        return float(np.linalg.norm(self.surface(label).points, axis=1).max())

    def log_p(self, label, poses, first=0, last=None):
        total = np.zeros(len(poses))
        for touched, passed in self.points[first:last]:
            placed = np.ascontiguousarray(
                rigid.transform(rigid.invert(poses), np.concatenate([touched, passed]))
            )
            away = toy.distances(self.maps[self.labels[label]], placed.reshape(-1, 3))
            square = away.reshape(len(poses), -1) ** 2 / self.width**2
            within = np.where(away.reshape(len(poses), -1) < 0, square, 0.0)[:, len(touched) :]
            total -= 0.5 * (square[:, : len(touched)].sum(axis=1) / max(len(touched), 1) + within.sum(axis=1))
        return total

    def climb(self, label, poses, steps):
        """Stay where it is; the information is that of central differences, along each axis alone."""
        information = np.empty((len(poses), 6, 6))
        for axis, step in enumerate([0.5] * 3 + [0.05] * 3):
            move = np.zeros((2, 6))
            move[:, axis] = step, -step
            off = [
                self.log_p(label, rigid.compose(poses, np.concatenate([one[:3], rigid.from_vector(one[3:])])))
                for one in move
            ]
            information[:, axis] = 0.0
            bent = (2 * self.log_p(label, poses) - off[0] - off[1]) / step**2
            information[:, axis, axis] = np.maximum(bent, (1 / 9, 1 / 0.09)[axis >= 3])
        return np.array(poses), information, self.log_p(label, poses)


def hidden(solid, count, seed, noise=2.0):
    """Hide a solid and touch it from random sides: object_in_robot, readings and sensor_in_robot."""
    rng = np.random.default_rng(seed)
    object_in_robot = np.concatenate([rng.uniform(-9, 9, 3), rigid.random_rotations(1, rng)[0]])
    inward = rigid.turned(rigid.random_rotations(count, rng), np.array([0.0, 0.0, 1.0]))
    start = toy.toward(rng.uniform(-6, 6, (count, 3)), inward, rng, 50.0)
    rest, ideal, _ = toy.press(solid, start, 120.0)
    readings = ideal + noise * rng.standard_normal(ideal.shape)
    return object_in_robot, readings, rigid.compose(object_in_robot, toy.placed(rest, rng))


def with_field(field, **options):
    estimator = estimators.create("space-refined", **options)
    estimator.fit_field(field, TAXELS)
    return estimator


def after(estimator, readings, sensors, seed=0):
    """The estimate after all touches."""
    estimator.reset(np.random.default_rng(seed))
    for reading, sensor in zip(readings, sensors, strict=True):
        estimator.update(reading, sensor)
    return estimator.estimate()


@pytest.mark.long
def test_the_belief_is_that_of_brute_force(monkeypatch):
    # The quick look is as wide as this field's likelihood: three places count as much there as one here.
    monkeypatch.setattr(pose_search, "_WIDTH", 1.5 * np.sqrt(3))
    solids = {"ball": toy.SOLIDS["ball"], "block": toy.SOLIDS["block"]}
    field = ToyField(solids)
    reach, count = 6.0, 60_000
    estimator = with_field(field, reach=reach, searches=10, cells=5000, particles=600)
    rng = np.random.default_rng(7)
    poses = np.concatenate(
        [rng.uniform(-reach, reach, (count, 3)), rigid.random_rotations(count, rng)], axis=1
    )
    inward = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    rest, readings, met = toy.press(solids["block"], toy.toward(np.zeros((3, 3)), inward, rng, 40.0))
    assert met.all()
    found, beliefs = [], []
    for seed in range(4):
        found.append(after(estimator, readings[None], rest[None], seed))  # all pads at once: one search
        beliefs.append(estimator.belief())
    log_p = np.stack([field.log_p(label, poses) for label in range(2)])
    weight = np.exp(log_p - log_p.max())
    chance = np.mean([estimate.probabilities["block"] for estimate in found])
    assert chance == pytest.approx(weight[1].sum() / weight.sum(), abs=0.06)

    # How far the origin lies from the robot's, and how much of the belief has the block's short side up.
    def moments(poses, weight):
        far = np.linalg.norm(poses[:, :3], axis=1)
        up = np.abs(rigid.turned(poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2])
        return np.array([weight @ far, weight @ up]) / weight.sum()

    ours = np.mean(
        [
            moments(pose[label == 1], np.exp(weights.log[label == 1] - weights.log.max()))
            for label, pose, weights in beliefs
        ],
        axis=0,
    )
    np.testing.assert_allclose(ours, moments(poses, weight[1]), rtol=0.1)


@pytest.mark.long
def test_mirror_images_are_told_apart():
    estimator = with_field(ToyField({"left": hook(1), "right": hook(-1)}, 0.5), **FEW)
    for seed, side in enumerate((1, -1)):
        _, readings, sensors = hidden(hook(side), 9, seed)
        assert after(estimator, readings, sensors).label == ("left" if side == 1 else "right")


@pytest.mark.long
def test_several_pads_at_once_say_what_they_say_one_after_another():
    field = ToyField({"tee": toy.SOLIDS["tee"], "hook": hook(1)}, 0.5)
    estimator = with_field(field, **FEW)
    _, readings, sensors = hidden(hook(1), 8, 3)
    estimator.reset(np.random.default_rng(0))
    for first in range(0, 8, 2):
        estimator.update(readings[first : first + 2], sensors[first : first + 2])
    assert field.touches == 8
    assert estimator.estimate().label == after(estimator, readings, sensors).label == "hook"


def test_objects_with_equal_maps_share_their_probability():
    field = ToyField({"one": hook(1), "ball": toy.SOLIDS["ball"], "two": hook(1)}, 0.5, cell=1.6)
    estimator = with_field(field, **QUICK)
    _, readings, sensors = hidden(hook(1), 3, 3)
    estimate = after(estimator, readings, sensors)
    assert estimate.probabilities["one"] == estimate.probabilities["two"] > 0


def test_a_scan_of_the_plane_is_refused():
    with pytest.raises(InputError, match="--task solids"):
        estimators.create("space-refined").fit(make_scan("EI"))


@pytest.fixture(scope="module")
def scan():
    return toy.toy_scan(80, 1, ("block", "tee"))


@pytest.fixture(scope="module", params=SPACE)
def case(request, scan):
    return SpaceCase(lambda: estimators.create(request.param, **QUICK), scan)


@pytest.mark.parametrize(
    "check",
    [
        pytest.param(check, marks=pytest.mark.long) if check is objects_are_recognised else check
        for check in SPACE_CHECKS
    ],
)
def test_an_estimator_in_space_keeps_its_contract(check, case):
    check(case)


TRUE = np.array([3.0, -2.0, 1.0, *rigid.from_vector([0.3, -0.2, 0.9])])
SHIFT, TURN = 0.15, 0.02  # mm and rad
ADVANTAGE = 1.2  # nats of evidence that object 1 has


def log_p(label, pose):
    off = (pose[:, :3] - TRUE[:3]) / SHIFT
    turned = rigid.angle_between(TRUE[3:], pose[:, 3:]) / TURN
    return -0.5 * ((off**2).sum(axis=1) + turned**2) + ADVANTAGE * (label == 1)


def settled(seed, count=400):
    """Particles spread evenly over a box and a ball of turns, moved until they stand for the Gaussians."""
    rng = np.random.default_rng(seed)
    label = np.repeat([0, 1], count)
    vector = rng.standard_normal((2 * count, 3))
    vector *= 0.25 * rng.random((2 * count, 1)) ** (1 / 3) / np.linalg.norm(vector, axis=1, keepdims=True)
    pose = np.concatenate(
        [TRUE[:3] + rng.uniform(-2, 2, (2 * count, 3)), rigid.multiply(rigid.from_vector(vector), TRUE[3:])],
        axis=1,
    )
    particles = born(label, pose, log_p(label, pose), np.zeros(2 * count), count)
    particles.settle(log_p, TRUE[None, :3] + [0.0, 0.0, 5.0], 20.0, rng, 2 * count, 40, count)
    return particles


def test_particles_come_to_stand_for_the_posterior():
    share, spread, turn = [], [], []
    for seed in range(24):
        particles = settled(seed)
        assert particles.power == 1.0
        weight = np.exp(particles.rest - particles.rest.max())
        weight /= weight.sum()
        share.append(weight[particles.label == 1].sum())
        spread.append(weight @ ((particles.pose[:, :3] - TRUE[:3]) ** 2).sum(axis=1) / 3)
        turn.append(weight @ rigid.angle_between(TRUE[3:], particles.pose[:, 3:]) ** 2 / 3)
    assert np.mean(share) == pytest.approx(1 / (1 + np.exp(-ADVANTAGE)), abs=0.12)  # three times its chance
    assert np.sqrt(np.mean(spread)) == pytest.approx(SHIFT, rel=0.2)
    assert np.sqrt(np.mean(turn)) == pytest.approx(TURN, rel=0.2)


def test_no_particle_leaves_the_prior():
    rng = np.random.default_rng(0)
    particles = settled(1)
    for _ in range(20):
        particles.move(log_p, np.empty((0, 3)), 3.05, rng)
    assert np.abs(particles.pose[:, :3]).max() <= max(3.05, np.abs(settled(1).pose[:, :3]).max())


def test_a_touch_that_is_taken_in_is_weighed_once():
    particles = settled(2)
    before, log_p_before = particles.rest.copy(), particles.log_p.copy()
    new = np.random.default_rng(3).normal(size=len(before))
    particles.take_in(new)
    np.testing.assert_allclose(particles.rest, before + new)
    np.testing.assert_allclose(particles.log_p, log_p_before + new)


def test_a_belief_that_one_particle_would_hold_is_spread_over_those_that_power_leaves():
    rng = np.random.default_rng(8)
    log_p = np.concatenate([[80.0], rng.normal(size=99)])
    particles = MovedParticles(np.zeros(100, int), np.zeros((100, 7)), log_p, 0.1 * log_p, 0.1)
    every = np.arange(100)
    assert Weights(particles.rest).ess < 1.01
    held = particles.spread(every, 20)
    assert held.ess == pytest.approx(20, abs=1)
    assert held.log[0] == held.log.max()
    few = particles.spread(every[1:], 20)
    # Enough of them count as it is
    assert few.normalised == pytest.approx(Weights(particles.rest[1:]).normalised)


PLACES = np.array([[3.0, -2.0, 1.0], [-25.0, 10.0, 4.0]])


def two_modes(counts, rng):
    """Poses about two places, by `counts`, 0.3 mm and 0.03 rad wide."""
    vector = np.repeat([[0.4, 0.1, -0.8], [2.0, -1.0, 0.3]], counts, axis=0)
    turn = rigid.multiply(
        rigid.from_vector(0.03 * rng.standard_normal((sum(counts), 3))), rigid.from_vector(vector)
    )
    place = np.repeat(PLACES, counts, axis=0) + 0.3 * rng.standard_normal((sum(counts), 3))
    return np.concatenate([place, turn], axis=1)


def test_the_heavier_mode_is_averaged_and_not_the_one_of_the_heaviest_state():
    rng = np.random.default_rng(0)
    poses, weights = two_modes((200, 100), rng), np.full(300, 1.0)
    weights[250] = 60.0  # one heavy state of the mode that holds less
    mean, _ = mean_around(poses, weights / weights.sum())
    assert np.linalg.norm(mean[:3] - PLACES[0]) < 0.1
    assert rigid.angle_between(mean[3:], rigid.from_vector(np.array([0.4, 0.1, -0.8]))) < 0.02
    weights[250] = 400.0
    assert np.linalg.norm(mean_around(poses, weights / weights.sum())[0][:3] - PLACES[1]) < 1.0


def test_the_mean_is_that_of_the_states_near_by():
    poses = two_modes((3, 1), np.random.default_rng(1))
    weights = np.array([0.2, 0.3, 0.1, 0.4])
    mean, near = mean_around(poses, weights)
    np.testing.assert_allclose(mean[:3], np.array([0.2, 0.3, 0.1]) @ poses[:3, :3] / 0.6)
    assert near.tolist() == [True, True, True, False]


def test_both_modes_of_widened_states_have_the_variances_that_are_asked_for():
    rng = np.random.default_rng(5)
    poses = two_modes((6000, 3000), rng)
    mean, near = mean_around(poses, np.full(9000, 1 / 9000))
    moved = widened(poses, mean, near.astype(float), 4.0, rng.standard_normal((9000, 6)))
    for mine in (near, ~near):
        middle, _ = mean_around(poses[mine], np.full(mine.sum(), 1 / mine.sum()))
        before, after = (
            rigid.compose(np.tile(rigid.invert(middle), (mine.sum(), 1)), states[mine])
            for states in (poses, moved)
        )
        np.testing.assert_allclose(after[:, :3].var(axis=0), 4 * before[:, :3].var(axis=0), rtol=0.1)
        turns = [rigid.to_vector(off[:, 3:]).var(axis=0) for off in (before, after)]
        np.testing.assert_allclose(turns[1], 4 * turns[0], rtol=0.1)
    same = widened(poses, mean, near.astype(float), 1.0, rng.standard_normal((7, 6)))
    np.testing.assert_allclose(same, poses, atol=1e-12)


def test_a_rotation_and_its_negative_quaternion_are_one():
    poses = two_modes((40, 0), np.random.default_rng(3))
    other = poses.copy()
    other[::2, 3:] *= -1
    first, second = (mean_around(those, np.full(40, 1 / 40))[0] for those in (poses, other))
    assert rigid.angle_between(first[3:], second[3:]) < 1e-6
