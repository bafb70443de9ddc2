"""Vectors of 16 numbers for compiled code: float32, bytes, and whole numbers of 16 bits.

Numba has none, and finds too few by itself in loops over short slices.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import float32, types, uint8, uint16
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

TALL, LANES = 4, 16  # a tile: rows, and bins of a row
LINE = 64  # bytes that a cache holds together
DIVISOR = 64  # of the products that `add_products` adds; a power of 2
# A vector of float32, and one of whole numbers of 32 bits.
REALS, WHOLES = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)


class Registers(types.Type):
    """What stays in registers, as one LLVM type: `held`."""

    def __init__(self, name: str, held: ir.Type) -> None:
        self.held = held
        super().__init__(name=name)


@register_model(Registers)
class _RegistersModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.held)


_BYTES = ir.VectorType(ir.IntType(8), LANES)
VECTOR = Registers(f"Lanes{LANES}", REALS)  # of float32, as compiled functions take it
_WORDS = Registers(f"Words{LANES}", ir.VectorType(ir.IntType(16), LANES))


def address(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    """Point at array[index] of a contiguous array of a Numba type, as at a vector of an LLVM type."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def everywhere(builder: Any, number: Any, vector: Any) -> Any:
    """Make a vector of an LLVM type with LANES lanes, which are all one number."""
    empty, whole = ir.Constant(vector, ir.Undefined), ir.IntType(32)
    one = builder.insert_element(empty, number, ir.Constant(whole, 0))
    return builder.shuffle_vector(one, empty, ir.Constant(ir.VectorType(whole, LANES), [0] * LANES))


def plus_product(builder: Any, total: Any, one: Any, other: Any) -> Any:
    """Make total + one * other of vectors of float32, with one rounding where the machine can."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(REALS, [REALS] * 3), f"llvm.fmuladd.v{LANES}f32"
    )
    return builder.call(function, [one, other, total])


def _only(builder: Any, values: Any, lanes: Any) -> Any:
    """Give whole numbers in the lanes whose bit is set in a number, 0 in the others."""
    inside = builder.bitcast(lanes, ir.VectorType(ir.IntType(1), LANES))
    return builder.select(inside, values, ir.Constant(values.type, [0] * LANES))


@intrinsic
def zeros(typing: Any) -> Any:
    """Make a vector of zeros."""
    return VECTOR(), lambda context, builder, signature, args: ir.Constant(VECTOR.held, [0.0] * LANES)


@intrinsic
def load(typing: Any, array: Any, index: Any, lanes: Any) -> Any:
    """Read array[index : index + LANES] of a contiguous int16 array, as float32: 0 where no bit of `lanes` is set."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index, lanes = args
        there = address(context, builder, signature.args[0], array, index, _WORDS.held)
        values = builder.sext(builder.load(there, align=2), WHOLES)
        return builder.sitofp(_only(builder, values, lanes), REALS)

    return VECTOR(array, index, uint16), generate


@intrinsic
def store(typing: Any, array: Any, index: Any, values: Any) -> Any:
    """Write array[index : index + LANES] of a contiguous float32 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index, values = args
        there = address(context, builder, signature.args[0], array, index, VECTOR.held)
        builder.store(values, there, align=4)
        return context.get_dummy_value()

    return types.void(array, index, values), generate


@intrinsic
def add_times(typing: Any, total: Any, factor: Any, values: Any) -> Any:
    """Return total + factor * values, with one rounding where the machine can."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, factor, values = args
        return plus_product(builder, total, everywhere(builder, factor, REALS), values)

    return VECTOR(VECTOR, float32, VECTOR), generate


@intrinsic
def add_where(typing: Any, total: Any, number: Any, lanes: Any) -> Any:
    """Return total + a number where a bit of `lanes` is set."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, number, lanes = args
        inside = builder.bitcast(lanes, ir.VectorType(ir.IntType(1), LANES))
        return builder.select(inside, builder.fadd(total, everywhere(builder, number, REALS)), total)

    return VECTOR(VECTOR, float32, uint16), generate


@intrinsic
def plus(typing: Any, one: Any, other: Any) -> Any:
    """Add two vectors."""
    return VECTOR(VECTOR, VECTOR), lambda context, builder, signature, args: builder.fadd(*args)


@intrinsic
def raised(typing: Any, array: Any, index: Any, factor: Any, values: Any, others: Any) -> Any:
    """Add factor * values + others to array[index : index + LANES], float32, and return what it becomes.

    That is made larger by 2^-22 of it, four times what one addition in float32 may round.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index, factor, values, others = args
        there = address(context, builder, signature.args[0], array, index, VECTOR.held)
        total = plus_product(
            builder, builder.load(there, align=4), everywhere(builder, factor, REALS), values
        )
        total = builder.fadd(total, others)
        zero, less, more = (
            ir.Constant(VECTOR.held, [number] * LANES) for number in (0.0, 1 - 2.0**-22, 1 + 2.0**-22)
        )
        negative = builder.fcmp_ordered("<", total, zero)
        total = builder.fmul(total, builder.select(negative, less, more))
        builder.store(total, there, align=4)
        return total

    return VECTOR(array, index, float32, VECTOR, VECTOR), generate


@intrinsic
def load_plus(typing: Any, array: Any, constant: Any) -> Any:
    """Read array[:LANES] of a contiguous float32 array, and add a number to it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, constant = args
        first = ir.Constant(ir.IntType(64), 0)
        there = address(context, builder, signature.args[0], array, first, VECTOR.held)
        return builder.fadd(builder.load(there, align=4), everywhere(builder, constant, REALS))

    return VECTOR(array, float32), generate


@intrinsic
def highest_lane(typing: Any, first: Any, second: Any, third: Any, fourth: Any) -> Any:
    """Return the highest number in four vectors, none of which is NaN."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def higher(one: Any, other: Any) -> Any:
            return builder.select(builder.fcmp_ordered(">", one, other), one, other)

        most = higher(higher(args[0], args[1]), higher(args[2], args[3]))
        lanes = LANES
        while lanes > 1:
            lanes //= 2
            kind = ir.VectorType(ir.IntType(32), lanes)
            halves = [
                builder.shuffle_vector(most, most, ir.Constant(kind, list(range(begin, begin + lanes))))
                for begin in (0, lanes)
            ]
            most = higher(*halves)
        return builder.extract_element(most, ir.Constant(ir.IntType(32), 0))

    return float32(*[VECTOR] * 4), generate


def _fetcher(locality: int) -> Any:
    """Make the intrinsic that begins to bring something into a cache: 3 for the first level, 2 for the second."""

    @intrinsic
    def fetch(typing: Any, array: Any, index: Any) -> Any:
        """Begin to bring array[index] of a contiguous array into a cache. Nothing is read: it need not be there."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            array, index = args
            data = context.make_array(signature.args[0])(context, builder, array).data
            byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
            function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            there = builder.bitcast(builder.gep(data, [index]), byte)
            builder.call(function, [there, *(ir.Constant(whole, number) for number in (0, locality, 1))])
            return context.get_dummy_value()

        return types.void(array, index), generate

    return fetch


fetch_close, fetch = _fetcher(3), _fetcher(2)


@intrinsic
def no_words(typing: Any) -> Any:
    """Make a vector of zeros, of 16 bits."""
    return _WORDS(), lambda context, builder, signature, args: ir.Constant(_WORDS.held, [0] * LANES)


@intrinsic
def add_bytes(typing: Any, total: Any, array: Any, index: Any, lanes: Any) -> Any:
    """Return total + array[index : index + LANES] of a contiguous uint8 array, where a bit of `lanes` is set.

    In 16 bits: sums up to 65,535.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, array, index, lanes = args
        there = address(context, builder, signature.args[1], array, index, _BYTES)
        values = builder.zext(builder.load(there, align=1), _WORDS.held)
        return builder.add(total, _only(builder, values, lanes))

    return _WORDS(_WORDS, array, index, uint16), generate


@intrinsic
def add_products(
    typing: Any, total: Any, array: Any, index: Any, other: Any, lanes: Any, weight: Any, other_weight: Any
) -> Any:
    """Return total + (array[index : index + LANES] * weight + array[other : other + LANES] * other_weight) / DIVISOR.

    Rounded down; where a bit of `lanes` is set. In 16 bits: a sum of both products, and the total, are at most 65,535.
    The array is of uint8, contiguous.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, array, index, other, lanes, weight, other_weight = args
        products = []
        for begin, factor in ((index, weight), (other, other_weight)):
            there = address(context, builder, signature.args[1], array, begin, _BYTES)
            values = builder.zext(builder.load(there, align=1), _WORDS.held)
            factor = everywhere(builder, builder.zext(factor, ir.IntType(16)), _WORDS.held)
            products.append(builder.mul(values, factor))
        values = builder.add(*products)
        values = builder.lshr(values, ir.Constant(_WORDS.held, [DIVISOR.bit_length() - 1] * LANES))
        return builder.add(total, _only(builder, values, lanes))

    return _WORDS(_WORDS, array, index, other, uint16, uint8, uint8), generate


@intrinsic
def add_words(typing: Any, total: Any, values: Any) -> Any:
    """Return total + values, numbers of 16 bits, as float32."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        # Through 32 bits with a sign, for which processors have an instruction.
        wide = builder.zext(args[1], ir.VectorType(ir.IntType(32), LANES))
        return builder.fadd(args[0], builder.sitofp(wide, VECTOR.held))

    return VECTOR(VECTOR, _WORDS), generate
