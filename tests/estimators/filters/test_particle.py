"""Particles: memory, underflow and injection, and the inner loops against plain NumPy with the same random numbers."""

import tracemalloc

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, started

from tactsim.core import wrap_angle
from tactsim.estimators.filters.particle_kernels import PARZEN_STEP, draw, move, parzen_mode


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_a_reach_of_a_metre_takes_no_more_memory_than_particles_do(name, scan):
    filter = started(name, scan, particles=300, reach=1000.0)
    tracemalloc.start()
    for _ in range(2):
        filter.update(np.zeros(36), [500.0, 0, 0])
        assert np.isfinite(filter.estimate().robot_in_object).all()
        filter.belief_over_plane()
    assert tracemalloc.get_traced_memory()[1] < 200e6
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_weights_survive_what_no_particle_explains(name, scan):
    # exp of these log-likelihoods is zero for every particle: 36 taxels with p of 1e-300 each.
    filter = started(name, scan, particles=50, gamma=1e-300)
    everywhere = np.full(36, 50.0)
    for k in range(20):
        filter.update(everywhere, [30.0 * (k % 2), 0, 0])
        letters = filter.estimate().probabilities
        assert sum(letters.values()) == pytest.approx(1)
        assert np.isfinite(filter.weighted_states().weights.log).all()


def test_injection_follows_the_fall_of_the_weights(scan):
    filter = fitted_anew("augmented-mcl", scan, particles=1000, alpha_slow=0.1, alpha_fast=0.9)
    rng = np.random.default_rng(0)
    filter.reset(rng)
    readings, poses, _ = draw_trial(scan, "E", 12, rng)
    for _ in range(12):
        filter.update(readings[0], poses[0])  # the same again: weights only rise
    assert filter.work["injected"] == 0
    filter.update(np.full(36, 50.0), [40.0, 0, 0])
    filter.update(np.full(36, 50.0), [40.0, 0, 0])
    assert filter.work["injected"] > 500


def test_estimates_stay_as_they_were_when_the_filter_goes_on(scan):
    filter = started("particle", scan, particles=500)
    filter.update(scan.readings[0], scan.poses[0])
    first = filter.estimate().samples
    poses, weights = first.poses.copy(), first.weights.copy()
    for _ in range(3):
        filter.update(scan.readings[1], scan.poses[1])
        filter.estimate()
    assert np.array_equal(first.poses, poses)
    assert np.array_equal(first.weights, weights)


@pytest.mark.parametrize("weights", [1, 2, 15, 1000])
@pytest.mark.parametrize("draws", [1, 7, 16, 40, 1500])
def test_draws_are_those_of_a_search_in_running_sums(weights, draws):
    rng = np.random.default_rng(weights + draws)
    for kind in range(4):
        weight, spacing = rng.random(weights) ** 20, rng.standard_exponential(draws + 1)
        if kind == 1:  # sums that are equal, which no rounding hides
            weight, spacing = np.full(weights, 2.0**-3), np.full(draws + 1, 2.0**-3)
        elif kind == 2:  # nothing at either end
            weight = np.where(np.abs(np.arange(weights) - weights // 2) < 3, weight, 0.0)
        elif kind == 3:  # all in one, now and then the last
            weight = np.where(np.arange(weights) == rng.integers(max(0, weights - 2), weights), 1.0, 0.0)
        chosen = np.empty(draws, dtype=np.int64)
        draw(chosen, weight, spacing)
        filled, reached = np.cumsum(weight), np.cumsum(spacing * (weight.sum() / spacing.sum()))
        wanted = np.searchsorted(filled, reached[:-1], side="right")
        # The sums are rounded differently, which may decide where two are equal.
        rounded = np.isclose(filled[:, None], reached[:-1], rtol=1e-12).any(axis=0)
        assert chosen[~rounded].tolist() == np.minimum(wanted, weights - 1)[~rounded].tolist()


@pytest.mark.parametrize("count", [1, 127, 1000])
def test_particles_move_as_in_plain_numpy(count):
    rng = np.random.default_rng(count)
    before, noise = rng.uniform(-4, 4, (3, 700)), np.array([1.0, 0.5, 0.1])
    chosen, normal = rng.integers(700, size=count), rng.standard_normal((3, count))
    state = np.empty((3, count))
    move(state, before, chosen, normal, noise, 4.0)
    wanted = before[:, chosen] + noise[:, None] * normal
    wanted[:2] = np.clip(wanted[:2], -4, 4)
    assert state == pytest.approx(wanted, abs=1e-12)


def parzen(nodes, states, weights, rho):
    """Eq. 10 and 11 at nodes (n, 3), with every particle at every node."""
    away = states - np.asarray(nodes)[:, None]
    away[..., 2] = wrap_angle(away[..., 2])
    return np.maximum(0, 1 - np.linalg.norm(away, axis=-1) / rho) @ weights


@pytest.mark.parametrize("rho", [1.0, 0.3, 2.5])
@pytest.mark.parametrize("light", [0.0, 1e-7, 0.2])
def test_mode_is_the_highest_node_by_brute_force(rho, light):
    rng = np.random.default_rng(7)
    # Around the place where the angle wraps, so that cones reach across it.
    states = rng.normal([3, -2, 0], [0.8, 0.6, 0.3], size=(30, 3)) + [0, 0, 2 * np.pi]
    weights = rng.random(30)
    weights[10:] *= light
    nodes = [
        (i * PARZEN_STEP[0], j * PARZEN_STEP[1], k * PARZEN_STEP[2])
        for i in range(2, 11)
        for j in range(-8, 1)
        for k in range(50)
    ]
    heights = parzen(nodes, states, weights, rho)
    mode, _ = parzen_mode(np.ascontiguousarray(states.T), weights, rho)
    assert parzen([mode], states, weights, rho) == pytest.approx(heights.max())
    assert np.rint(mode / PARZEN_STEP) * PARZEN_STEP == pytest.approx(mode)


def beliefs(count, most=60):
    """Draw weighted states of all kinds, some with equally high nodes, and a rho."""
    rng = np.random.default_rng(11)
    for trial in range(count):
        states = rng.uniform(-1, 1, (3, int(rng.integers(1, most)))) * [[12.0], [25.0], [7.0]]
        weights = 10.0 ** -rng.uniform(0, 6, states.shape[1])
        if trial % 3 == 0:
            half = states.shape[1] // 2
            states[:, half:] = states[:, : states.shape[1] - half] + [[16.0], [8.0], [0.0]]
            weights[:] = 1.0
        yield states, weights, float(rng.choice([0.3, 1.0, 3.0]))


def test_skipped_columns_change_no_mode():
    skipped = 0
    for states, weights, rho in beliefs(60, most=400):
        mode, left_out = parzen_mode(states, weights, rho)
        whole, none = parzen_mode(states, weights, rho, skip=False)
        assert mode.tolist() == whole.tolist()
        assert none == 0 <= left_out < len(weights)
        skipped += left_out
    assert skipped > 1000


def test_a_node_that_light_particles_alone_reach_can_be_the_highest():
    # The heavy one's cone ends before any node; those of the light ones, at a node, are added up there.
    states = np.concatenate([[[0.25], [0.25], [0.06]], np.zeros((3, 500))], axis=1)
    weights = np.append(1.0, np.full(500, 1e-5))
    states[0, 1:] = 20.0
    assert parzen_mode(states, weights, rho=0.3)[0] == pytest.approx([20.0, 0.0, 0.0])


def test_a_cone_that_reaches_no_node_has_the_node_nearest_to_it():
    mode, _ = parzen_mode(np.array([[1.2, 9.2], [2.2, 9.2], [-0.3, 0.1]]), np.array([1.0, 0.1]), rho=0.05)
    assert mode == pytest.approx([1.0, 2.0, -2 * PARZEN_STEP[2]])
