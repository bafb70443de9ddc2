"""Cosine, sine, exponential and logarithm as series, of which compilers make vectors, as not of math.cos (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, types, uint64

from tactsim.core.compiling import compiled
from tactsim.estimators.field.bits import bits_of, real_of

# Added to a number and taken away again, this rounds it; the sum's last bits are then the whole number.
_ROUNDS = 6755399441055744.0  # 1.5 * 2^52
# A quarter of a turn in two parts. The first ends in 22 zeros, so that up to four million times it are exact.
_QUARTER, _QUARTER_REST = 1.5707963267341256, 6.077100506506192e-11
# The logarithm of 2 likewise.
_LN_2, _LN_2_REST = 0.6931471803691238, 1.9082149292705877e-10


@compiled(float64(float64), called_from_python=False, ordered=False)
def small_sine(angle: float) -> float:
    """Give the sine of an angle at most an eighth of a turn either side of 0, right to 1e-15: Taylor's series."""
    z = angle * angle
    series = -1 / 1307674368000
    series = series * z + 1 / 6227020800
    series = series * z - 1 / 39916800
    series = series * z + 1 / 362880
    series = series * z - 1 / 5040
    series = series * z + 1 / 120
    series = series * z - 1 / 6
    return series * z * angle + angle


@compiled(float64(float64), called_from_python=False, ordered=False)
def small_cosine(angle: float) -> float:
    """Give the cosine of an angle at most an eighth of a turn either side of 0, right to 1e-15: Taylor's series."""
    z = angle * angle
    series = -1 / 87178291200
    series = series * z + 1 / 479001600
    series = series * z - 1 / 3628800
    series = series * z + 1 / 40320
    series = series * z - 1 / 720
    series = series * z + 1 / 24
    series = series * z - 1 / 2
    return series * z + 1.0


@compiled(types.UniTuple(float64, 2)(float64), called_from_python=False, ordered=False)
def cos_sin(angle: float) -> tuple[float, float]:
    """Give the cosine and sine of an angle of at most a million turns, right to 1e-15.

    Those of an angle that is not finite are NaN.
    """
    shifted = angle * (2 / math.pi) + _ROUNDS
    quarters = shifted - _ROUNDS
    rest = angle - quarters * _QUARTER - quarters * _QUARTER_REST
    near_0, near_1, turned = small_sine(rest), small_cosine(rest), bits_of(shifted)
    odd = (turned & uint64(1)) != 0  # of the whole number of quarters: then cosine and sine change places
    cosine, sine = (near_0, near_1) if odd else (near_1, near_0)
    return (
        real_of(bits_of(cosine) ^ (((turned + uint64(1)) & uint64(2)) << uint64(62))),
        real_of(bits_of(sine) ^ ((turned & uint64(2)) << uint64(62))),
    )


@compiled(float64(float64), called_from_python=False, ordered=False)
def small_exp(exponent: float) -> float:
    """Give e to a power from -700 to 700, right to 1e-15 of it: a power of 2, and Taylor's series of the rest."""
    shifted = exponent * (1 / math.log(2)) + _ROUNDS
    twos = shifted - _ROUNDS
    rest = exponent - twos * _LN_2 - twos * _LN_2_REST
    series = 1 / 6227020800
    series = series * rest + 1 / 479001600
    series = series * rest + 1 / 39916800
    series = series * rest + 1 / 3628800
    series = series * rest + 1 / 362880
    series = series * rest + 1 / 40320
    series = series * rest + 1 / 5040
    series = series * rest + 1 / 720
    series = series * rest + 1 / 120
    series = series * rest + 1 / 24
    series = series * rest + 1 / 6
    series = series * rest + 1 / 2
    series = series * rest + 1.0
    series = series * rest + 1.0
    # The exponent of a number near 1 is 1023, in the bits from number 52 on.
    return series * real_of((bits_of(shifted) + uint64(1023)) << uint64(52))


@compiled(float64(float64), called_from_python=False, ordered=False)
def logarithm(number: float) -> float:
    """Give the natural logarithm of a normal number above 0, right to 1e-15: of 2 artanh s the series to s^17."""
    bits: np.uint64 = bits_of(number)
    # The number is m * 2^power with m in [sqrt(1/2), sqrt(2)); the power is turned into a float by its place.
    power = uint64(int64(bits - uint64(0x3FE6A09E667F3BCD)) >> int64(52))
    m = real_of(bits - (power << uint64(52)))
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    series = 2 / 17
    series = series * z + 2 / 15
    series = series * z + 2 / 13
    series = series * z + 2 / 11
    series = series * z + 2 / 9
    series = series * z + 2 / 7
    series = series * z + 2 / 5
    series = series * z + 2 / 3
    series = series * z + 2.0
    return (real_of(power + bits_of(_ROUNDS)) - _ROUNDS) * math.log(2) + s * series
