import math
import tracemalloc

import numpy as np
import pytest
import reference
from synthetic import draw_trial, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError, invert, wrap_angle
from tactsim.estimators.field.state_kernels import draw
from tactsim.estimators.filters import particle
from tactsim.estimators.filters.particle import PARZEN_STEP, parzen_mode

COARSE = paper_poses(positions=3, angles=4)


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
    mode = parzen_mode(np.ascontiguousarray(states.T), weights, rho)
    assert parzen([mode], states, weights, rho) == pytest.approx(heights.max())
    assert np.rint(mode / PARZEN_STEP) * PARZEN_STEP == pytest.approx(mode)


def test_tiles_find_the_same_mode(monkeypatch):
    rng = np.random.default_rng(11)
    for trial in range(40):
        count = int(rng.integers(1, 60))
        states = rng.uniform(-1, 1, (3, count)) * [[12.0], [25.0], [7.0]]
        weights = 10.0 ** -rng.uniform(0, 6, count)
        if trial % 3 == 0:  # equally high nodes in several tiles: the first counts
            states[:, count // 2 :] = states[:, : count - count // 2] + [[16.0], [8.0], [0.0]]
            weights[:] = 1.0
        rho = float(rng.choice([0.3, 1.0, 3.0]))
        monkeypatch.setattr(particle, "_TILE", 1000)
        mode, lead = particle._density_mode(states, weights, rho)
        for tile in (8, 16, 33):
            if rho / PARZEN_STEP[0] + 1 <= tile / 2:
                monkeypatch.setattr(particle, "_TILE", tile)
                again, lead_again = particle._density_mode(states, weights, rho)
                # Of nodes summed in float32.
                assert lead_again == pytest.approx(lead, abs=3e-4 * weights.sum())
                if lead > 1e-9:  # of equally high nodes rounding decides
                    assert again.tolist() == mode.tolist()


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_a_reach_of_a_metre_takes_no_more_memory_than_particles_do(name, scan):
    filter = estimators.create(name, particles=300, reach=1000.0)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    tracemalloc.start()
    for _ in range(2):
        filter.update(np.zeros(36), [500.0, 0, 0])
        assert np.isfinite(filter.estimate().robot_in_object).all()
        filter.belief_over_plane()
    assert tracemalloc.get_traced_memory()[1] < 200e6
    tracemalloc.stop()


def test_particles_of_no_weight_can_still_be_the_only_ones():
    mode = parzen_mode(np.array([[1.0], [2.0], [0.5]]), np.array([1e-300]))
    assert mode == pytest.approx([1.0, 2.0, 0.5], abs=0.26)


def test_draws_are_in_proportion_to_the_weights():
    rng = np.random.default_rng(0)
    weights = np.array([0.0, 3.0, 1.0, 0.0, 6.0, 0.0])
    chosen = np.empty(100_000, dtype=np.int64)
    draw(chosen, weights, rng.random(len(chosen)))
    assert (np.diff(chosen) >= 0).all()
    shares = np.bincount(chosen, minlength=6) / len(chosen)
    # Five standard deviations of a binomial share.
    assert shares == pytest.approx(weights / 10, abs=5 * 0.5 / math.sqrt(len(chosen)))
    assert shares[[0, 3, 5]].tolist() == [0, 0, 0]


def test_weights_are_equation_7():
    scan = make_scan("EI", poses=COARSE)
    filter = estimators.create("particle", particles=60, cell=0.1, noise_mm=0, noise_rad=0)
    filter.fit(scan)
    rng = np.random.default_rng(1)
    readings, poses, _ = draw_trial(scan, "I", 1, rng)
    filter.reset(rng)
    filter.update(readings[0], poses[0])
    literal = [
        reference.log_likelihood(filter.maps[filter.labels[k]], state, readings[0], poses[0], scan.taxel_xy)
        for k, state in zip(filter._letter, filter._state.T, strict=True)
    ]
    assert np.log(filter._weight) == pytest.approx(np.array(literal) - max(literal), abs=0.4)
    assert np.corrcoef(np.log(filter._weight), literal)[0, 1] > 0.9999


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_many_particles_find_letter_and_place(name, vowels):
    filter = estimators.create(name, particles=10_000)
    filter.fit(vowels)
    right, errors = 0, []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        label = vowels.letters[seed % 5]
        readings, poses, truth = draw_trial(vowels, label, 12, rng)
        filter.reset(rng)
        for reading, pose in zip(readings, poses, strict=True):
            filter.update(reading, pose)
        got = filter.estimate()
        right += got.label == label
        off = invert(got.robot_in_object) - invert(truth)
        errors.append(np.hypot(off[0], off[1]))
    assert right >= 9  # 98 in 100 are
    assert np.median(errors) < 1.2


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_weights_survive_what_no_particle_explains(name, scan):
    # exp of these log-likelihoods is zero for every particle: 36 taxels with p of 1e-300 each.
    filter = estimators.create(name, particles=50, gamma=1e-300)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    everywhere = np.full(36, 50.0)
    for k in range(20):
        filter.update(everywhere, [30.0 * (k % 2), 0, 0])
        letters = filter.estimate().probabilities
        assert sum(letters.values()) == pytest.approx(1)
        assert np.isfinite(filter._weight).all()


def test_particles_stay_where_the_state_can_be(scan):
    filter = estimators.create("particle", particles=200, reach=4.0)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    for _ in range(30):
        filter.update(np.zeros(36), [100.0, 0, 0])  # off every map: nothing but noise
    assert np.abs(filter._state[:2]).max() <= 4


def test_injection_follows_the_fall_of_the_weights(scan):
    filter = estimators.create("augmented-mcl", particles=1000, alpha_slow=0.1, alpha_fast=0.9)
    filter.fit(scan)
    rng = np.random.default_rng(0)
    filter.reset(rng)
    readings, poses, _ = draw_trial(scan, "E", 12, rng)
    for _ in range(12):
        filter.update(readings[0], poses[0])  # the same again: weights only rise
    assert filter.work["injected"] == 0
    filter.update(np.full(36, 50.0), [40.0, 0, 0])
    filter.update(np.full(36, 50.0), [40.0, 0, 0])
    assert filter.work["injected"] > 500


def test_a_slow_mean_that_is_faster_is_refused():
    with pytest.raises(InputError, match="alpha_slow"):
        estimators.create("augmented-mcl", alpha_slow=0.6, alpha_fast=0.5)
