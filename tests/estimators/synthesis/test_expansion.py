"""Readings expanded about states, against least squares and against differences."""

import numpy as np

from tactsim.core import compose, invert
from tactsim.core.forward import Linearised
from tactsim.estimators.synthesis.modes import expand, likeliest_press


def test_the_likeliest_press_is_the_ridge_regression():
    rng = np.random.default_rng(7)
    found = Linearised(rng.normal(size=(3, 8)), np.zeros((3, 3, 8)), rng.normal(size=(3, 2, 8)))
    readings = rng.normal(size=(3, 8))
    likely = likeliest_press(readings, found.mean, found.nuisance, 0.5, 0.0)
    for reading, mean, slopes, off in zip(readings, found.mean, found.nuisance, likely, strict=True):
        rows = np.vstack([slopes.T / 0.5, np.eye(2)])
        target = np.concatenate([(reading - mean) / 0.5, np.zeros(2)])
        np.testing.assert_allclose(off, np.linalg.lstsq(rows, target)[0], rtol=1e-9)


def test_an_expansion_is_that_of_the_log_likelihood():
    rng = np.random.default_rng(3)
    by_pose, nuisance = rng.normal(size=(3, 8)), rng.normal(size=(2, 8))
    readings, number, letter = rng.normal(size=(2, 8)), np.array([1, 0, 1]), np.array([0, 1, 0])
    poses, origin = rng.normal(size=(3, 3)), np.array([1.0, -2.0, 0.4])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])

    def expanded(state):
        """Readings are linear in the sensor's motion along its own axes at `origin`, and each letter's differ."""
        off = compose(state, poses) - origin
        own = np.column_stack([off[:, :2] @ turn, off[:, 2]])

        def predict(one, which):
            shape = (len(which), 1, 1)
            return Linearised(
                3.0 * one + own[which] @ by_pose, np.tile(by_pose, shape), np.tile(nuisance, shape)
            )

        return expand(letter, state, poses, readings, number, predict, 0.5)

    state = np.array([compose(origin, invert(pose)) for pose in poses])
    log_p, gradient, information = expanded(state)
    cov = 0.25 * np.eye(8) + nuisance.T @ nuisance
    rest = readings[number] - 3.0 * letter[:, None]
    np.testing.assert_allclose(
        log_p,
        [-0.5 * (z @ np.linalg.solve(cov, z) + np.linalg.slogdet(2 * np.pi * cov)[1]) for z in rest],
        rtol=1e-9,
    )
    for axis, step in enumerate(1e-5 * np.eye(3)):
        up, down = expanded(state + step), expanded(state - step)
        np.testing.assert_allclose(gradient[:, axis], (up[0] - down[0]) / 2e-5, rtol=1e-4)
    # A motion of the object is one of the sensor, turned and shifted: its determinant is 1.
    np.testing.assert_allclose(
        np.linalg.det(information), np.linalg.det(by_pose @ np.linalg.solve(cov, by_pose.T)), rtol=1e-9
    )
