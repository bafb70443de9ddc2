"""Cells of a grid, the best of which are halved in x, y and angle, again and again (compiled)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, types, void

from tactsim.core.compiling import INTS, INTS_2D, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.replay import SAMPLED, Sampled
from tactsim.estimators.field.squares import replay_squares
from tactsim.estimators.field.term_vectors import VECTORS, Vectors
from tactsim.estimators.field.terms import TERMS, Terms


class Halved(NamedTuple):
    """Cells that were halved: those of a grid, of halves, of halves of halves, ...

    number: (sizes,) how many cells of each size. cell: (sizes, n) ascending, flat index into the (letters, angles,
    rows, columns) of the grid of that size. half: (sizes, 8 * n) eight for each cell, into the grid of half the size.
    log_p: (sizes, 8 * n) their log-beliefs. Only the first `number` cells of a size are filled.
    """

    number: Ints
    cell: Ints
    half: Ints
    log_p: Reals


HALVED = types.NamedTuple((INTS, INTS_2D, INTS_2D, REALS_2D), Halved)


class Limits(NamedTuple):
    """How far cells are halved.

    cells: of one size that are halved, at most. least, most: how often. enough: once cells were halved `least` times
    and the smallest hold the belief in more than so many (effective sample size), they are small enough.
    """

    cells: int
    least: int
    most: int
    enough: float


LIMITS = types.NamedTuple((int64, int64, int64, float64), Limits)


def blank_halved(limits: Limits) -> Halved:
    """Make room for the cells that are halved, none so far."""
    sizes, cells = limits.most, limits.cells
    return Halved(
        np.zeros(sizes, dtype=np.int64),
        np.zeros((sizes, cells), dtype=np.int64),
        np.zeros((sizes, 8 * cells), dtype=np.int64),
        np.zeros((sizes, 8 * cells)),
    )


@compiled(types.UniTuple(int64, 4)(int64, int64, int64, int64), called_from_python=False)
def unravelled(index: int, columns: int, rows: int, angles: int) -> tuple[int, int, int, int]:
    """Find letter, angle, row and column of a flat index into the (letters, angles, rows, columns) of a grid."""
    rest, column = divmod(index, columns)
    rest, row = divmod(rest, rows)
    letter, angle = divmod(rest, angles)
    return letter, angle, row, column


@compiled(void(REALS_2D, INTS, INTS, INTS, INTS, REALS))
def middles(state: Reals, letter: Ints, times: Ints, index: Ints, counts: Ints, spacing: Reals) -> None:
    """Find T_R^O in the middle of cells, and their letters; fills state (3, n) mm, mm, rad, and letter (n,).

    times: (n,) how often bins of a grid were halved. index: (n,) flat, into the (letters, angles, rows, columns) of the
    grid so halved. counts: columns, rows, angles of the grid itself. spacing: of its bins, mm, mm, rad; it is centred
    at 0.
    """
    for k in range(len(index)):
        columns, rows, angles = counts[0] << times[k], counts[1] << times[k], counts[2] << times[k]
        letter[k], angle, row, column = unravelled(index[k], columns, rows, angles)
        size = 0.5 ** times[k]
        state[0, k] = (column + 0.5 - columns / 2) * size * spacing[0]
        state[1, k] = (row + 0.5 - rows / 2) * size * spacing[1]
        state[2, k] = (angle + 0.5 - angles / 2) * size * spacing[2]


@compiled(void(INTS, INTS, INTS), called_from_python=False)
def halve(half: Ints, cell: Ints, counts: Ints) -> None:
    """Find the eight halves of cells (n,); fills half (8 * n,).

    cell: flat indices into a grid. counts: its columns, rows and angles.
    """
    columns, rows, angles = 2 * counts[0], 2 * counts[1], 2 * counts[2]
    for i in range(len(cell)):
        of, angle, row, column = unravelled(cell[i], counts[0], counts[1], counts[2])
        for part in range(8):
            x, y, turn = 2 * column + (part & 1), 2 * row + (part >> 1 & 1), 2 * angle + (part >> 2)
            half[8 * i + part] = ((of * angles + turn) * rows + y) * columns + x


@compiled(void(REALS_2D, REALS_2D, REALS, INTS, INTS, int64, INTS, REALS), called_from_python=False)
def squares_of_halves(
    x: Reals, y: Reals, angle: Reals, letter: Ints, cell: Ints, times: int, counts: Ints, spacing: Reals
) -> None:
    """Do what `middles` does for the eight halves of each of n cells that were halved `times` times.

    They are two squares of states as `replay_squares` takes them, in the order of `halve`: fills x, y (2 * n, 2), angle
    and letter (2 * n,). A cell's place is found once for all its halves, since divisions take long.
    """
    columns, rows, angles = counts[0] << times, counts[1] << times, counts[2] << times
    size = 0.5 ** (times + 1)
    for i in range(len(cell)):
        of, turn, row, column = unravelled(cell[i], columns, rows, angles)
        for part in range(2):
            square = 2 * i + part
            letter[square], angle[square] = of, (2 * turn + part + 0.5 - angles) * size * spacing[2]
            for k in range(2):
                x[square, k] = (2 * column + k + 0.5 - columns) * size * spacing[0]
                y[square, k] = (2 * row + k + 0.5 - rows) * size * spacing[1]


@compiled(
    int64(HALVED, HALVED, int64, boolean, TERMS, VECTORS, int64, SAMPLED, INTS, REALS),
    called_from_python=False,
)
def evaluate(
    now: Halved, before: Halved, times: int, skip: bool, terms: Terms, vectors: Vectors, readings: int,
    sampled: Sampled, counts: Ints, spacing: Reals,
) -> int:  # fmt: skip
    """Find the log-beliefs of the halves of all cells of one size, and return how many of the cells were known.

    Those of cells that were halved at the reading before, too, take in the last reading only, if `skip`. Other
    arguments as for `refine`.
    """
    number, known = now.number[times], 0
    cell = now.cell[times, :number]
    half, log_p = now.half[times, : 8 * number], now.log_p[times, : 8 * number]
    halve(half, cell, np.array([counts[0] << times, counts[1] << times, counts[2] << times]))
    place = np.full(number, -1)
    if skip:
        there = 0
        for i in range(number):
            while there < before.number[times] and before.cell[times, there] < cell[i]:
                there += 1
            if there < before.number[times] and before.cell[times, there] == cell[i]:
                place[i] = there
                known += 1
    wide, tall = 0.5 ** (times + 1) * spacing[0], 0.5 ** (times + 1) * spacing[1]
    for old in range(2):
        these = np.flatnonzero((place >= 0) == (old == 1))
        squares = 2 * len(these)
        total, x, y = np.zeros((squares, 4)), np.empty((squares, 2)), np.empty((squares, 2))
        angle, letter = np.empty(squares), np.empty(squares, dtype=np.int64)
        squares_of_halves(x, y, angle, letter, cell[these], times, counts, spacing)
        replay_squares(
            total, x, y, angle, letter, wide, tall, terms, vectors, readings - 1 if old else 0, readings, sampled
        )  # fmt: skip
        of_half = total.reshape(total.size)
        for k in range(len(these)):
            i = these[k]
            for part in range(8):
                log_p[8 * i + part] = of_half[8 * k + part]
                if old:
                    log_p[8 * i + part] += before.log_p[times, 8 * place[i] + part]
    return known


@compiled(float64(REALS, float64), called_from_python=False)
def effective(log_p: Reals, weight: float) -> float:
    """Give the effective sample size of log-weights (n,), each times a weight; 0 of none."""
    if len(log_p) == 0:
        return 0.0
    highest, total, squares = log_p.max(), 0.0, 0.0
    for value in log_p:
        share = math.exp(weight * (value - highest))
        total += share
        squares += share * share
    return total * total / squares


@compiled(float64(REALS, int64))
def least_chosen(values: Reals, count: int) -> float:
    """Give what the `count` highest values (n,) are all above; -inf if there are no more than so many.

    Values that are equal are all among them, or none is: of letters that look alike none may be preferred. So there may
    be fewer than `count`.
    """
    next_one = len(values) - count - 1
    return -np.inf if next_one < 0 else np.partition(values, next_one)[next_one]


@compiled(
    types.Tuple((INTS, INTS, REALS, int64, int64))(
        INTS, REALS, LIMITS, float64, boolean, TERMS, VECTORS, int64, SAMPLED, INTS, REALS, HALVED, HALVED
    )
)
def refine(
    cell: Ints, log_p: Reals, limits: Limits, weight: float, skip: bool, terms: Terms, vectors: Vectors, readings: int,
    sampled: Sampled, counts: Ints, spacing: Reals, before: Halved, now: Halved,
) -> tuple[Ints, Ints, Reals, int, int]:  # fmt: skip
    """Halve the best of cells, the best of their halves, and so on.

    cell, log_p: (n,) bins of a grid and their log-beliefs after so many readings, each of which counts `weight`. terms,
    vectors, sampled: as `replay_squares` takes them. counts, spacing: as for `middles`. before: what was halved at the
    reading before; now: is overwritten with what is halved.

    Returns the cells that were not halved, those of each size together: where each size ends (sizes,), flat indices and
    log-beliefs (n,). Then how many times a half took in a reading, and how many times it need not.
    """
    end = np.empty(limits.most + 1, dtype=np.int64)
    room = len(cell) + 8 * limits.cells * limits.most
    left, left_log_p = np.empty(room, dtype=np.int64), np.empty(room)
    filled = evaluated = unreplayed = times = 0
    now.number[:] = 0
    while times < limits.most:
        if times >= limits.least and effective(log_p, weight) > limits.enough:
            break
        least, number = least_chosen(log_p, limits.cells), 0
        for i in range(len(cell)):
            if log_p[i] > least or least == -np.inf:
                now.cell[times, number] = cell[i]
                number += 1
            else:
                left[filled], left_log_p[filled] = cell[i], log_p[i]
                filled += 1
        now.cell[times, :number].sort()
        now.number[times] = number
        known = evaluate(now, before, times, skip, terms, vectors, readings, sampled, counts, spacing)
        evaluated += 8 * ((number - known) * readings + known)
        unreplayed += 8 * known * (readings - 1)
        end[times] = filled
        cell, log_p = now.half[times, : 8 * number], now.log_p[times, : 8 * number]
        times += 1
    left[filled : filled + len(cell)], left_log_p[filled : filled + len(cell)] = cell, log_p
    filled += len(cell)
    end[times] = filled
    return end[: times + 1], left[:filled], left_log_p[:filled], evaluated, unreplayed


@compiled(types.Tuple((INTS, INTS, REALS, float64))(INTS, INTS, REALS, float64, float64))
def held(
    end: Ints, cell: Ints, log_p: Reals, weight: float, negligible: float
) -> tuple[Ints, Ints, Reals, float]:
    """List the cells that `refine` left and that hold a part of the belief.

    A cell holds its likelihood, log_p times `weight`, times its volume. Those `negligible` nats or more below the
    one that holds most are left out. Returns how often each was halved, flat indices, and logs of what they hold, less
    that of the one that holds most (n,), and that log itself.
    """
    volume, highest, first = math.log(8.0), -np.inf, 0
    for times in range(len(end)):
        for i in range(first, end[times]):
            highest = max(highest, weight * log_p[i] - times * volume)
        first = end[times]
    often, index, log_weight = np.empty_like(cell), np.empty_like(cell), np.empty_like(log_p)
    found = first = 0
    for times in range(len(end)):
        for i in range(first, end[times]):
            share = weight * log_p[i] + (-times * volume - highest)
            if share > -negligible:
                often[found], index[found], log_weight[found] = times, cell[i], share
                found += 1
        first = end[times]
    return often[:found], index[:found], log_weight[:found], highest
