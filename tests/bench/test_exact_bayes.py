"""Exact Bayes against a dense grid, the references against it, and `bench bound` as a user calls it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import reference_posteriors as references

import tactsim
from tactsim.bench.exact_bayes import ExactBayes, ExactBayesOptions, least_expected_error
from tactsim.bench.placement import Properties, placement_error, properties
from tactsim.core import InputError, compose, invert
from tactsim.press.press_model import forward_model

FLAT = Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=50.0)


@pytest.mark.slow
def test_exact_bayes_is_the_sum_over_a_dense_grid():
    """Noise of 25 kPa and exact poses, so that a grid of 1 mm and 9 degrees is dense."""
    scan = tactsim.scan(
        letters="IU", world="level", noise=25.0,
        scan_set={"placement_mm": 0.0, "placement_rad": 0.0, "sensor.resolution": 0.0},
    )  # fmt: skip
    test, forward = scan.where("test", "U"), forward_model(scan)
    true_pose = np.array([2.0, -3.0, 0.7])
    rows = np.flatnonzero(test.readings.max(axis=1) > 90)[:2]
    sensor_in_robot = compose(invert(true_pose), test.poses[rows])

    line = np.arange(-9.5, 10)
    grid = np.stack(np.meshgrid(line, line, 2 * np.pi * np.arange(40) / 40 - np.pi, indexing="ij"), axis=-1)
    grid = grid.reshape(-1, 3)
    log_p = np.array([
        sum(
            -((reading - forward.readings(letter, compose(grid, pose))) ** 2).sum(axis=1) / (2 * 25.0**2)
            for reading, pose in zip(test.readings[rows], sensor_in_robot, strict=True)
        )
        for letter in ("I", "U")
    ])  # fmt: skip
    p = np.exp(log_p - log_p.max())
    p /= p.sum()

    exact = ExactBayes(ExactBayesOptions(split=2e-4))
    exact.fit(scan)
    exact.reset(np.random.default_rng(0))
    for reading, pose in zip(test.readings[rows], sensor_in_robot, strict=True):
        exact.update(reading, pose)
    estimate = exact.estimate()
    assert estimate.probabilities["U"] == pytest.approx(p[1].sum(), abs=0.02)
    assert 0.05 < p[1].sum() < 0.999

    mine = estimate.samples
    of_letter = p[("I", "U").index(estimate.label)]
    best = least_expected_error(grid[of_letter > 0], of_letter[of_letter > 0] / of_letter.sum(), FLAT)
    objects = properties(scan)[estimate.label]
    expected = [
        float(weights @ placement_error(poses, best, objects))
        for poses, weights in ((mine.poses, mine.weights), (grid, of_letter / of_letter.sum()))
    ]
    assert expected[0] == pytest.approx(expected[1], rel=0.05)


@pytest.mark.parametrize("option", ["sensor.gain_spread=0.3", "load_spread=0.3"])
def test_what_exact_bayes_does_not_know_is_said(here, option):
    assert not here("scan", "--letters", "I", "--scan-set", option, "--out", "odd.npz").returncode
    out = here("bound", "--scan", "odd.npz", "--trials", "1", "--readings", "2", "--json")
    found = json.loads(out.stdout)
    assert option.partition("=")[0] in found["no_bayes"]
    assert found["bayes_accuracy"] == [None, None]
    assert len(found["determined"]) == 2


def test_the_pose_of_least_expected_error_is_the_median_of_three():
    objects = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    found = least_expected_error(invert(objects), np.array([0.2, 0.45, 0.35]), FLAT)
    assert placement_error(found, invert(objects[1]), FLAT) < 1e-4


def test_turns_are_folded_by_the_symmetry():
    objects = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.1 + np.pi], [0.0, 0.0, 0.12]])
    found = least_expected_error(invert(objects), np.full(3, 1 / 3), replace(FLAT, symmetry=2))
    assert abs(np.sin(2 * (invert(found)[2] - 0.1))) < 0.05


def test_energy_distance_of_equal_sets_is_none_and_of_two_points_twice_their_distance():
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(50, 3))
    assert references.energy_distance(poses, poses, FLAT) == pytest.approx(0, abs=1e-12)
    one, other = np.zeros((1, 3)), np.array([[3.0, 4.0, 0.0]])
    assert references.energy_distance(one, other, FLAT) == pytest.approx(10)


@pytest.mark.long
def test_shipped_references_are_what_is_made_anew():
    """The first object's first three readings, with the first of both brute forces."""
    shipped = references.load()
    assert shipped.pose.shape == (10, 5, 3)
    assert shipped.samples.shape == (10, 5, references.SAMPLES, 3)
    truth, true_pose, readings, sensor_in_robot = next(references.felt())
    assert truth == shipped.truth[0]
    np.testing.assert_allclose(readings, shipped.readings[0], atol=1e-4)
    np.testing.assert_allclose(sensor_in_robot, shipped.sensor_in_robot[0], atol=1e-5)
    np.testing.assert_allclose(true_pose, shipped.true_pose[0], atol=1e-5)
    exact = ExactBayes()
    exact.fit(references.training())
    objects = properties(references.training())
    for a, estimate in enumerate(references.believed(exact, readings[:3], sensor_in_robot[:3])):
        p = np.array([estimate.probabilities[letter] for letter in references.OPTIONS.letters])
        assert np.abs(p - shipped.probabilities[0, a]).max() < 0.02
        if estimate.label == references.OPTIONS.letters[int(shipped.probabilities[0, a].argmax())]:
            of = objects[estimate.label]
            spread = placement_error(shipped.samples[0, a], shipped.pose[0, a], of).mean()
            assert placement_error(estimate.robot_in_object, shipped.pose[0, a], of) < 0.1 * spread + 0.01


def test_a_runs_bound_is_kept_with_it(tmp_path):
    run = tactsim.run(letters="AE", trials=2, readings=12, estimator="nearest", bound=True)
    run.save(tmp_path / "run")
    again = tactsim.Run.load(tmp_path / "run")
    np.testing.assert_array_equal(again.bounds, run.bounds)
    assert again.against_bound == run.against_bound
    assert run.bound_mm[-1] > 0
    assert run.efficiency[-1] > 1
    table = (tmp_path / "run" / "bounds.csv").read_text()
    (tmp_path / "run" / "bounds.csv").write_text(table.replace("A,1,", "A,2,", 1))
    with pytest.raises(InputError, match=r"bounds\.csv does not have the rows"):
        tactsim.Run.load(tmp_path / "run")


def test_a_run_without_a_known_press_says_so(scan_file):
    scan = tactsim.Scan.load(scan_file)
    run = tactsim.run(replace(scan, meta={}), trials=1, readings=2, estimator="nearest", bound=True)
    assert run.bounds is None
    assert "do not say how they were pressed" in run.about["no_bound"]
    assert np.isnan(run.efficiency).all()
