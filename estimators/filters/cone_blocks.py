"""Sums of cones over 4 x 4 columns of nodes, which stay in registers while cones are added (for compiled code)."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import float32, int32, types, uint64
from numba.extending import intrinsic

from tactsim.estimators.field.vectors import (
    LANES,
    REALS,
    WHOLES,
    Registers,
    address,
    everywhere,
    plus_product,
)

SIDE = 4  # columns of a block along x, and along y: as many altogether as LANES
_INDEX = ir.IntType(64)
_BLOCK = ir.ArrayType(REALS, LANES)  # of each column LANES nodes, row by row
# Taken from a square of up to 256 in float32, so that rounding never moves a node away from a cone.
_ROUNDING = 1e-4

_KIND = Registers(f"Block{SIDE}x{SIDE}x{LANES}", _BLOCK)


@intrinsic
def no_cones(typing: Any) -> Any:
    """Make a block of zeros."""
    return _KIND(), lambda context, builder, signature, args: ir.Constant(_BLOCK, None)


@intrinsic
def write_entries(
    typing: Any, entries: Any, at: Any, x: Any, y: Any, squares: Any, last: Any, stride: Any, first: Any
) -> Any:
    """Write to entries[at : at + LANES], for each column: first + stride * min(last, squares * (x^2 + y^2)).

    x, y: of the block's first column from the tip of a cone, in columns. The last factor is rounded down; entries are
    int32.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        entries, at, x, y, squares, last, stride, first = args
        columns = ir.Constant(REALS, [float(k % SIDE) for k in range(LANES)])
        rows = ir.Constant(REALS, [float(k // SIDE) for k in range(LANES)])
        x = builder.fadd(everywhere(builder, x, REALS), columns)
        y = builder.fadd(everywhere(builder, y, REALS), rows)
        square = builder.fadd(builder.fmul(x, x), builder.fmul(y, y))
        square = builder.fmul(square, everywhere(builder, squares, REALS))
        square = builder.fsub(square, ir.Constant(REALS, [_ROUNDING] * LANES))
        last = everywhere(builder, last, REALS)
        square = builder.select(builder.fcmp_ordered("<", square, last), square, last)
        entry = builder.mul(builder.fptosi(square, WHOLES), everywhere(builder, stride, WHOLES))
        entry = builder.add(entry, everywhere(builder, first, WHOLES))
        builder.store(entry, address(context, builder, signature.args[0], entries, at, WHOLES), align=4)
        return context.get_dummy_value()

    return types.void(entries, uint64, float32, float32, float32, float32, int32, int32), generate


@intrinsic
def plus_cone(typing: Any, block: Any, height: Any, profiles: Any, entries: Any, at: Any) -> Any:
    """Return a block plus height * profiles[e : e + LANES], e of each column from entries[at : at + LANES]."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        block, height, profiles, entries, at = args
        heights = everywhere(builder, height, REALS)
        there = context.make_array(signature.args[3])(context, builder, entries).data
        for k in range(LANES):
            entry = builder.load(builder.gep(there, [builder.add(at, ir.Constant(_INDEX, k))]))
            entry = builder.zext(entry, _INDEX)
            place = address(context, builder, signature.args[2], profiles, entry, REALS)
            column = builder.extract_value(block, k)
            total = plus_product(builder, column, heights, builder.load(place, align=4))
            block = builder.insert_value(block, total, k)
        return block

    return _KIND(_KIND, float32, profiles, entries, uint64), generate


@intrinsic
def add_block(typing: Any, nodes: Any, first: Any, per_column: Any, per_row: Any, block: Any) -> Any:
    """Add a block to nodes[i : i + LANES], for each column with i = first + column * per_column + row * per_row."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        nodes, first, per_column, per_row, block = args
        for k in range(LANES):
            row, column = (ir.Constant(_INDEX, part) for part in divmod(k, SIDE))
            away = builder.add(builder.mul(row, per_row), builder.mul(column, per_column))
            there = address(context, builder, signature.args[0], nodes, builder.add(first, away), REALS)
            total = builder.fadd(builder.load(there, align=4), builder.extract_value(block, k))
            builder.store(total, there, align=4)
        return context.get_dummy_value()

    return types.void(nodes, uint64, uint64, uint64, _KIND), generate
