"""Synthesis of an object that moves, on readings whose forward model is known."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from synthetic import BarForward, follow, make_scan, placement_error, pressures, square_pad

from tactsim.bench.config import Slip
from tactsim.core import compose, invert, transform
from tactsim.core.forward import Linearised
from tactsim.estimators import create


class Misplaced(BarForward):
    """Presses that are misplaced by 0.1 mm along their first axis."""

    def linearised(self, letter, sensor_in_object, off=None, load=None):
        if off is not None:
            sensor_in_object = compose(sensor_in_object, off * [0.1, 0.0, 0.0])
        found = super().linearised(letter, sensor_in_object, load=load)
        nuisance = np.concatenate([0.1 * found.by_pose[:, :1], found.nuisance], axis=1)
        return Linearised(found.mean, found.by_pose, nuisance)


@cache
def fitted(motion):
    estimator = create("synthesis", spacing=2.5, angles=8, modes=100, motion=motion)
    estimator.bring(Misplaced("EL", square_pad()))
    estimator.fit(make_scan("EL"))
    return estimator


def sequence(count, slip, seed=0):
    """Press the letter E, which moves: readings, sensor_in_robot, true robot_in_object at each touch."""
    rng = np.random.default_rng(seed)
    first = np.array([3.0, -2.0, 0.7])
    true = slip.poses(first, count, np.random.default_rng(seed + 1))
    stated = rng.uniform([-8, -8, -np.pi], [8, 8, np.pi], (count, 3))
    readings = 30 * pressures("E", transform(stated, square_pad()))
    return readings + 2 * rng.standard_normal(readings.shape), compose(invert(true), stated), true


def away(estimate, true):
    return placement_error(estimate.robot_in_object, true, 1, 64.0)


@pytest.mark.parametrize("motion", ["auto", "0.6,0.03"])
def test_a_walk_is_followed(motion):
    readings, poses, true = sequence(10, Slip(walk_mm=0.6, walk_rad=0.03))
    found = follow(fitted(motion), readings, poses)
    lost = away(follow(fitted("off"), readings, poses)[-1], true[-1])
    assert np.median([away(one, at) for one, at in zip(found[-4:], true[-4:], strict=True)]) < 0.4 < lost
    assert found[-1].samples.weights.sum() == pytest.approx(1)


def test_states_are_weighed_by_the_whole_covariance_of_a_press():
    """The density of a reading against SciPy's, and the floor below which it is an outlier."""
    estimator = fitted("auto")
    readings, poses, true = sequence(3, Slip())
    follow(estimator, readings, poses)
    states = true[2] + np.array([[0.0, 0, 0], [0.1, -0.1, 0.01]])
    at = estimator.pad.linearised("E", compose(states, poses[2]))
    expected = [
        multivariate_normal(mean, estimator.noise**2 * np.eye(36) + nuisance.T @ nuisance).logpdf(readings[2])
        for mean, nuisance in zip(at.mean, at.nuisance, strict=True)
    ]
    np.testing.assert_allclose(estimator.log_p(0, states.T, 2), expected, rtol=1e-9)
    far = estimator.log_p(0, states.T + np.array([[12.0], [9.0], [0]]), 2)
    assert far[0] == far[1] > -2000


@pytest.mark.long
def test_what_a_reading_adds_to_the_evidence_is_its_mean_likelihood_in_the_belief():
    """The growth of the modes' evidence against a sum over states drawn from the belief before the reading."""
    readings, poses, _ = sequence(6, Slip())
    estimator = fitted("auto")
    follow(estimator, readings[:5], poses[:5])
    belief = estimator.own_states()
    estimator.take(readings[5], poses[5])
    grown = estimator.foretold(belief)
    log_p = np.log(belief.weights.normalised) + [
        estimator.log_p(letter, state[:, None], 5)[0]
        for letter, state in zip(belief.letter, belief.state.T, strict=True)
    ]
    assert grown == pytest.approx(np.logaddexp.reduce(log_p), abs=0.2)


def test_until_the_object_is_touched_it_is_taken_to_lie_still():
    readings, poses, true = sequence(6, Slip())
    beside = compose(invert(true[0]), np.array([[40.0, 0, 0], [0, 45.0, 1.0]]))
    noise = 2 * np.random.default_rng(5).standard_normal((2, 36))
    for motion in ("auto", "0.6,0.03"):
        found = follow(fitted(motion), [*noise, *readings], [*beside, *poses])
        assert min(found[1].probabilities.values()) > 0.1
        assert (found[-1].label, away(found[-1], true[-1]) < 0.6) == ("E", True)
