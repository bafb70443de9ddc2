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


def nearest_nodes(builder: Any, place: Any, last: Any) -> tuple[Any, Any]:
    """Find the nodes before places along an axis, at most the last but one, and how far beyond them the places are.

    place: vector of float32, in steps of the lattice; outside is moved to the rim. last: number of the last node.
    """
    none, end = ir.Constant(REALS, [0.0] * LANES), everywhere(builder, last, WHOLES)
    rim = builder.sitofp(end, REALS)
    place = builder.select(builder.fcmp_ordered("<", place, none), none, place)
    place = builder.select(builder.fcmp_ordered("<", rim, place), rim, place)
    # NaN is at no node: it must not be looked up outside.
    node, nowhere = builder.fptosi(place, WHOLES), ir.Constant(WHOLES, [0] * LANES)
    most = builder.sub(end, ir.Constant(WHOLES, [1] * LANES))
    node = builder.select(builder.icmp_signed("<", node, nowhere), nowhere, node)
    node = builder.select(builder.icmp_signed("<", most, node), most, node)
    return node, builder.fsub(place, builder.sitofp(node, REALS))


def between(builder: Any, share: Any, one: Any, other: Any) -> Any:
    """Go a share of the way from one to the other."""
    return plus_product(builder, one, share, builder.fsub(other, one))


@intrinsic
def find_nodes(
    typing: Any, at: Any, right: Any, above: Any, to: Any, base: Any, across: Any, up: Any, first: Any, x: Any, y: Any,
    last_column: Any, last_row: Any,
) -> Any:  # fmt: skip
    """Find the nodes to the lower left of a taxel for the states first, ..., first + LANES - 1.

    x, y: of the taxel in the robot's frame, mm. across, up: tuples of three arrays, float32, for either axis: the
    taxel is at where[k] + along_x[k] * x + along_y[k] * y, in steps of the lattice; outside, at the rim. last_column,
    last_row: int32.

    Fills of three arrays `to`, ..., to + LANES - 1. at: base[k] + the node's number, rows following each other. right,
    above: how far the taxel is beyond it, of the step to the next column and row.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _, _, _, to, base, _, _, first, x, y, last_column, last_row = args

        def store(number: int, values: Any) -> None:
            there = address(context, builder, signature.args[number], args[number], to, values.type)
            builder.store(values, there, align=4)

        def load(kind: Any, array: Any, vector: Any) -> Any:
            return builder.load(address(context, builder, kind, array, first, vector), align=4)

        taxel, nodes = [everywhere(builder, number, REALS) for number in (x, y)], []
        for number, share in ((5, 1), (6, 2)):
            last = last_column if share == 1 else last_row
            where, *slopes = (
                load(signature.args[number][part], builder.extract_value(args[number], part), REALS)
                for part in range(3)
            )
            for slope, of_taxel in zip(slopes, taxel, strict=True):
                where = plus_product(builder, where, slope, of_taxel)
            node, beyond = nearest_nodes(builder, where, last)
            store(share, beyond)
            nodes.append(node)
        columns = everywhere(builder, builder.add(last_column, ir.Constant(_WHOLE, 1)), WHOLES)
        place = builder.add(load(signature.args[4], base, WHOLES), nodes[0])
        store(0, builder.add(place, builder.mul(nodes[1], columns)))
        return context.get_dummy_value()

    return types.void(
        at, right, above, uint64, base, across, up, uint64, *[float32] * 2, *[int32] * 2
    ), generate


def _adder(count: int) -> Any:
    """Make the intrinsic that adds so many tables, one after another."""

    @intrinsic
    def add_between(
        typing: Any, total: Any, first: Any, nodes: Any, begin: Any, at: Any, row: Any, right: Any, above: Any,
        here: Any, factor: Any,
    ) -> Any:  # fmt: skip
        """Add factor * what a table says to total[first : first + LANES], float32, interpolated between four nodes.

        nodes: flat, int16. at, right, above: from `here` on for each state, as `find_nodes` fills them; the node to the
        lower left is begin + at, those of the next row are `row` further on. begin, factor: tuples, of the tables.
        """

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            total, first, nodes, begin, at, row, right, above, here, factor = args

            def pointer(number: int, array: Any, index: Any, kind: Any = REALS) -> Any:
                return address(context, builder, signature.args[number], array, index, kind)

            data = context.make_array(signature.args[2])(context, builder, nodes).data
            where = pointer(4, at, here, _WHOLE)
            places = [
                builder.zext(builder.load(builder.gep(where, [ir.Constant(_WHOLE, lane)]), align=4), _INDEX)
                for lane in range(LANES)
            ]
            right, above, sums = (
                builder.load(pointer(*place), align=4)
                for place in ((6, right, here), (7, above, here), (0, total, first))
            )
            for table in range(count):
                corner = builder.gep(data, [builder.extract_value(begin, table)])
                lower = between(builder, right, *_pairs(builder, corner, places))
                upper = between(builder, right, *_pairs(builder, builder.gep(corner, [row]), places))
                weight = everywhere(builder, builder.extract_value(factor, table), REALS)
                sums = plus_product(builder, sums, weight, between(builder, above, lower, upper))
            builder.store(sums, pointer(0, total, first), align=4)
            return context.get_dummy_value()

        tables, factors = types.UniTuple(uint64, count), types.UniTuple(float32, count)
        return types.void(total, uint64, nodes, tables, at, uint64, right, above, uint64, factors), generate

    return add_between


add_between, add_both_between = _adder(1), _adder(2)


def _pairs(builder: Any, nodes: Any, places: list[Any]) -> list[Any]:
    """Fetch the node at each of LANES places, and the next one, as float32: two vectors."""
    pairs = ir.Constant(WHOLES, ir.Undefined)
    for lane in range(LANES):
        pair = builder.bitcast(builder.gep(nodes, [places[lane]]), _WHOLE.as_pointer())
        pairs = builder.insert_element(pairs, builder.load(pair, align=2), ir.Constant(_WHOLE, lane))
    half = ir.Constant(WHOLES, [16] * LANES)
    # Numba's processors are little-endian: the first node is in the lower half.
    first, second = builder.ashr(builder.shl(pairs, half), half), builder.ashr(pairs, half)
    return [builder.sitofp(each, REALS) for each in (first, second)]
