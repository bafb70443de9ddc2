"""Particles: memory, underflow and injection, and the inner loops against plain NumPy with the same random numbers."""

import tracemalloc

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, started

from tactsim.estimators.filters.particle_kernels import draw, move


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
