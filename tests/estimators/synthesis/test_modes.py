"""The Gaussians of the synthesis estimator, where the answer is known: linear readings, a dense grid."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tactsim.core import compose
from tactsim.estimators.synthesis.modes import Modes, sensor_motion


def linear(rng, taxels=12):
    """A reading that is linear in the state: z = A x + b + noise of variance 1."""
    return rng.standard_normal((taxels, 3)), rng.standard_normal(taxels), rng.standard_normal(taxels)


def expansion(a, b, z, at):
    """Expand log N(z; A x + b, 1) at states (n, 3)."""
    away = z - at @ a.T - b
    constant = -len(z) / 2 * np.log(2 * np.pi)
    return constant - (away**2).sum(axis=1) / 2, away @ a, np.tile(a.T @ a, (len(at), 1, 1))


def begun(states, sd=1.0):
    n = len(states)
    return Modes.begun(
        np.zeros(n, dtype=np.int64), np.array(states, dtype=float), sd**2 * np.eye(3), np.zeros(n)
    )


NO_FLOOR = np.full(10, -1e9)


def test_a_linear_mode_is_the_exact_posterior_wherever_it_is_expanded():
    rng = np.random.default_rng(0)
    readings = [linear(rng) for _ in range(3)]
    start = np.array([[0.3, -0.2, 0.1]])
    modes = begun(start, sd=0.7)
    for number, (a, b, z) in enumerate(readings):
        at = start + rng.standard_normal((1, 3))
        modes = modes.with_reading(number, at, *expansion(a, b, z, at)).posterior(NO_FLOOR)
    a, b, z = (np.concatenate(parts) for parts in zip(*readings, strict=True))
    precision = np.eye(3) / 0.49 + a.T @ a
    mean = np.linalg.solve(precision, start[0] / 0.49 + a.T @ (z - b))
    np.testing.assert_allclose(modes.mean[0], mean, atol=1e-10)
    np.testing.assert_allclose(modes.cov[0], np.linalg.inv(precision), atol=1e-12)
    evidence = multivariate_normal.logpdf(z, a @ start[0] + b, np.eye(len(z)) + 0.49 * a @ a.T)
    assert modes.log_weight[0] == pytest.approx(evidence, abs=1e-9)
    np.testing.assert_allclose(
        modes.log_p_of_readings()[0],
        [multivariate_normal.logpdf(z, a @ mean + b, np.eye(len(z))) for a, b, z in readings],
    )


def test_a_reading_that_nothing_explains_is_an_outlier_and_moves_nothing():
    rng = np.random.default_rng(2)
    a, b, z = linear(rng)
    states = np.zeros((1, 3))
    without = begun(states).with_reading(0, states, *expansion(a, b, z, states)).posterior(NO_FLOOR)
    floor = np.array([-1e9, -60.0])
    wild = expansion(a, b, z + 100 * rng.standard_normal(len(z)), states)
    both = begun(states).with_reading(0, states, *expansion(a, b, z, states)).with_reading(1, states, *wild)
    both = both.posterior(floor)
    assert both.log_weight[0] == pytest.approx(without.log_weight[0] - 60)
    np.testing.assert_allclose(both.cov, without.cov)


def test_modes_that_are_one_are_merged_and_keep_all_of_the_prior():
    states = np.array([[0, 0, 0], [0.5, 0, 2 * np.pi], [9, 0, 0], [0.1, 0, 0]], dtype=float)
    modes = begun(states)
    modes = Modes(**{**vars(modes), "letter": np.array([0, 0, 0, 1])})
    merged = modes.together(0.7)
    assert sorted(merged.merged.tolist()) == [1, 1, 2]
    one = int(np.flatnonzero(merged.merged == 2)[0])
    np.testing.assert_allclose(merged.prior_mean[one], [0.25, 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.diag(merged.prior_cov[one]), [1 + 0.0625, 1, 1])
    assert merged.log_prior[one] == pytest.approx(np.log(2))


def test_the_sensor_moves_as_the_state_does():
    rng = np.random.default_rng(5)
    state, sensor_in_robot = rng.standard_normal((4, 3)), 5 * rng.standard_normal((4, 3))
    motion = sensor_motion(state, sensor_in_robot)
    before = compose(state, sensor_in_robot)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        moved = (compose(state + step, sensor_in_robot) - before) / 1e-6
        cos, sin = np.cos(before[:, 2]), np.sin(before[:, 2])
        own = np.stack(
            [cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0], moved[:, 2]],
            axis=1,
        )
        np.testing.assert_allclose(motion[:, :, axis], own, atol=1e-5)
