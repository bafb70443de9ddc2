"""The expanded likelihood against SciPy's density, and against its own differences."""

import numpy as np
from scipy.stats import multivariate_normal

from tactsim.estimators.likelihoods.gaussian_kernels import log_gaussian


def expanded(reading, mean, by_pose, nuisance, noise):
    n = len(mean)
    result = np.empty(n), np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
    log_gaussian(reading, np.arange(n) % len(reading), mean, by_pose, nuisance, noise, *result)
    return result


def test_it_is_the_density_and_its_derivatives():
    rng = np.random.default_rng(0)
    n, taxels = 6, 9
    for q in (0, 1, 5):
        reading, mean = 5 * rng.standard_normal((2, taxels)), 5 * rng.standard_normal((n, taxels))
        by_pose, nuisance = rng.standard_normal((n, 3, taxels)), rng.standard_normal((n, q, taxels))
        log_p, misfit, gradient, information = expanded(reading, mean, by_pose, nuisance, 2.0)
        for i in range(n):
            covariance = 4 * np.eye(taxels) + nuisance[i].T @ nuisance[i]
            away = reading[i % 2] - mean[i]
            inverse = np.linalg.inv(covariance)
            np.testing.assert_allclose(
                log_p[i], multivariate_normal.logpdf(reading[i % 2], mean[i], covariance), rtol=1e-10
            )
            np.testing.assert_allclose(misfit[i], away @ inverse @ away, rtol=1e-10)
            np.testing.assert_allclose(gradient[i], by_pose[i] @ inverse @ away, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(information[i], by_pose[i] @ inverse @ by_pose[i].T, rtol=1e-9)
