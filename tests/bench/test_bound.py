"""The Cramer-Rao bound where it is known in closed form, by enumeration, or reached by an estimator."""

import json

import numpy as np
import pytest

import tactsim
from tactsim import models
from tactsim.bench import cramer_rao
from tactsim.bench.cramer_rao import scan_bounds
from tactsim.bench.placement import Properties
from tactsim.bench.score import errors
from tactsim.core import InputError, compose
from tactsim.press import SensorOptions

BAR = Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=25.0)


@pytest.mark.parametrize(
    ("variances", "length"),
    [([4.0], 2 * np.sqrt(2 / np.pi)), ([1.0, 1.0], np.sqrt(np.pi / 2)),
     ([9.0, 9.0, 9.0], 6 * np.sqrt(2 / np.pi)), ([1e-12, 1e-12, 1e-12], 2e-6 * np.sqrt(2 / np.pi))],
)  # fmt: skip
def test_mean_length_of_a_gaussian_in_closed_form(variances, length):
    assert cramer_rao.mean_length(np.array(variances)) == pytest.approx(length, rel=1e-9)


@pytest.mark.parametrize("walk", [(0.5, 0.03), (0.5, 0.0), (0.0, 0.0)])
def test_the_bound_of_a_walk_is_the_covariance_of_kalmans_filter(walk):
    """A linear toy, whose object does not turn: prediction and update as Kalman (1960) has them."""
    rng = np.random.default_rng(4)
    slopes = rng.normal(size=(6, 5, 3))
    covariance, step = np.linalg.inv(slopes[0].T @ slopes[0]), np.diag(np.square([walk[0], walk[0], walk[1]]))
    expected = [covariance]
    for of in slopes[1:]:
        before = expected[-1] + step
        gain = before @ of.T @ np.linalg.inv(of @ before @ of.T + np.eye(5))
        expected.append((np.eye(3) - gain @ of) @ before)
    found = cramer_rao.walked((slopes.swapaxes(1, 2) @ slopes)[None], np.zeros((1, 6)), *walk)[0]
    np.testing.assert_allclose(np.linalg.inv(found), expected, rtol=1e-8, atol=1e-12)


def test_the_bound_of_a_walk_that_turns_is_that_of_the_whole_path():
    """The covariance of the last place, out of that of all places at once; steps are in the robot's frame.

    Some touches say nothing, and the first says nothing of the angle: then the bound is the prior's.
    """
    rng = np.random.default_rng(5)
    angle, slopes = rng.uniform(-3, 3, 5), rng.normal(size=(5, 4, 3))
    slopes[0, :, 2], slopes[2] = 0, 0
    in_robot = np.tile(np.eye(3), (5, 1, 1))
    in_robot[:, 0, 0] = in_robot[:, 1, 1] = np.cos(angle)
    in_robot[:, 1, 0], in_robot[:, 0, 1] = np.sin(angle), -np.sin(angle)
    own = in_robot @ (slopes.swapaxes(1, 2) @ slopes) @ in_robot.swapaxes(1, 2)
    path, precision = np.zeros((15, 15)), np.diag(1 / np.square([0.4, 0.4, 0.2]))
    for k in range(5):
        path[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own[k]
        if k:
            join = np.kron([[1, -1], [-1, 1]], precision)
            path[3 * k - 3 : 3 * k + 3, 3 * k - 3 : 3 * k + 3] += join
    expected = in_robot[4].T @ np.linalg.inv(path)[-3:, -3:] @ in_robot[4]
    turns = np.diff(angle, prepend=angle[0])
    found = cramer_rao.walked((slopes.swapaxes(1, 2) @ slopes)[None], turns[None], 0.4, 0.2)[0]
    np.testing.assert_allclose(np.linalg.inv(found[-1]), expected, rtol=1e-8)
    assert cramer_rao.bound_mm(found[0], BAR) == cramer_rao.FARTHEST_MM


def toy(rng, taxels=6, unknowns=2):
    """A press that is linear in everything: its posterior is Gaussian, and the bound is exact."""
    return cramer_rao.Response(
        mean=50 + rng.normal(size=(1, taxels)),
        by_pose=10 * rng.normal(size=(1, taxels, 3)),
        unknown=3 * rng.normal(size=(1, taxels, unknowns)),
    )


def test_least_squares_reaches_the_bound_of_a_gaussian_toy():
    rng = np.random.default_rng(0)
    model, sensor, pose = toy(rng), SensorOptions(noise=2.0, resolution=0.0), np.zeros((1, 3))
    found = cramer_rao.pose_information(model, pose, sensor)[0]
    covariance = 4 * np.eye(6) + model.unknown[0] @ model.unknown[0].T
    closed = model.by_pose[0].T @ np.linalg.inv(covariance) @ model.by_pose[0]
    np.testing.assert_allclose(found, closed, rtol=1e-9)

    count = 100_000
    # Of an object at 0, without the mean
    readings = 2 * rng.standard_normal((count, 6)) + rng.standard_normal((count, 2)) @ model.unknown[0].T
    estimate = readings @ np.linalg.inv(covariance) @ model.by_pose[0] @ np.linalg.inv(closed)
    distance = np.sqrt(estimate**2 @ np.array([1, 1, BAR.inertia_over_mass]))
    assert distance.mean() == pytest.approx(float(cramer_rao.bound_mm(found, BAR)), rel=0.01)


def test_slopes_of_a_press_are_those_of_its_readings():
    options = tactsim.ScanOptions(
        placement_mm=0.0, placement_rad=0.0, placement_tilt=0.0, press={"wrist_stiffness": None}
    )
    letter, pose = models.letter("E"), np.array([[3.0, -2.0, 0.4]])
    answer = cramer_rao.respond(letter, pose, options)
    moves = cramer_rao.object_slopes(answer.by_pose, pose)[0]
    step = 1e-3
    for axis in range(3):
        move = step * np.eye(3)[axis]
        ahead = tactsim.press(letter, compose(move, pose[0]), options).ideal
        behind = tactsim.press(letter, compose(-move, pose[0]), options).ideal
        np.testing.assert_allclose(moves[:, axis], (ahead - behind) / (2 * step), rtol=0.03, atol=0.3)
    assert answer.unknown.shape == (1, 36, 3)
    assert not answer.unknown.any()


@pytest.mark.long
def test_a_trial_knows_more_with_every_reading_and_no_estimator_knows_more_than_the_bound_says():
    run = tactsim.run(letters="AE", trials=3, readings=20, world="level", estimator="nearest")
    bounds = scan_bounds(run.plan.scan, run.trials)
    assert bounds.shape == run.trials.touch_index.shape
    # Lengths of Gaussians shrink with their covariances.
    assert (np.diff(bounds[:, 2:], axis=1) <= 1e-12).all()
    assert 0.03 < bounds[:, -1].mean() < 0.09
    np.testing.assert_array_equal(scan_bounds(run.plan.scan, run.trials, jobs=2), bounds)
    assert errors(run.trials, run.objects).shape == bounds.shape


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"sensor": {"lag": 0.2}}, "lag"), ({"sensor": {"noise": 0.0, "resolution": 0.0}}, "noise")],
)
def test_a_sensor_that_is_no_reading_plus_noise_has_no_bound(changes, said):
    with pytest.raises(InputError, match=said):
        cramer_rao.noise_variance(tactsim.ScanOptions(**changes).sensor)


def test_a_run_on_a_walk_has_its_bound_beside_it_and_other_motions_have_none(here):
    order = ("--letters", "EO", "--trials", "2", "--readings", "12", "--json")
    words = {"letters": "EO", "trials": 2, "readings": 12, "estimator": "nearest", "bound": True}
    found = json.loads(here("bound", *order, "--slip", "walk_mm=0.5", "--slip", "walk_rad=0.03").stdout)
    assert "lie still" in found["no_bayes"]
    assert found["bound_mm"][-1] > 1.5 * tactsim.run(**words).bound_mm[-1]
    assert found["determined_below_mm"] > 0.5
    refused = here("bound", *order, "--slip", "jump_mm=5")
    assert refused.returncode == 2
    assert "walk" in refused.stderr
    walk = tactsim.run(**words, world="slip")
    assert walk.bound_mm[-1] == pytest.approx(found["bound_mm"][-1])
    for changed, why in (({"slip": {"drift_mm": 0.1}}, "drift"), ({"explore": "blind"}, "on demand")):
        run = tactsim.run(**words, **changed)
        assert run.bounds is None
        assert why in run.about["no_bound"]
