"""Random numbers of compiled code: against xoshiro256++ in whole numbers, and against what is known of normal ones."""

import math

import numpy as np
import pytest
from scipy import stats

from tactsim.estimators.filters.xoshiro import LANES, exponentials, fill_words, normals, seeded, spacings


def drawn(count, seed=0):
    words, state = np.empty(count, dtype=np.uint64), seeded(np.random.default_rng(seed))
    fill_words(state, words)
    return words


def xoshiro(state, count):
    """Xoshiro256++ as published (Blackman and Vigna 2021), in Python's whole numbers: one lane."""
    whole = 2**64 - 1

    def turned(x, k):
        return (x << k | x >> (64 - k)) & whole

    s, words = [int(one) for one in state], []
    for _ in range(count):
        words.append((turned(s[0] + s[3] & whole, 23) + s[0]) & whole)
        t = s[1] << 17 & whole
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = turned(s[3], 45)
    return words


def test_every_lane_is_xoshiro256_plus_plus():
    state = seeded(np.random.default_rng(3))
    lanes, words = state.reshape(4, LANES).T.copy(), np.empty(5 * LANES, dtype=np.uint64)
    fill_words(state, words[: 2 * LANES])
    fill_words(state, words[2 * LANES :])  # goes on where it was
    for k in range(LANES):
        assert words[k::LANES].tolist() == xoshiro(lanes[k], 5)


def test_the_published_first_numbers():
    # Of the state 1, 2, 3, 4, as in the reference implementation's tests.
    state, words = np.repeat(np.arange(1, 5, dtype=np.uint64), LANES), np.empty(3 * LANES, dtype=np.uint64)
    fill_words(state, words)
    assert words[::LANES].tolist() == [41943041, 58720359, 3588806011781223]


def test_the_generator_of_numpy_decides_all():
    assert drawn(64).tolist() == drawn(64).tolist()
    assert drawn(64).tolist() != drawn(64, seed=1).tolist()


def test_exponentials_and_normals_are_what_numpy_makes_of_the_same_words():
    words = drawn(64 * LANES)
    words[:3] = 0, 2**64 - 1, 2**52  # u of 1, and the smallest
    uniform = 1 - (words >> np.uint64(12)).astype(float) * 2.0**-52
    out = np.empty(len(words))
    exponentials(words, out)
    assert out == pytest.approx(-np.log(uniform), rel=1e-13, abs=1e-15)

    half = len(words) // 2
    turn = ((words[half:] >> np.uint64(12)).astype(float) * 2.0**-52 - 0.5) * math.pi / 2
    sign = np.where(words[half:] & np.uint64(2), -1.0, 1.0)
    x, y = np.cos(turn) * sign, np.sin(turn)
    quarter = (words[half:] & np.uint64(1)) > 0
    radius = np.sqrt(-2 * np.log(uniform[:half]))
    expected = np.concatenate([radius * np.where(quarter, y, x), radius * np.where(quarter, x, y)])
    normals(words, out)
    assert out == pytest.approx(expected, rel=1e-12, abs=1e-14)


@pytest.fixture(scope="module")
def many():
    words = drawn(1_000_000 // LANES * LANES, seed=8)
    out = np.empty(len(words))
    normals(words, out)
    return out


def test_moments_and_tails_are_those_of_normal_numbers(many):
    # Five standard errors each.
    off = 5 / math.sqrt(len(many))
    assert abs(many.mean()) < off
    assert abs((many**2).mean() - 1) < off * math.sqrt(2)
    assert abs((many**3).mean()) < off * math.sqrt(15)
    assert abs((many**4).mean() - 3) < off * math.sqrt(96)
    for edge in (1.0, 2.0, 3.0, 4.0):
        beyond = 2 * stats.norm.sf(edge)
        assert (np.abs(many) > edge).mean() == pytest.approx(beyond, abs=off * math.sqrt(beyond))
    assert stats.kstest(many[::5], "norm").pvalue > 1e-4


def test_numbers_of_lanes_pairs_and_neighbours_are_independent(many):
    lanes, half = many.reshape(-1, LANES), len(many) // 2
    alike = np.corrcoef(lanes.T) - np.eye(LANES)
    assert np.abs(alike).max() < 6 / math.sqrt(len(lanes))
    assert np.abs(np.corrcoef((lanes**2).T) - np.eye(LANES)).max() < 6 / math.sqrt(len(lanes))
    for later in (1, LANES, half):
        for power in (1, 2):
            r = np.corrcoef(many[:-later] ** power, many[later:] ** power)[0, 1]
            assert abs(r) < 5 / math.sqrt(len(many) - later)


def test_spacings_are_exponential_numbers_and_enough():
    state = seeded(np.random.default_rng(1))
    for count in (1, LANES, 1000):
        assert count <= len(spacings(state, count)) < count + LANES
    values = spacings(state, 20_000)
    assert stats.kstest(values, "expon").pvalue > 1e-4
