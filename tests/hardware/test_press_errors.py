"""The linear mixed model against samples of it, and against its density written out."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tactsim.hardware.taxel_fit import press_errors

ANY = (-np.inf, np.inf)
GROUPS = [(0, 1), (2,)]


def sample(rng, presses=300, taxels=20, s=(0.4, 2.0), mean=(0.3, -0.2, 1.0), sd=(0.5, 0.5, 2.0), noise=0.7):
    slopes = rng.standard_normal((presses, taxels, 3))
    shared = rng.standard_normal((presses, taxels, len(s))) + slopes[..., :1]
    errors = rng.standard_normal((presses, 3)) * sd + mean
    readings = np.einsum("nti,ni->nt", slopes, errors) + shared @ np.array(s)
    return readings + noise * rng.standard_normal(readings.shape), slopes, shared, errors


def test_what_a_sample_was_made_of_is_found():
    readings, slopes, shared, errors = sample(np.random.default_rng(1))
    found = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, ANY)
    assert found.shared[0] == pytest.approx(0.4, abs=3 * found.shared_error[0])
    assert found.shared[1] == pytest.approx(2.0, abs=3 * found.shared_error[1])
    for low, sd, high in zip(found.sd_low, (0.5, 0.5, 2.0), found.sd_high, strict=True):
        assert low < sd < high
    assert found.mean == pytest.approx([0.3, -0.2, 1.0], abs=0.35)
    assert found.sd == pytest.approx([0.5, 0.5, 2.0], rel=0.1)
    assert np.sqrt(((found.errors - errors) ** 2).mean()) < 0.25


@pytest.mark.long
def test_the_stated_error_of_a_shared_number_is_that_of_repeats():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(60):
        readings, slopes, shared, _ = sample(rng, presses=40, taxels=8)
        found.append(press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, ANY))
    scores = [(one.shared[0] - 0.4) / one.shared_error[0] for one in found]
    assert abs(np.mean(scores)) < 0.45
    assert 0.7 < np.std(scores) < 1.4


def test_likelihoods_differ_as_the_densities_do():
    readings, slopes, shared, _ = sample(np.random.default_rng(3), presses=30, taxels=6, s=(0.0,))

    def density(found, count):
        total = 0.0
        for y, j in zip(readings, slopes[..., :count], strict=True):
            covariance = j @ np.diag(found.sd**2) @ j.T + 0.49 * np.eye(6)
            total += multivariate_normal(j @ found.mean, covariance).logpdf(y)
        return total

    whole = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, np.zeros_like(shared), ANY)
    less = press_errors(readings, slopes[..., :2], 0.49, np.ones(2), [(0, 1)], np.zeros_like(shared), ANY)
    assert whole.log_likelihood - less.log_likelihood == pytest.approx(
        density(whole, 3) - density(less, 2), abs=1e-6
    )


def test_a_bound_holds_and_the_other_shared_number_makes_up_for_it():
    readings, slopes, shared, _ = sample(np.random.default_rng(4))
    shared[..., 1] += shared[..., 0]
    found = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, (0.9, 1.0))
    assert found.shared[0] == 0.9


def test_without_any_effect_errors_stay_at_nothing():
    rng = np.random.default_rng(5)
    readings = rng.standard_normal((50, 10))
    found = press_errors(readings, np.zeros((50, 10, 3)), 1.0, np.ones(3), GROUPS, np.zeros((50, 10, 1)), ANY)
    assert found.errors == pytest.approx(np.zeros((50, 3)))
    assert found.shared[0] == 0
    assert np.isinf(found.shared_error[0])
