"""Random numbers inside compiled code: sixteen xoshiro256++ generators side by side, seeded by NumPy's (compiled)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types, uint64, void
from numpy.typing import NDArray

from tactsim.core.compiling import REALS, Reals, compiled
from tactsim.estimators.field.bits import bits_of, real_of
from tactsim.estimators.field.series import logarithm, small_cosine, small_sine
from tactsim.estimators.filters.word_vectors import LANES, load_words, next_words, store_words

Words = NDArray[np.uint64]
WORDS = types.uint64[::1]


def seeded(rng: np.random.Generator) -> Words:
    """Draw the state of all lanes (4 * LANES,): 256 random bits for each, so that no two meet in practice."""
    return rng.integers(0, 2**64, size=4 * LANES, dtype=np.uint64)


@compiled(void(WORDS, WORDS))
def fill_words(state: Words, words: Words) -> None:
    """Draw 64 random bits for each of words, whose number is a multiple of LANES: xoshiro256++ (Blackman, Vigna 2021).

    state: as from `seeded`, is moved on. Word i comes from lane i % LANES.
    """
    s0: Any = load_words(state, 0)  # type: ignore[call-arg]
    s1: Any = load_words(state, LANES)
    s2: Any = load_words(state, 2 * LANES)
    s3: Any = load_words(state, 3 * LANES)
    for i in range(uint64(len(words) // LANES)):
        drawn, s0, s1, s2, s3 = next_words(s0, s1, s2, s3)
        store_words(words, i * uint64(LANES), drawn)
    store_words(state, 0, s0)
    store_words(state, LANES, s1)
    store_words(state, 2 * LANES, s2)
    store_words(state, 3 * LANES, s3)


@compiled(void(WORDS, REALS), ordered=False)
def exponentials(words: Words, out: Reals) -> None:
    """Turn random words into exponential numbers of mean 1: -ln u, with u in (0, 1] from a word's upper 52 bits.

    words: as many as out, or more.
    """
    for i in range(uint64(len(out))):
        uniform = 2.0 - real_of((words[i] >> uint64(12)) | uint64(0x3FF0000000000000))
        out[i] = -logarithm(uniform)


@compiled(void(WORDS, REALS), ordered=False)
def normals(words: Words, out: Reals) -> None:
    """Turn random words into normal numbers of mean 0 and deviation 1 (Box and Muller 1958), at most 8.5 in size.

    words: as many as out, an even number. A pair is out[i] and out[i + half]: a radius from word i, and from word
    i + half an angle within an eighth of a turn either side of 0, with two more bits for the quarter.
    """
    half = uint64(len(out) // 2)
    exponentials(words, out[: len(out) // 2])
    for i in range(half):
        radius, bits = math.sqrt(2.0 * out[i]), words[i + half]
        angle = (real_of((bits >> uint64(12)) | uint64(0x3FF0000000000000)) - 1.5) * (math.pi / 2)
        sine = small_sine(angle)
        cosine = real_of(bits_of(small_cosine(angle)) ^ ((bits & uint64(2)) << uint64(62)))
        quarter = (bits & uint64(1)) != 0
        out[i] = radius * (sine if quarter else cosine)
        out[i + half] = radius * (cosine if quarter else sine)


def spacings(state: Words, count: int) -> Reals:
    """Draw exponential numbers of mean 1, `count` or a few more, as `multinomial.draw` takes them."""
    words = np.empty(-(-count // LANES) * LANES, dtype=np.uint64)
    fill_words(state, words)
    out = np.empty(len(words))
    exponentials(words, out)
    return out
