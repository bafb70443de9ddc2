"""KLD-sampling: its bound against chi^2 and against what it promises, its bins, and the filter that uses it."""

import math

import numpy as np
import pytest
from scipy import stats
from synthetic import draw_trial, fitted_anew

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.filters.kld import OccupiedBins, enough


@pytest.mark.parametrize("bins", [2, 5, 40, 3000])
@pytest.mark.parametrize("certain", [0.9, 0.99])
def test_the_number_is_the_quantile_of_chi_squared(bins, certain):
    exact = stats.chi2.ppf(certain, bins - 1) / (2 * 0.05)
    assert enough(bins, 0.05, stats.norm.ppf(certain)) == pytest.approx(exact, rel=0.02, abs=1)


def test_bins_are_counted_once_each_and_close_around_the_circle():
    rng = np.random.default_rng(0)
    letter, state = rng.integers(0, 3, 4000), rng.uniform(-1, 1, (3, 4000)) * [[6.0], [6.0], [40.0]]
    bins = OccupiedBins(1.5, 0.5)
    for part in np.array_split(np.arange(4000), 7):
        bins.add(letter[part], state[:, part])
    around = math.ceil(2 * math.pi / 0.5)
    angle = np.floor((state[2] / (2 * np.pi)) % 1 * around)
    keys = np.stack([letter, np.floor(state[0] / 1.5), np.floor(state[1] / 1.5), angle])
    assert len(bins) == len(np.unique(keys, axis=1).T)
    before = len(bins)
    bins.add(letter, state + [[0], [0], [2 * np.pi]])
    assert len(bins) - before <= 2  # a turn's rounding


def particles(filter, readings, poses):
    """Take in readings; give how many particles there are after each, and how many bins they lie in."""
    filter.reset(np.random.default_rng(0))
    for reading, pose in zip(readings, poses, strict=True):
        filter.update(reading, pose)
        belief = filter.weighted_states()
        bins = OccupiedBins(1.0, 0.2)
        bins.add(belief.letter, belief.state)
        yield len(belief.letter), len(bins)


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
def test_there_are_as_many_particles_as_their_bins_call_for(name, scan):
    filter = fitted_anew(name, scan, particles=6000, min_particles=40, kld_error=0.3)
    readings, poses, _ = draw_trial(scan, "E", 10, np.random.default_rng(4))
    counts = list(particles(filter, readings, poses))
    assert counts[0][0] == 6000
    wanted = [min(6000, max(40, enough(bins, 0.3, 2.33))) for _, bins in counts[1:]]
    assert [count for count, _ in counts[1:]] == wanted
    assert 40 < min(wanted) < 3000
    total = sum(count for count, _ in counts)
    assert filter.work["likelihood_evaluations"] == total
    assert filter.work["spared_by_kld"] == 10 * 6000 - total


def test_bounds_on_the_number_are_kept(scan):
    readings, poses, _ = draw_trial(scan, "E", 4, np.random.default_rng(4))
    for error, most, least, number in ((10.0, 2000, 700, 700), (1e-6, 900, 500, 900)):
        filter = fitted_anew("particle", scan, particles=most, min_particles=least, kld_error=error)
        assert {count for count, _ in list(particles(filter, readings, poses))[1:]} == {number}
    with pytest.raises(InputError, match="min_particles 500 is above particles 100"):
        estimators.create("particle", particles=100, kld_error=0.05)
