"""Particles on the group against closed forms: Gaussians about known poses of two objects."""

import numpy as np
import pytest

from tactsim.core import rigid
from tactsim.estimators.filters.states import Weights
from tactsim.solids.particles import MovedParticles, born

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
    assert few.normalised == pytest.approx(
        Weights(particles.rest[1:]).normalised
    )  # enough of them count as it is
