"""Where sixteen states see a taxel among the nodes of a table, and what the table says there (for compiled code).

Two neighbouring nodes are fetched at once, state by state: instructions that gather take longer.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import float32, int32, types, uint64
from numba.extending import intrinsic

from tactsim.estimators.field.vectors import LANES, REALS, WHOLES, address, everywhere, plus_product

_WHOLE, _INDEX = ir.IntType(32), ir.IntType(64)


@intrinsic
def find_nodes(
    typing: Any, at: Any, share: Any, where: Any, along: Any, across: Any, first: Any, x: Any, y: Any, last: Any,
    stride: Any,
) -> Any:  # fmt: skip
    """Find along one axis the node before a taxel, for the states first, ..., first + LANES - 1.

    The taxel at x, y of the robot's frame is at where[k] + along[k] * x + across[k] * y of the axis, in steps of the
    lattice, float32; places outside are moved to the rim. at[k] is raised by the node's number, at most last - 1, times
    `stride`; share[k] becomes how far the place is beyond the node, of the step to the next.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        at, share, where, along, across, first, x, y, last, stride = args

        def pointer(number: int, array: Any, vector: Any) -> Any:
            return address(context, builder, signature.args[number], array, first, vector)

        place = builder.load(pointer(2, where, REALS), align=4)
        for number, slopes, of_taxel in ((3, along, x), (4, across, y)):
            slope = builder.load(pointer(number, slopes, REALS), align=4)
            place = plus_product(builder, place, slope, everywhere(builder, of_taxel, REALS))
        none, end = ir.Constant(REALS, [0.0] * LANES), everywhere(builder, last, WHOLES)
        rim = builder.sitofp(end, REALS)
        place = builder.select(builder.fcmp_ordered("<", place, none), none, place)
        place = builder.select(builder.fcmp_ordered("<", rim, place), rim, place)
        # NaN is at no node: it must not be looked up outside.
        node, nowhere = builder.fptosi(place, WHOLES), ir.Constant(WHOLES, [0] * LANES)
        most = builder.sub(end, ir.Constant(WHOLES, [1] * LANES))
        node = builder.select(builder.icmp_signed("<", node, nowhere), nowhere, node)
        node = builder.select(builder.icmp_signed("<", most, node), most, node)
        builder.store(builder.fsub(place, builder.sitofp(node, REALS)), pointer(1, share, REALS), align=4)
        there = pointer(0, at, WHOLES)
        away = builder.mul(node, everywhere(builder, stride, WHOLES))
        builder.store(builder.add(builder.load(there, align=4), away), there, align=4)
        return context.get_dummy_value()

    return types.void(at, share, where, along, across, uint64, float32, float32, int32, int32), generate


@intrinsic
def add_between(
    typing: Any, total: Any, first: Any, nodes: Any, begin: Any, at: Any, row: Any, right: Any, above: Any, factor: Any
) -> Any:  # fmt: skip
    """Add factor * what a table says to total[first : first + LANES], float32, interpolated between four nodes.

    nodes: flat, int16. For each state the node to the lower left is begin + at[k], and those of the next row are
    `row` further on. right, above: the shares of the way to the next column and row.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, first, nodes, begin, at, row, right, above, factor = args

        def loaded(number: int, array: Any) -> Any:
            return builder.load(
                address(context, builder, signature.args[number], array, first, REALS), align=4
            )

        here = builder.gep(context.make_array(signature.args[2])(context, builder, nodes).data, [begin])
        places = address(context, builder, signature.args[4], at, first, _WHOLE)
        next_row = builder.gep(here, [row])
        right, above = loaded(6, right), loaded(7, above)
        lower = _between(builder, right, *_pairs(builder, here, places))
        upper = _between(builder, right, *_pairs(builder, next_row, places))
        value = _between(builder, above, lower, upper)
        there = address(context, builder, signature.args[0], total, first, REALS)
        total = plus_product(builder, builder.load(there, align=4), everywhere(builder, factor, REALS), value)
        builder.store(total, there, align=4)
        return context.get_dummy_value()

    return types.void(total, uint64, nodes, uint64, at, uint64, right, above, float32), generate


def _between(builder: Any, share: Any, one: Any, other: Any) -> Any:
    """Go a share of the way from one to the other."""
    return plus_product(builder, one, share, builder.fsub(other, one))


def _pairs(builder: Any, nodes: Any, places: Any) -> list[Any]:
    """Fetch the node at each of LANES places, and the next one, as float32: two vectors."""
    pairs = ir.Constant(WHOLES, ir.Undefined)
    for lane in range(LANES):
        number = ir.Constant(_WHOLE, lane)
        place = builder.zext(builder.load(builder.gep(places, [number]), align=4), _INDEX)
        pair = builder.bitcast(builder.gep(nodes, [place]), _WHOLE.as_pointer())
        pairs = builder.insert_element(pairs, builder.load(pair, align=2), number)
    half = ir.Constant(WHOLES, [16] * LANES)
    # Numba's processors are little-endian: the first node is in the lower half.
    first, second = builder.ashr(builder.shl(pairs, half), half), builder.ashr(pairs, half)
    return [builder.sitofp(each, REALS) for each in (first, second)]
