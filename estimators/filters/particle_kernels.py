"""The command update of a particle filter, and the sum of its weights, each in one pass (compiled)."""

from __future__ import annotations

import numpy as np
from numba import float64, uint64, void

from tactsim.core.compiling import INTS, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.filters.xoshiro import WORDS, Words, fill_words, normals

_BATCH = 128  # particles, whose random numbers stay in the cache; three words each are a multiple of 2 LANES


@compiled(void(INTS, REALS_2D, INTS, REALS_2D, INTS, REALS, float64, WORDS), ordered=False)
def move(
    letter: Ints, state: Reals, from_letter: Ints, from_state: Reals, chosen: Ints, noise: Reals, reach: float,
    random: Words,
) -> None:  # fmt: skip
    """Copy the chosen particles and corrupt them with noise (command update); x and y stay within reach.

    letter: (particles,), state: (3, particles) T_R^O are overwritten. chosen: (particles,) indices into from_letter
    and from_state. noise: (3,) standard deviations, mm, mm, rad. random: the state of `xoshiro`. Of every 128
    particles the first 128 normal numbers are for x, the next for y, the last for the angle.
    """
    words, normal = np.empty(3 * _BATCH, dtype=np.uint64), np.empty(3 * _BATCH)
    sigma_x, sigma_y, sigma_angle = noise[0], noise[1], noise[2]
    from_x, from_y, from_angle = from_state[0], from_state[1], from_state[2]
    to_x, to_y, to_angle = state[0], state[1], state[2]
    for begin in range(uint64(0), uint64(len(letter)), uint64(_BATCH)):
        fill_words(random, words)
        normals(words, normal)
        for k in range(min(uint64(_BATCH), uint64(len(letter)) - begin)):
            i = begin + k
            one = uint64(chosen[i])
            letter[i] = from_letter[one]
            x = from_x[one] + sigma_x * normal[k]
            y = from_y[one] + sigma_y * normal[k + uint64(_BATCH)]
            to_x[i] = min(max(x, -reach), reach)
            to_y[i] = min(max(y, -reach), reach)
            to_angle[i] = from_angle[one] + sigma_angle * normal[k + uint64(2 * _BATCH)]


@compiled(void(REALS, REALS, INTS))
def sum_by_letter(mass: Reals, weight: Reals, letter: Ints) -> None:
    """Sum the weights of each letter (eq. 9): mass (letters,) is overwritten. weight, letter: (particles,).

    It is quick where particles stand in runs of one letter: a sum in memory for each particle takes thrice as long.
    """
    mass[:] = 0
    current, total = letter[0], 0.0
    for i in range(len(letter)):
        if letter[i] != current:
            mass[current] += total
            current, total = letter[i], 0.0
        total += weight[i]
    mass[current] += total
