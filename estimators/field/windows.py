"""What sixteen terms say at four states at once, from one window of nodes for each term (for compiled code).

The four states are a square: two x by two y, of one angle. Where they are near each other they read the same few nodes
of a table: four neighbours in each of three or four rows, which are fetched together.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types, uint64
from numba.extending import intrinsic

from tactsim.estimators.field.between_nodes import between, nearest_nodes
from tactsim.estimators.field.vectors import LANES, REALS, WHOLES, address, everywhere, plus_product

# Nodes of a row that are fetched together, of 16 bits each.
WIDE = 4
# What is kept of a term: the shares of the way to the next node for both x and both y, and how far into the window the
# nodes before these are.
KEPT = 4
_BITS = 16
_REAL, _WHOLE, _INDEX = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_ROWS = ir.VectorType(_INDEX, LANES // 2)


@intrinsic
def find_windows(
    typing: Any, at: Any, into: Any, share: Any, slot: Any, x: Any, y: Any, first: Any, square: Any, limits: Any
) -> Any:  # fmt: skip
    """Find the windows in which a square of states sees the places first, ..., first + LANES - 1.

    x, y: of the places in the robot's frame, mm, float32. square: float32 [x, x, along x, across x, y, y, along y,
    across y]: a place is seen at x + along * place's x + across * place's y, and in y likewise, in steps of the
    lattice; outside, at the rim. limits: int32 [last column, last row, last first column of a window, last first row].

    Fills of the three arrays the part number `slot`. at: int32, the first node of the window, from the letter's first.
    into: int32, for both x and both y how far the node before the place is into the window. share: float32, how far the
    place is beyond that node.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        at, into, share, slot, x, y, first, square, limits = args

        def load(number: int, array: Any, index: Any, kind: Any) -> Any:
            return builder.load(
                address(context, builder, signature.args[number], array, index, kind), align=4
            )

        def store(number: int, array: Any, kept: int, part: int, values: Any) -> None:
            here = builder.add(
                builder.mul(slot, ir.Constant(_INDEX, kept * LANES)), ir.Constant(_INDEX, part * LANES)
            )
            there = address(context, builder, signature.args[number], array, here, values.type)
            builder.store(values, there, align=4)

        def of_square(number: int) -> Any:
            return everywhere(builder, load(7, square, ir.Constant(_INDEX, number), _REAL), REALS)

        def limit(number: int) -> Any:
            return load(8, limits, ir.Constant(_INDEX, number), _WHOLE)

        across, up, windows = load(4, x, first, REALS), load(5, y, first, REALS), []
        for axis in range(2):
            last, nodes = limit(axis), []
            for part in range(2):
                place = plus_product(builder, of_square(4 * axis + part), of_square(4 * axis + 2), across)
                place = plus_product(builder, place, of_square(4 * axis + 3), up)
                node, beyond = nearest_nodes(builder, place, last)
                store(2, share, KEPT, 2 * axis + part, beyond)
                nodes.append(node)
            # The first of the two, or as many nodes before the rim as a window has.
            furthest = everywhere(builder, limit(2 + axis), WHOLES)
            window = builder.select(builder.icmp_signed("<", nodes[0], furthest), nodes[0], furthest)
            for part in range(2):
                store(1, into, KEPT, 2 * axis + part, builder.sub(nodes[part], window))
            windows.append(window)
        columns = everywhere(builder, builder.add(limit(0), ir.Constant(_WHOLE, 1)), WHOLES)
        store(0, at, 1, 0, builder.add(builder.mul(windows[1], columns), windows[0]))
        return context.get_dummy_value()

    return types.void(at, into, share, uint64, x, y, uint64, square, limits), generate


@intrinsic
def add_vectors(typing: Any, sums: Any, to: Any, one: Any, here: Any, other: Any, there: Any) -> Any:
    """Fill sums[to : to + LANES] with one[here : here + LANES] + other[there : there + LANES], all int32."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place, left, right = (
            address(context, builder, signature.args[number], args[number], index, WHOLES)
            for number, index in ((0, args[1]), (2, args[3]), (4, args[5]))
        )
        values = builder.add(builder.load(left, align=4), builder.load(right, align=4))
        builder.store(values, place, align=4)
        return context.get_dummy_value()

    return types.void(sums, uint64, one, uint64, other, uint64), generate


def _adder(tall: int) -> Any:
    """Make the intrinsic that reads windows with so many rows."""

    @intrinsic
    def add_windows(
        typing: Any, total: Any, nodes: Any, begin: Any, row: Any, at: Any, here: Any, factor: Any, there: Any,
        into: Any, share: Any, slot: Any,
    ) -> Any:  # fmt: skip
        """Add what LANES terms say at a square of states to its four sums.

        total: (4 * LANES,) float32, for the states [y, x] LANES partial sums each. nodes: flat, int16. begin: index of
        the letter's first node in the first table. row: nodes in a row. at: int32, from `here` on, of the terms, how
        far it is from there to the first node of the window. factor: float32, from `there` on, of the terms. into,
        share, slot: of their places, as `find_windows` fills them.
        """

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            total, nodes, begin, row, at, here, factor, there, into, share, slot = args

            def pointer(number: int, array: Any, index: Any, kind: Any) -> Any:
                return address(context, builder, signature.args[number], array, index, kind)

            def kept(number: int, array: Any, kind: Any) -> list[Any]:
                first = builder.mul(slot, ir.Constant(_INDEX, KEPT * LANES))
                parts = (builder.add(first, ir.Constant(_INDEX, part * LANES)) for part in range(KEPT))
                return [builder.load(pointer(number, array, part, kind), align=4) for part in parts]

            corner = builder.gep(context.make_array(signature.args[1])(context, builder, nodes).data, [begin])
            windows = [
                builder.load(pointer(4, at, builder.add(here, ir.Constant(_INDEX, lane)), _WHOLE), align=4)
                for lane in range(LANES)
            ]
            places = [builder.zext(window, _INDEX) for window in windows]
            offsets, shares = kept(8, into, WHOLES), kept(9, share, REALS)
            between_columns = []  # [row of the window][x]
            for number in range(tall):
                start = builder.gep(corner, [builder.mul(row, ir.Constant(_INDEX, number))])
                fetched = _fetched(builder, start, places)
                between_columns.append(
                    [between(builder, shares[x], *_two_from(builder, fetched, offsets[x])) for x in range(2)]
                )
            weight = builder.load(pointer(6, factor, there, REALS), align=4)
            for y in range(2):
                for x in range(2):
                    rows = [each[x] for each in between_columns]
                    lower, upper = (_chosen(builder, rows[k:], offsets[2 + y], tall - 1) for k in range(2))
                    value = between(builder, shares[2 + y], lower, upper)
                    sums = pointer(0, total, ir.Constant(_INDEX, (2 * y + x) * LANES), REALS)
                    builder.store(
                        plus_product(builder, builder.load(sums, align=4), weight, value), sums, align=4
                    )
            return context.get_dummy_value()

        return types.void(
            total, nodes, uint64, uint64, at, uint64, factor, uint64, into, share, uint64
        ), generate

    return add_windows


add_low_windows, add_tall_windows = _adder(3), _adder(4)


def _fetched(builder: Any, start: Any, places: list[Any]) -> list[Any]:
    """Fetch WIDE nodes from each of LANES places on, as whole numbers of 64 bits: two vectors."""
    vectors = []
    for begin in range(0, LANES, _ROWS.count):
        rows = ir.Constant(_ROWS, ir.Undefined)
        for lane in range(_ROWS.count):
            there = builder.bitcast(builder.gep(start, [places[begin + lane]]), _INDEX.as_pointer())
            rows = builder.insert_element(rows, builder.load(there, align=2), ir.Constant(_WHOLE, lane))
        vectors.append(rows)
    return vectors


def _two_from(builder: Any, fetched: list[Any], offsets: Any) -> list[Any]:
    """Take two neighbours of the WIDE nodes, the first of them so many (LANES,) from the first, as float32."""
    # At most to the last node: more than all bits cannot be shifted out.
    bits = builder.and_(offsets, ir.Constant(WHOLES, [WIDE - 1] * LANES))
    bits = builder.shl(bits, ir.Constant(WHOLES, [_BITS.bit_length() - 1] * LANES))
    halves = []
    for number, rows in enumerate(fetched):
        mine = [number * _ROWS.count + lane for lane in range(_ROWS.count)]
        shift = builder.shuffle_vector(bits, bits, ir.Constant(ir.VectorType(_WHOLE, _ROWS.count), mine))
        halves.append(builder.bitcast(builder.lshr(rows, builder.zext(shift, _ROWS)), WHOLES))
    # Numba's processors are little-endian: the first node is in the lowest bits.
    lowest = ir.Constant(WHOLES, list(range(0, 2 * LANES, 2)))
    pairs = builder.shuffle_vector(*halves, lowest)
    half = ir.Constant(WHOLES, [_BITS] * LANES)
    first, second = builder.ashr(builder.shl(pairs, half), half), builder.ashr(pairs, half)
    return [builder.sitofp(each, REALS) for each in (first, second)]


def _chosen(builder: Any, rows: list[Any], offsets: Any, count: int) -> Any:
    """Choose for each lane one of `count` rows, by its number."""
    chosen = rows[0]
    for number in range(1, count):
        there = builder.icmp_signed(">", offsets, ir.Constant(WHOLES, [number - 1] * LANES))
        chosen = builder.select(there, rows[number], chosen)
    return chosen


@intrinsic
def add_up(typing: Any, sums: Any, total: Any) -> Any:
    """Add up each LANES partial sums of four, float32 (4 * LANES,); fills sums (4,)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        sums, total = args

        def chosen(one: Any, other: Any, lanes: list[int]) -> Any:
            return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_WHOLE, len(lanes)), lanes))

        parts = []
        for number in range(4):
            here = ir.Constant(_INDEX, number * LANES)
            part = builder.load(address(context, builder, signature.args[1], total, here, REALS), align=4)
            lanes = LANES
            while lanes > 4:
                lanes //= 2
                low, high = (chosen(part, part, list(range(k, k + lanes))) for k in (0, lanes))
                part = builder.fadd(low, high)
            parts.append(part)
        while len(parts) > 1:
            parts = [
                builder.fadd(*(chosen(one, other, list(range(k, 8, 2))) for k in range(2)))
                for one, other in zip(parts[::2], parts[1::2], strict=True)
            ]
        there = address(context, builder, signature.args[0], sums, ir.Constant(_INDEX, 0), parts[0].type)
        builder.store(parts[0], there, align=4)
        return context.get_dummy_value()

    return types.void(sums, total), generate
