"""Sixteen xoshiro256++ generators whose state stays in registers (for compiled code)."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from tactsim.estimators.field.vectors import Registers, address

LANES = 16  # generators: two vectors of eight, so that one's latency is the other's time
_WORD = ir.IntType(64)
_WORDS = ir.VectorType(_WORD, LANES)

_KIND = Registers(f"Generators{LANES}", _WORDS)


@intrinsic
def load_words(typing: Any, array: Any, index: Any) -> Any:
    """Read array[index : index + LANES] of a contiguous uint64 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index = args
        return builder.load(address(context, builder, signature.args[0], array, index, _WORDS), align=8)

    return _KIND(array, types.uint64), generate


@intrinsic
def store_words(typing: Any, array: Any, index: Any, words: Any) -> Any:
    """Write array[index : index + LANES] of a contiguous uint64 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index, words = args
        builder.store(words, address(context, builder, signature.args[0], array, index, _WORDS), align=8)
        return context.get_dummy_value()

    return types.void(array, types.uint64, _KIND), generate


@intrinsic
def next_words(typing: Any, s0: Any, s1: Any, s2: Any, s3: Any) -> Any:
    """Give the next word of every generator, and its new state, five vectors (Blackman and Vigna 2021)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def count(bits: int) -> Any:
            return ir.Constant(_WORDS, [bits] * LANES)

        def turned(words: Any, bits: int) -> Any:
            up, down = builder.shl(words, count(bits)), builder.lshr(words, count(64 - bits))
            return builder.or_(up, down)

        s0, s1, s2, s3 = args
        words = builder.add(turned(builder.add(s0, s3), 23), s0)
        shifted = builder.shl(s1, count(17))
        s2, s3 = builder.xor(s2, s0), builder.xor(s3, s1)
        s1, s0 = builder.xor(s1, s2), builder.xor(s0, s3)
        five = [words, s0, s1, builder.xor(s2, shifted), turned(s3, 45)]
        return context.make_tuple(builder, signature.return_type, five)

    return types.UniTuple(_KIND, 5)(_KIND, _KIND, _KIND, _KIND), generate
