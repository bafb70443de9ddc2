"""The inner loops of the particle filter, against plain NumPy with the same random numbers."""

import numpy as np
import pytest

from tactsim.estimators.filters.particle_kernels import draw, move


def test_spacings_are_sorted_uniform_numbers():
    # Drawn from equal weights, one number in each n-th part of [0, 1) with spacings all alike.
    chosen = np.empty(9, dtype=np.int64)
    draw(chosen, np.ones(10), np.ones(10))  # the numbers are 0.1, 0.2, ..., 0.9
    assert chosen.tolist() in ([1, 2, 3, 4, 5, 6, 7, 8, 9], [0, 1, 2, 3, 4, 5, 6, 7, 8])
    draw(chosen, np.ones(10), np.append(np.full(9, 1.0), 10.0))  # up to 9/19
    assert chosen.tolist() == [0, 1, 1, 2, 2, 3, 3, 4, 4]


@pytest.mark.parametrize("weights", [1, 2, 15, 1000])
@pytest.mark.parametrize("draws", [1, 7, 16, 40, 1500])
def test_draws_are_those_of_a_search_in_running_sums(weights, draws):
    rng = np.random.default_rng(weights + draws)
    for kind in range(4):
        weight, spacing = rng.random(weights) ** 20, rng.standard_exponential(draws + 1)
        if kind == 1:  # sums that are equal, which no rounding hides
            weight, spacing = np.full(weights, 2.0**-3), np.full(draws + 1, 2.0**-3)
        elif kind == 2:  # nothing at either end
            weight = np.where(np.abs(np.arange(weights) - weights // 2) < 3, weight, 0.0)
        elif kind == 3:  # all in one, now and then the last
            weight = np.where(np.arange(weights) == rng.integers(max(0, weights - 2), weights), 1.0, 0.0)
        chosen = np.empty(draws, dtype=np.int64)
        draw(chosen, weight, spacing)
        filled, reached = np.cumsum(weight), np.cumsum(spacing * (weight.sum() / spacing.sum()))
        wanted = np.searchsorted(filled, reached[:-1], side="right")
        # The sums are rounded differently, which may decide where two are equal.
        rounded = np.isclose(filled[:, None], reached[:-1], rtol=1e-12).any(axis=0)
        assert chosen[~rounded].tolist() == np.minimum(wanted, weights - 1)[~rounded].tolist()


@pytest.mark.parametrize("count", [1, 127, 1000])
def test_particles_move_as_in_plain_numpy(count):
    rng = np.random.default_rng(count)
    before, noise = rng.uniform(-4, 4, (3, 700)), np.array([1.0, 0.5, 0.1])
    chosen, normal = rng.integers(700, size=count), rng.standard_normal((3, count))
    state = np.empty((3, count))
    move(state, before, chosen, normal, noise, 4.0)
    wanted = before[:, chosen] + noise[:, None] * normal
    wanted[:2] = np.clip(wanted[:2], -4, 4)
    assert state == pytest.approx(wanted, abs=1e-12)
