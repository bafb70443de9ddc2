"""The bits of a float64, for compiled code that works on exponent and sign."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def _bits_of(typing: Any, real: Any) -> Any:
    """Read the 64 bits of a float64."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(64))

    return types.uint64(types.float64), generate


@intrinsic
def _real_of(typing: Any, bits: Any) -> Any:
    """Read 64 bits as a float64."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.uint64), generate


bits_of = cast("Callable[[float], Any]", _bits_of)
real_of = cast("Callable[[Any], float]", _real_of)
