"""The inner loops of the filters, compiled once and cached. Serial: trials are what runs in parallel.

For one angle of T_R^O, all bins see a taxel through the same fraction of a table cell. So a term of a
reading adds one shifted piece of the table to all of them, with four bilinear weights in common: no
bin is looked up by itself. Bins are summed in tiles of 4 rows of 16, which stay in registers while
all terms are added. A bin's terms are always added in the same order and precision, so it does not
matter when, or beside which others, a bin is evaluated.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import float32, float64, int64, types, uint64, void
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

from tactsim.estimators.field.compiling import Floats, Ints, Reals, compiled

# ---- vectors: numba has none, and finds too few of them by itself in loops over short slices

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
def _zeros(typing: Any) -> Any:
    """Make a vector of zeros."""
    return _LANES(), lambda context, builder, signature, args: ir.Constant(_VECTOR, [0.0] * LANES)


@intrinsic
def _load(typing: Any, array: Any, index: Any) -> Any:
    """Read array[index : index + LANES] of a contiguous float32 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, signature, args), align=4)

    return _LANES(array, index), generate


@intrinsic
def _store(typing: Any, array: Any, index: Any, values: Any) -> Any:
    """Write array[index : index + LANES] of a contiguous float32 array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, signature, args), align=4)
        return context.get_dummy_value()

    return types.void(array, index, values), generate


@intrinsic
def _add_times(typing: Any, total: Any, factor: Any, values: Any) -> Any:
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


# ---- what the kernels work on


class Slices(NamedTuple):
    """Tables as bins, or blocks of bins, read them.

    nodes: `Tables.values`, flat, with TALL rows of zeros before and after each plane and LANES zeros
    after each row, so that a tile may hang over the edge. shape: that of `Tables.values`.
    place: [x, y] of bin (0, 0) less that of node (0, 0), then the bins' spacing in x and y, mm.
    """

    nodes: Floats
    shape: Ints
    place: Reals


class Terms(NamedTuple):
    """All readings so far, as in `tactsim.estimators.field.history.History`."""

    start: Ints
    kind: Ints
    xy: Reals
    weight: Floats
    constant: Reals
    ceiling: Reals
    slack: Reals


class Belief(NamedTuple):
    """The log-belief of all bins, and what is known of blocks of bins that were left alone.

    log_p: (letters, angles, tile rows, tile columns, TALL * LANES), a bin's log-belief after the first
    `seen` readings, not normalised. edge: (tile rows, tile columns, TALL * LANES), 0 for a bin and
    -inf where a tile hangs over the grid. upper, seen, bounded: (letters, angles, block rows, block
    columns). No bin of a block is above upper + ceiling[count] after `count` readings. In that bound
    `bounded` readings count with what the tables' maxima over a block allow, the later ones with
    their ceilings. summit: (letters, angles), not below any `upper` there. size: rows and columns of
    bins, rows and columns of bins in a block. Blocks have whole tiles, or divide one into equal
    columns.
    """

    log_p: Reals
    edge: Reals
    upper: Reals
    seen: Ints
    bounded: Ints
    summit: Reals
    size: Ints


def slices_of(values: Floats, place: Reals) -> Slices:
    """Frame `Tables.values` for the kernels; place as in `Slices`."""
    frame = [(0, 0)] * 4 + [(TALL, TALL), (0, LANES)]
    return Slices(np.pad(values, frame).reshape(-1), np.array(values.shape), place)


_REALS, _REALS_2D, _REALS_3D = float64[::1], float64[:, ::1], float64[:, :, ::1]
_REALS_4D, _REALS_5D = float64[:, :, :, ::1], float64[:, :, :, :, ::1]
_INTS, _INTS_2D, _INTS_4D = int64[::1], int64[:, ::1], int64[:, :, :, ::1]
_FLOATS, _FLOATS_2D = float32[::1], float32[:, ::1]
_SLICES = types.NamedTuple((_FLOATS, _INTS, _REALS), Slices)
_TERMS = types.NamedTuple((_INTS, _INTS, _REALS_2D, _FLOATS, _REALS_2D, _REALS, _REALS), Terms)
_BELIEF = types.NamedTuple((_REALS_5D, _REALS_3D, _REALS_4D, _INTS_4D, _INTS_4D, _REALS_2D, _INTS), Belief)

# A slice further out than this many bins is off the map, and its index might overflow.
_FAR = 1e9
# How far one operation in float32 may be off, relative to its result.
_ROUNDING = 2.0**-23


# ---- taking readings in


@compiled(types.boolean(_TERMS, int64, _INTS, _INTS, _FLOATS, _REALS_2D, _REALS, _REALS_2D, _REALS, _REALS))
def record(
    terms: Terms, reading: int, table: Ints, taxel: Ints, weight: Floats, taxel_xy: Reals, pose: Reals,
    outside: Reals, lowest: Reals, highest: Reals,
) -> bool:  # fmt: skip
    """Append a reading's evidence, taken at the pose sensor_in_robot; the arrays must have room.

    outside, lowest, highest: as in `Tables`. Returns False, and appends nothing, if a table or taxel
    does not exist or a weight is negative or not finite.
    """
    begin = terms.start[reading]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    terms.constant[reading] = 0
    most = slack = 0.0
    for i in range(len(table)):
        kind, factor = table[i], float64(weight[i])
        if not (0 <= kind < len(highest) and 0 <= taxel[i] < len(taxel_xy) and 0 <= factor < np.inf):
            return False
        x, y = taxel_xy[taxel[i], 0], taxel_xy[taxel[i], 1]
        terms.kind[begin + i], terms.weight[begin + i] = kind, factor
        terms.xy[begin + i, 0] = pose[0] + cos * x - sin * y
        terms.xy[begin + i, 1] = pose[1] + sin * x + cos * y
        most += factor * highest[kind]
        slack += factor * max(abs(lowest[kind]), abs(highest[kind]))
        for letter in range(outside.shape[1]):
            terms.constant[reading, letter] += factor * outside[kind, letter]
    # Each of the additions may be off by that share of what the sum can have reached.
    terms.slack[reading] = slack * _ROUNDING * (len(table) + 4)
    terms.ceiling[reading + 1] = terms.ceiling[reading] + most + terms.slack[reading]
    terms.start[reading + 1] = begin + len(table)
    return True


# ---- evaluating bins


@compiled(
    void(_TERMS, int64, _SLICES, float64, float64, int64, int64, _INTS_2D, _FLOATS_2D, _INTS_2D),
    called_from_python=False,
)
def place_terms(
    terms: Terms, reading: int, slices: Slices, cos: float, sin: float, rows: int, columns: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Find the pieces of the tables that the bins of one angle read for one reading.

    Fills for each term: offset (4,), the flat index of the nodes around bin (0, 0) in the first
    letter's tables; share (4,), their weights; within (4,), first and last column and row (from, to)
    of the bins whose nodes are on the lattice. Elsewhere tables are 0.
    """
    letters, phases_y, phases_x = slices.shape[1], slices.shape[2], slices.shape[3]
    width, plane = slices.shape[5] + LANES, (slices.shape[4] + 2 * TALL) * (slices.shape[5] + LANES)
    # To the next node, from the last of a bin's nodes to the first of the next bin's.
    carry_x, carry_y = 1 - phases_x * plane, width - phases_y * phases_x * plane
    begin = terms.start[reading]
    for i in range(terms.start[reading + 1] - begin):
        x, y = terms.xy[begin + i, 0], terms.xy[begin + i, 1]
        u = (cos * x - sin * y + slices.place[0]) / slices.place[2]
        v = (sin * x + cos * y + slices.place[1]) / slices.place[3]
        u, v = min(max(u, -_FAR), _FAR), min(max(v, -_FAR), _FAR)
        left, below = int64(math.floor(u)), int64(math.floor(v))
        # The node to the left is number `step_x` of the nodes that lie between two bins.
        u, v = (u - left) * phases_x, (v - below) * phases_y
        step_x, step_y = min(int64(u), phases_x - 1), min(int64(v), phases_y - 1)
        last_x, last_y = int64(step_x + 1 == phases_x), int64(step_y + 1 == phases_y)
        within[i, 0], within[i, 1] = max(0, -left), min(columns, slices.shape[5] - left - last_x)
        within[i, 2], within[i, 3] = max(0, -below), min(rows, slices.shape[4] - below - last_y)
        phase = (terms.kind[begin + i] * letters * phases_y + step_y) * phases_x + step_x
        node = phase * plane + (below + TALL) * width + left
        right, above = plane + last_x * carry_x, phases_x * plane + last_y * carry_y
        offset[i, 0], offset[i, 1] = node, node + right
        offset[i, 2], offset[i, 3] = node + above, node + above + right
        factor, right_share, above_share = float64(terms.weight[begin + i]), u - step_x, v - step_y
        share[i, 0] = factor * (1 - above_share) * (1 - right_share)
        share[i, 1] = factor * (1 - above_share) * right_share
        share[i, 2] = factor * above_share * (1 - right_share)
        share[i, 3] = factor * above_share * right_share


@compiled(
    void(_FLOATS, _SLICES, int64, int64, int64, int64, _INTS_2D, _FLOATS_2D, _INTS_2D),
    called_from_python=False,
)
def sum_tile(
    total: Floats, slices: Slices, terms: int, letter: int, row: int, column: int,
    offset: Ints, share: Floats, within: Ints,
) -> None:  # fmt: skip
    """Add up the placed terms for the tile that begins at a row and column; fills total (4 * 16,)."""
    nodes, width = slices.nodes, slices.shape[5] + LANES
    plane = (slices.shape[4] + 2 * TALL) * width
    move = letter * slices.shape[2] * slices.shape[3] * plane + row * width + column
    first = second = third = fourth = _zeros()  # type: ignore[call-arg, var-annotated]
    for i in range(terms):
        if (
            column + LANES <= within[i, 0]
            or column >= within[i, 1]
            or row + TALL <= within[i, 2]
            or row >= within[i, 3]
        ):
            continue
        for corner in range(4):
            weight, at = share[i, corner], offset[i, corner] + move
            first = _add_times(first, weight, _load(nodes, at))
            second = _add_times(second, weight, _load(nodes, at + width))
            third = _add_times(third, weight, _load(nodes, at + 2 * width))
            fourth = _add_times(fourth, weight, _load(nodes, at + 3 * width))
    _store(total, 0, first)
    _store(total, LANES, second)
    _store(total, 2 * LANES, third)
    _store(total, 3 * LANES, fourth)


@compiled(
    void(_REALS, _REALS, _FLOATS, float64, int64, int64, _REALS), ordered=False, called_from_python=False
)
def add_tile(
    log_p: Reals, before: Reals, total: Floats, constant: float, first: int, last: int, peak: Reals
) -> None:
    """Set lanes first..last of a tile to before + constant + total; raise peak (LANES,) to them.

    Arrays are (TALL * LANES,). Other lanes of `peak` are left without meaning.
    """
    # Unsigned, because a signed index is compiled with a test for negative ones, without vectors.
    one, two, three = uint64(LANES), uint64(2 * LANES), uint64(3 * LANES)
    if first == 0 and last == LANES:
        for k in range(one):
            log_p[k] = before[k] + (constant + total[k])
            log_p[k + one] = before[k + one] + (constant + total[k + one])
            log_p[k + two] = before[k + two] + (constant + total[k + two])
            log_p[k + three] = before[k + three] + (constant + total[k + three])
    else:
        for row in range(TALL):
            for k in range(uint64(row * LANES + first), uint64(row * LANES + last)):
                log_p[k] = before[k] + (constant + total[k])
    for k in range(one):
        upper, lower = max(log_p[k], log_p[k + one]), max(log_p[k + two], log_p[k + three])
        peak[k] = max(peak[k], max(upper, lower))


# ---- the histogram filter


@compiled(int64(_BELIEF, _SLICES, _TERMS, _REALS_2D, int64, int64, float64), called_from_python=False)
def lower_bounds(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, count: int, most: int, floor: float
) -> int:
    """Lower the bounds of the blocks that are above `floor`, with the tables' maxima over a block.

    A block whose bound falls below `floor` on the way is left where it is. Returns how many times a
    block took in a reading.
    """
    letters, angles, rows, columns = belief.upper.shape
    offset, within = np.empty((most, 4), dtype=np.int64), np.empty((most, 4), dtype=np.int64)
    share, total = np.empty((most, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    tile_rows, tile_columns = -(-rows // TALL), -(-columns // LANES)
    wanted, ceiling = np.empty(letters * tile_rows * tile_columns, dtype=np.int64), terms.ceiling
    evaluated = 0
    for angle in range(angles):
        oldest, chosen = count, 0
        for letter in range(letters):
            if belief.summit[letter, angle] + ceiling[count] <= floor:
                continue
            for i in range(tile_rows):
                for j in range(tile_columns):
                    age = count
                    for row in range(i * TALL, min(rows, (i + 1) * TALL)):
                        for column in range(j * LANES, min(columns, (j + 1) * LANES)):
                            if belief.upper[letter, angle, row, column] + ceiling[count] > floor:
                                age = min(age, belief.bounded[letter, angle, row, column])
                    if age < count:
                        wanted[chosen] = (letter * tile_rows + i) * tile_columns + j
                        chosen += 1
                        oldest = min(oldest, age)
        for reading in range(oldest, count):
            placed = False
            number = terms.start[reading + 1] - terms.start[reading]
            gain = terms.slack[reading] - (ceiling[reading + 1] - ceiling[reading])
            for w in range(chosen):
                letter, i = wanted[w] // (tile_rows * tile_columns), wanted[w] // tile_columns % tile_rows
                first_row, first_column = i * TALL, wanted[w] % tile_columns * LANES
                last_row, last_column = min(rows, first_row + TALL), min(columns, first_column + LANES)
                upper, bounded = belief.upper[letter, angle], belief.bounded[letter, angle]
                needed = False
                for row in range(first_row, last_row):
                    for column in range(first_column, last_column):
                        if bounded[row, column] == reading and upper[row, column] + ceiling[count] > floor:
                            needed = True
                if not needed:
                    continue
                if not placed:
                    cos, sin = turns[angle, 0], turns[angle, 1]
                    place_terms(terms, reading, slices, cos, sin, rows, columns, offset, share, within)
                    placed = True
                sum_tile(total, slices, number, letter, first_row, first_column, offset, share, within)
                for row in range(first_row, last_row):
                    for column in range(first_column, last_column):
                        if bounded[row, column] == reading:
                            value = total[(row - first_row) * LANES + column - first_column]
                            upper[row, column] += value + terms.constant[reading, letter] + gain
                            bounded[row, column] = reading + 1
                            evaluated += 1
        for letter in range(letters):
            if belief.summit[letter, angle] + ceiling[count] > floor:
                belief.summit[letter, angle] = belief.upper[letter, angle].max()
    return evaluated


@compiled(
    types.Tuple((int64, float64, int64))(
        _BELIEF, _SLICES, _TERMS, _REALS_2D, int64, int64, int64, int64, float64, float64, int64
    ),
    called_from_python=False,
)
def catch_up(
    belief: Belief, slices: Slices, terms: Terms, turns: Reals, angle: int, only: int,
    count: int, most: int, margin: float, best: float, leader: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Bring the bins of one angle's blocks up to date that may come within `margin` of the best bin.

    only: flat index of the one block to look at, or -1. best: log-belief of the best bin so far,
    leader: its block. Returns how many times a bin took in a reading, and the new best and leader.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    offset, within = np.empty((most, 4), dtype=np.int64), np.empty((most, 4), dtype=np.int64)
    share, total = np.empty((most, 4), dtype=np.float32), np.empty(TALL * LANES, dtype=np.float32)
    peak = np.empty((belief.log_p.shape[3], LANES))
    wanted = np.empty(letters * block_rows, dtype=np.int64)
    ceiling = terms.ceiling
    oldest, evaluated, chosen = count, 0, 0
    for letter in range(letters):
        if belief.summit[letter, angle] + ceiling[count] <= best - margin:
            continue
        for i in range(block_rows):
            age = count
            for j in range(block_columns):
                block = ((letter * angles + angle) * block_rows + i) * block_columns + j
                hope = belief.upper[letter, angle, i, j] + ceiling[count]
                if hope > best - margin and (only < 0 or only == block):
                    age = min(age, belief.seen[letter, angle, i, j])
            if age < count:
                wanted[chosen] = letter * block_rows + i
                chosen += 1
                oldest = min(oldest, age)
    for reading in range(oldest, count):
        placed = False
        number = terms.start[reading + 1] - terms.start[reading]
        for w in range(chosen):
            letter, i = wanted[w] // block_rows, wanted[w] % block_rows
            upper, seen = belief.upper[letter, angle, i], belief.seen[letter, angle, i]
            bounded = belief.bounded[letter, angle, i]
            first_block = ((letter * angles + angle) * block_rows + i) * block_columns
            j = 0
            while j < block_columns:
                # Neighbours that want the same reading are evaluated together.
                last = j
                while (
                    last < block_columns
                    and seen[last] == reading
                    and upper[last] + ceiling[count] > best - margin
                    and (only < 0 or only == first_block + last)
                ):
                    last += 1
                if last == j:
                    j += 1
                    continue
                if not placed:
                    cos, sin = turns[angle, 0], turns[angle, 1]
                    place_terms(terms, reading, slices, cos, sin, rows, columns, offset, share, within)
                    placed = True
                begin, end = j * wide, last * wide
                first_tile, end_tile = begin // LANES, (end - 1) // LANES + 1
                peak[first_tile:end_tile] = -np.inf
                for tile_row in range(i * tall // TALL, min(belief.log_p.shape[2], (i + 1) * tall // TALL)):
                    for tile in range(first_tile, end_tile):
                        row, column = tile_row * TALL, tile * LANES
                        sum_tile(total, slices, number, letter, row, column, offset, share, within)
                        here = belief.log_p[letter, angle, tile_row, tile]
                        # Before the first reading all bins are alike, whatever is stored.
                        before = belief.edge[tile_row, tile] if reading == 0 else here
                        add_tile(
                            here, before, total, terms.constant[reading, letter],
                            max(0, begin - column), min(LANES, end - column), peak[tile],
                        )  # fmt: skip
                height = min(rows, (i + 1) * tall) - i * tall
                evaluated += height * (min(columns, last * wide) - j * wide)
                for k in range(j, last):
                    highest = -np.inf
                    for column in range(k * wide, min(columns, (k + 1) * wide)):
                        highest = max(highest, peak[column // LANES, column % LANES])
                    seen[k] = reading + 1
                    upper[k] = min(upper[k], highest - ceiling[reading + 1])
                    bounded[k] = count
                    if reading + 1 == count and highest > best:
                        best, leader = highest, first_block + k
                j = last
    return evaluated, best, leader


@compiled(
    types.UniTuple(int64, 3)(_BELIEF, _SLICES, _SLICES, _TERMS, _REALS_2D, int64, int64, float64, int64)
)
def advance(
    belief: Belief, bins: Slices, blocks: Slices, terms: Terms, turns: Reals,
    count: int, most: int, margin: float, leader: int,
) -> tuple[int, int, int]:  # fmt: skip
    """Bring the bins up to date that can still matter after `count` readings (eq. 13, in logs).

    A block is left alone while its bound is `margin` or more below the best bin. The bound is first
    lowered with the tables' maxima (`blocks`); if that is not enough the block's bins are caught up.
    turns: (angles, 2) cos and sin. most: terms of the longest reading. leader: flat index of the best
    block before the last reading. Returns how many times a bin and a block took in a reading, and the
    best block.
    """
    _, angles, block_rows, block_columns = belief.seen.shape
    best, evaluated, lowered = -np.inf, 0, 0
    # The better the best bin that is known, the fewer blocks can matter: so the leader comes first,
    # and for the first reading the block that is bounded the least.
    for step in range(-1, angles):
        if step == (-1 if count == 1 else 0) and margin < np.inf:
            lowered = lower_bounds(belief, blocks, terms, turns, count, most, best - margin)
            if count == 1:
                leader = int(belief.upper.argmax())
        angle, only = step, -1
        if step < 0:
            angle, only = leader // (block_rows * block_columns) % angles, leader
        made, best, leader = catch_up(
            belief, bins, terms, turns, angle, only, count, most, margin, best, leader
        )
        evaluated += made
    return evaluated, lowered, leader


@compiled(void(_BELIEF, _REALS, int64, float64, int64, _REALS, _INTS))
def summarise(
    belief: Belief, ceiling: Reals, count: int, margin: float, leader: int, mass: Reals, mode: Ints
) -> None:
    """Sum the belief of each letter (eq. 14) and find its best bin (eq. 15).

    Bins `margin` or more below the best are left out. leader: flat index of the best bin's block.
    Fills mass (letters,), relative to the best bin, and mode (letters,), flat index into
    its (angles, rows, columns), or -1.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    best = belief.upper.reshape(belief.upper.size)[leader] + ceiling[count]
    for letter in range(letters):
        mass[letter], mode[letter], highest = 0.0, -1, -np.inf
        for angle in range(angles):
            if belief.summit[letter, angle] + ceiling[count] <= best - margin:
                continue
            for i in range(block_rows):
                for j in range(block_columns):
                    hope = belief.upper[letter, angle, i, j] + ceiling[count]
                    if belief.seen[letter, angle, i, j] != count or hope <= best - margin:
                        continue
                    for row in range(i * tall, min(rows, (i + 1) * tall)):
                        tiles = belief.log_p[letter, angle, row // TALL]
                        for column in range(j * wide, min(columns, (j + 1) * wide)):
                            value = tiles[column // LANES, row % TALL * LANES + column % LANES]
                            if count == 0:
                                value = 0.0
                            if value > best - margin:
                                mass[letter] += math.exp(value - best)
                                if value > highest:
                                    highest = value
                                    mode[letter] = (angle * rows + row) * columns + column


@compiled(int64(_BELIEF, float64, int64, float64, _INTS, _REALS))
def pick(belief: Belief, ceiling: float, count: int, least: float, flat: Ints, log_p: Reals) -> int:
    """List the bins, up to date after `count` readings, whose log-belief is at least `least`.

    ceiling: `Terms.ceiling` after so many readings. Fills flat, index into (letters, angles, rows,
    columns), and log_p, both (bins of all letters,), from the start; returns how many there are.
    """
    letters, angles, block_rows, block_columns = belief.seen.shape
    rows, columns, tall, wide = belief.size[0], belief.size[1], belief.size[2], belief.size[3]
    found = 0
    for letter in range(letters):
        for angle in range(angles):
            for i in range(block_rows):
                for j in range(block_columns):
                    hope = belief.upper[letter, angle, i, j] + ceiling
                    if belief.seen[letter, angle, i, j] != count or hope < least:
                        continue
                    for row in range(i * tall, min(rows, (i + 1) * tall)):
                        tiles = belief.log_p[letter, angle, row // TALL]
                        for column in range(j * wide, min(columns, (j + 1) * wide)):
                            value = tiles[column // LANES, row % TALL * LANES + column % LANES]
                            if value >= least:
                                flat[found] = ((letter * angles + angle) * rows + row) * columns + column
                                log_p[found] = value
                                found += 1
    return found
