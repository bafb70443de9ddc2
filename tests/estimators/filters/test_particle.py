import tracemalloc

import numpy as np
import pytest
import reference
from synthetic import draw_trial, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import invert

COARSE = paper_poses(positions=3, angles=4)


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


def test_weights_are_equation_7():
    scan = make_scan("EI", poses=COARSE)
    filter = estimators.create("particle", particles=60, cell=0.1, noise_mm=0, noise_rad=0)
    filter.fit(scan)
    rng = np.random.default_rng(1)
    readings, poses, _ = draw_trial(scan, "I", 1, rng)
    filter.reset(rng)
    filter.update(readings[0], poses[0])
    belief = filter.weighted_states()
    literal = [
        reference.log_likelihood(filter.maps[filter.labels[k]], state, readings[0], poses[0], scan.taxel_xy)
        for k, state in zip(belief.letter, belief.state.T, strict=True)
    ]
    assert belief.weights.log == pytest.approx(np.array(literal), abs=0.4)
    assert np.corrcoef(belief.weights.log, literal)[0, 1] > 0.9999


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
        assert np.isfinite(filter.weighted_states().weights.log).all()


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


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_leaving_cones_out_changes_no_answer(name, scan):
    quick, full = (estimators.create(name, particles=2000, skip=skip) for skip in (True, False))
    readings, poses, _ = draw_trial(scan, "L", 8, np.random.default_rng(3))
    for filter in (quick, full):
        filter.fit(scan)
        filter.reset(np.random.default_rng(1))
    for reading, pose in zip(readings, poses, strict=True):
        one, other = (filter.update(reading, pose) or filter.estimate() for filter in (quick, full))
        assert one.probabilities == other.probabilities
        assert one.robot_in_object.tolist() == other.robot_in_object.tolist()
        assert np.array_equal(one.samples.poses, other.samples.poses)
    assert quick.work["skipped"]["cones"] > 2000
    assert full.work["skipped"]["cones"] == 0


def test_estimates_stay_as_they_were_when_the_filter_goes_on(scan):
    filter = estimators.create("particle", particles=500)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    filter.update(scan.readings[0], scan.poses[0])
    first = filter.estimate().samples
    poses, weights = first.poses.copy(), first.weights.copy()
    for _ in range(3):
        filter.update(scan.readings[1], scan.poses[1])
        filter.estimate()
    assert np.array_equal(first.poses, poses)
    assert np.array_equal(first.weights, weights)
