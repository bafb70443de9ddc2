"""Vectors of 16 float32 for compiled code. Numba has none, and finds too few by itself in loops over short slices."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import float32, types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

TALL, LANES = 4, 16  # a tile: rows, and bins of a row
_VECTOR = ir.VectorType(ir.FloatType(), LANES)


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


_LANES = _Lanes()


def _address(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, args[0])
    return builder.bitcast(builder.gep(array.data, [args[1]]), _VECTOR.as_pointer())


@intrinsic
def zeros(typing: Any) -> Any:
    """Make a vector of zeros."""
    return _LANES(), lambda context, builder, signature, args: ir.Constant(_VECTOR, [0.0] * LANES)


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Read array[index : index + LANES] of a contiguous float32 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, signature, args), align=4)

    return _LANES(array, index), generate


@intrinsic
def store(typing: Any, array: Any, index: Any, values: Any) -> Any:
    """Write array[index : index + LANES] of a contiguous float32 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, signature, args), align=4)
        return context.get_dummy_value()

    return types.void(array, index, values), generate


@intrinsic
def add_times(typing: Any, total: Any, factor: Any, values: Any) -> Any:
    """Return total + factor * values, with one rounding where the machine can."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, factor, values = args
        first = ir.Constant(ir.IntType(32), 0)
        one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), factor, first)
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        factors = builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), everywhere)
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_VECTOR, [_VECTOR] * 3), f"llvm.fmuladd.v{LANES}f32"
        )
        return builder.call(function, [factors, values, total])

    return _LANES(_LANES, float32, _LANES), generate


@intrinsic
def load_bytes(typing: Any, array: Any, index: Any) -> Any:
    """Read array[index : index + LANES] of a contiguous uint8 array, as float32."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, args[0])
        kind = ir.VectorType(ir.IntType(8), LANES)
        values = builder.load(builder.bitcast(builder.gep(array.data, [args[1]]), kind.as_pointer()), align=1)
        # Through 32 bits with a sign, for which processors have an instruction.
        return builder.sitofp(builder.zext(values, ir.VectorType(ir.IntType(32), LANES)), _VECTOR)

    return _LANES(array, index), generate
