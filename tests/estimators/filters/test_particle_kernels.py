"""One step of a particle filter, against plain NumPy with the same random numbers."""

import numpy as np
import pytest

from tactsim.estimators.filters.multinomial import draw
from tactsim.estimators.filters.particle_kernels import move, sum_by_letter
from tactsim.estimators.filters.xoshiro import fill_words, normals, seeded, spacings


def numpys_step(letter, state, weight, noise, reach, random, count):
    """Resample and move as one would with NumPy: sorted uniform numbers, searchsorted, fancy indexing, clip."""
    gaps = spacings(random, count + 1)[: count + 1]
    uniform = np.cumsum(gaps)[:-1] / gaps.sum()
    chosen = np.searchsorted(np.cumsum(weight), uniform * weight.sum(), side="right")
    normal, words = np.empty((3, -(-count // 128), 128)), np.empty(384, dtype=np.uint64)
    for batch in range(normal.shape[1]):
        three = np.empty(384)
        fill_words(random, words)
        normals(words, three)
        normal[:, batch] = three.reshape(3, 128)
    moved = state[:, chosen] + noise[:, None] * normal.reshape(3, -1)[:, :count]
    moved[:2] = np.clip(moved[:2], -reach, reach)
    return letter[chosen], moved


@pytest.mark.parametrize("count", [1, 127, 128, 1000])
def test_compiled_steps_give_the_particles_of_plain_numpy(count):
    rng = np.random.default_rng(count)
    letter, weight = rng.integers(0, 5, 700), 10.0 ** -rng.uniform(0, 12, 700)
    state, noise = rng.uniform(-4, 4, (3, 700)), np.array([1.0, 0.5, 0.1])
    random = seeded(rng)
    theirs = numpys_step(letter, state, weight, noise, 4.0, random.copy(), count)
    chosen, ours = np.empty(count, dtype=np.int64), (np.empty(count, dtype=np.int64), np.empty((3, count)))
    draw(chosen, weight, spacings(random, count + 1))
    move(*ours, letter, state, chosen, noise, 4.0, random)
    assert ours[0].tolist() == theirs[0].tolist()
    assert ours[1] == pytest.approx(theirs[1], abs=1e-12)
    assert np.abs(ours[1][:2]).max() <= 4


def test_weights_are_summed_by_letter_in_any_order():
    rng = np.random.default_rng(0)
    for letter in (np.zeros(9, dtype=np.int64), rng.integers(0, 4, 500), np.sort(rng.integers(0, 4, 500))):
        weight, mass = rng.random(len(letter)), np.ones(5)
        sum_by_letter(mass, weight, letter)
        assert mass == pytest.approx(np.bincount(letter, weight, minlength=5))
