"""Cosine, sine, exponential and logarithm as series, against those of NumPy; and that loops of them are no others."""

import numpy as np
import pytest
from numba import njit

from tactsim.estimators.field.series import cos_sin, logarithm, small_cosine, small_exp, small_sine


@njit
def turned(angle, cosine, sine):
    for k in range(len(angle)):
        cosine[k], sine[k] = cos_sin(angle[k])


@njit
def each(exponent, power, angle, cosine, sine):
    for k in range(len(exponent)):
        power[k], cosine[k], sine[k] = small_exp(exponent[k]), small_cosine(angle[k]), small_sine(angle[k])


@njit
def logarithms(number, log):
    for k in range(len(number)):
        log[k] = logarithm(number[k])


def cosine_and_sine(angle):
    found = np.empty((2, len(angle)))
    turned(angle, *found)
    return found


# Beyond a few turns the error is that of the angle itself, half its last place.
@pytest.mark.parametrize("most", [0.1, np.pi, 100.0, 1e6])
def test_cosine_and_sine_are_those_of_numpy(most):
    quarters = np.arange(-40, 41) * np.pi / 4
    angle = np.concatenate(
        [np.random.default_rng(0).uniform(-most, most, 20_000), quarters, [0.0, most, -most]]
    )
    assert np.abs(cosine_and_sine(angle) - [np.cos(angle), np.sin(angle)]).max() < 3e-15


def test_of_what_is_not_finite_they_are_nan():
    assert np.isnan(cosine_and_sine(np.array([np.nan, np.inf, -np.inf]))).all()


def test_one_by_one_they_are_the_same_bits_as_in_a_loop():
    angle = np.random.default_rng(1).uniform(-7, 7, 1_003)  # no whole number of vectors
    one_by_one = np.column_stack([cosine_and_sine(angle[k : k + 1]) for k in range(len(angle))])
    assert np.array_equal(cosine_and_sine(angle), one_by_one)


def test_powers_and_small_angles_are_those_of_numpy():
    exponent = np.concatenate([np.random.default_rng(0).uniform(-700, 700, 20_000), [0.0, -700.0, 700.0]])
    angle = np.linspace(-np.pi / 4, np.pi / 4, len(exponent))
    power, cosine, sine = np.empty((3, len(exponent)))
    each(exponent, power, angle, cosine, sine)
    assert np.abs(power / np.exp(exponent) - 1).max() < 1e-15
    assert power[20_000] == 1.0
    assert np.abs([cosine - np.cos(angle), sine - np.sin(angle)]).max() < 3e-15


def test_logarithms_are_those_of_numpy():
    number = np.concatenate([np.exp(np.random.default_rng(0).uniform(-700, 700, 20_000)), [1.0, 2.0, 0.5]])
    log = np.empty_like(number)
    logarithms(number, log)
    assert np.allclose(log, np.log(number), rtol=1e-15, atol=1e-15)
    assert log[20_000] == 0.0
