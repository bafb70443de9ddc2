"""Cells of a grid of different sizes, the best of which are halved in x, y and angle, again and again (compiled)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.compiling import Ints1D, Ints2D, Reals1D, Reals2D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.kernels import Sampled, Terms, replay
from tactsim.estimators.filters.grid import StateGrid


class History(NamedTuple):
    """All readings so far, as `replay` takes them: their terms, the tables, and how many readings there are."""

    terms: Terms
    sampled: Sampled
    readings: int


class Bins(NamedTuple):
    """The grid that is halved: its columns, rows and angles, and the spacing of its bins, mm, mm, rad; centred at 0."""

    counts: Ints1D
    spacing: Reals1D


class Halved(NamedTuple):
    """Cells that were halved: those of a grid, of halves, of halves of halves, ...

    number: (sizes,) how many cells of each size. cell: (sizes, n) ascending, flat index into the (letters, angles,
    rows, columns) of the grid of that size. half: (sizes, 8 * n) eight for each cell, into the grid of half the size.
    log_p: (sizes, 8 * n) their log-beliefs. Only the first `number` cells of a size are filled.
    """

    number: Ints1D
    cell: Ints2D
    half: Ints2D
    log_p: Reals2D


class Limits(NamedTuple):
    """How far cells are halved.

    cells: of one size that are halved, at most. least, most: how often. enough: once cells were halved `least` times
    and the smallest hold the belief in more than so many (effective sample size), they are small enough. skip: whether
    halves that were known at the reading before take in the last reading only.
    """

    cells: int
    least: int
    most: int
    enough: float
    skip: bool


def blank_halved(limits: Limits) -> Halved:
    """Make room for the cells that are halved, none so far."""
    sizes, cells = limits.most, limits.cells
    return Halved(
        np.zeros(sizes, dtype=np.int64),
        np.zeros((sizes, cells), dtype=np.int64),
        np.zeros((sizes, 8 * cells), dtype=np.int64),
        np.zeros((sizes, 8 * cells)),
    )


@compiled(called_from_python=False)
def unravelled(index: int, columns: int, rows: int, angles: int) -> tuple[int, int, int, int]:
    """Find letter, angle, row and column of a flat index into the (letters, angles, rows, columns) of a grid."""
    rest, column = divmod(index, columns)
    rest, row = divmod(rest, rows)
    letter, angle = divmod(rest, angles)
    return letter, angle, row, column


@compiled()
def middles(state: Reals2D, letter: Ints1D, times: Ints1D, index: Ints1D, bins: Bins) -> None:
    """Find T_R^O in the middle of cells, and their letters; fills state (3, n) mm, mm, rad, and letter (n,).

    times: (n,) how often bins of a grid were halved. index: (n,) flat, into the (letters, angles, rows, columns) of the
    grid so halved.
    """
    counts, spacing = bins.counts, bins.spacing
    for k in range(len(index)):
        columns, rows, angles = counts[0] << times[k], counts[1] << times[k], counts[2] << times[k]
        letter[k], angle, row, column = unravelled(index[k], columns, rows, angles)
        size = 0.5 ** times[k]
        state[0, k] = (column + 0.5 - columns / 2) * size * spacing[0]
        state[1, k] = (row + 0.5 - rows / 2) * size * spacing[1]
        state[2, k] = (angle + 0.5 - angles / 2) * size * spacing[2]


@compiled(called_from_python=False)
def halve(half: Ints1D, state: Reals2D, letter: Ints1D, cell: Ints1D, times: int, bins: Bins) -> None:
    """Find the eight halves of each of n cells, their middles and their letters.

    cell: flat indices into a grid that was halved `times` times. Fills half (8 * n,), flat indices into the grid halved
    once more, state (3, 8 * n) and letter (8 * n,). A cell is found once for all its halves: divisions take long.
    """
    columns, rows, angles = bins.counts[0] << times, bins.counts[1] << times, bins.counts[2] << times
    size = 0.5 ** (times + 1)
    for i in range(len(cell)):
        of_letter, angle, row, column = unravelled(cell[i], columns, rows, angles)
        for part in range(8):
            k, x, y, turn = (
                8 * i + part,
                2 * column + (part & 1),
                2 * row + (part >> 1 & 1),
                2 * angle + (part >> 2),
            )
            half[k] = ((of_letter * 2 * angles + turn) * 2 * rows + y) * 2 * columns + x
            letter[k] = of_letter
            state[0, k] = (x + 0.5 - columns) * size * bins.spacing[0]
            state[1, k] = (y + 0.5 - rows) * size * bins.spacing[1]
            state[2, k] = (turn + 0.5 - angles) * size * bins.spacing[2]


@compiled(called_from_python=False)
def evaluate(now: Halved, before: Halved, times: int, skip: bool, history: History, bins: Bins) -> int:
    """Find the log-beliefs of the halves of all cells of one size, and return how many of the cells were known.

    Those of cells that were halved at the reading before, too, take in the last reading only, if `skip`.
    """
    number, known, readings = now.number[times], 0, history.readings
    cell, half, log_p = now.cell[times, :number], now.half[times], now.log_p[times]
    # Where each cell is among those of the reading before; both are ascending.
    place, there = np.full(number, -1), 0
    if skip:
        for i in range(number):
            while there < before.number[times] and before.cell[times, there] < cell[i]:
                there += 1
            if there < before.number[times] and before.cell[times, there] == cell[i]:
                place[i] = there
                known += 1
    for old in range(2):
        these = np.flatnonzero((place >= 0) == (old == 1))
        parts, total = np.empty(8 * len(these), dtype=np.int64), np.zeros((1, 8 * len(these)))
        letter, state = np.empty_like(parts), np.empty((3, len(parts)))
        halve(parts, state, letter, cell[these], times, bins)
        if old:
            for k in range(len(parts)):
                total[0, k] = before.log_p[times, 8 * place[these[k // 8]] + k % 8]
        replay(total, state, letter, history.terms, readings - 1 if old else 0, readings, history.sampled)
        for k in range(len(parts)):
            i = 8 * these[k // 8] + k % 8
            half[i], log_p[i] = parts[k], total[0, k]
    return known


@compiled(called_from_python=False)
def effective(log_p: Reals1D, weight: float) -> float:
    """Give the effective sample size of log-weights (n,), each times a weight; 0 of none."""
    if len(log_p) == 0:
        return 0.0
    highest, total, squares = log_p.max(), 0.0, 0.0
    for value in log_p:
        share = math.exp(weight * (value - highest))
        total += share
        squares += share * share
    return total * total / squares


@compiled()
def least_chosen(values: Reals1D, count: int) -> float:
    """Give what the `count` highest values (n,) are all above; -inf if there are no more than so many.

    Values that are equal are all among them, or none is: of letters that look alike none may be preferred. So there may
    be fewer than `count`.
    """
    next_one = len(values) - count - 1
    return -np.inf if next_one < 0 else np.partition(values, next_one)[next_one]


@compiled()
def refine(
    cell: Ints1D,
    log_p: Reals1D,
    limits: Limits,
    weight: float,
    history: History,
    bins: Bins,
    before: Halved,
    now: Halved,
) -> tuple[Ints1D, Ints1D, Reals1D, int, int]:
    """Halve the best of cells, the best of their halves, and so on.

    cell, log_p: (n,) bins of a grid and their log-beliefs after all readings, each of which counts `weight`. before:
    what was halved at the reading before; now: is overwritten with what is halved.

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
        known = evaluate(now, before, times, limits.skip, history, bins)
        evaluated += 8 * ((number - known) * history.readings + known)
        unreplayed += 8 * known * (history.readings - 1)
        end[times] = filled
        cell, log_p = now.half[times, : 8 * number], now.log_p[times, : 8 * number]
        times += 1
    left[filled : filled + len(cell)], left_log_p[filled : filled + len(cell)] = cell, log_p
    filled += len(cell)
    end[times] = filled
    return end[: times + 1], left[:filled], left_log_p[:filled], evaluated, unreplayed


@compiled()
def heaviest(end: Ints1D, log_p: Reals1D, weight: float) -> float:
    """Give the log of what the cell holds that holds most, of those that `refine` left."""
    highest, first = -np.inf, 0
    for times in range(len(end)):
        for i in range(first, end[times]):
            highest = max(highest, weight * log_p[i] - times * math.log(8.0))
        first = end[times]
    return highest


@compiled()
def held(
    end: Ints1D, cell: Ints1D, log_p: Reals1D, weight: float, negligible: float
) -> tuple[Ints1D, Ints1D, Reals1D]:
    """List the cells that `refine` left and that hold a part of the belief.

    A cell holds its likelihood, log_p times `weight`, times its volume. Those `negligible` nats or more below the
    one that holds most are left out. Returns how often each was halved, flat indices, and logs of what they hold, less
    that of the one that holds most (n,).
    """
    volume, highest = math.log(8.0), heaviest(end, log_p, weight)
    often, index, log_weight = np.empty_like(cell), np.empty_like(cell), np.empty_like(log_p)
    found = first = 0
    for times in range(len(end)):
        for i in range(first, end[times]):
            share = weight * log_p[i] + (-times * volume - highest)
            if share > -negligible:
                often[found], index[found], log_weight[found] = times, cell[i], share
                found += 1
        first = end[times]
    return often[:found], index[:found], log_weight[:found]


def bins_of(grid: StateGrid) -> Bins:
    """Give a grid as compiled code reads it."""
    return Bins(np.array([grid.x, grid.y, grid.angle]), np.array(grid.spacing))


@dataclass(frozen=True, eq=False)
class Cells:
    """Some cells. times: (n,) how often bins of `grid` were halved for them.

    index: (n,) flat, into the (letters, angles, rows, columns) of the grid so halved.
    """

    grid: StateGrid
    times: NDArray[np.int64]
    index: NDArray[np.int64]

    def some(self, chosen: NDArray[np.intp]) -> Cells:
        """Keep some cells."""
        return Cells(self.grid, self.times[chosen], self.index[chosen])

    @cached_property
    def letter(self) -> NDArray[np.int64]:
        """Give the number of each cell's letter (n,)."""
        letter: NDArray[np.int64] = self.index // (self.grid.bins << 3 * self.times)
        return letter

    @cached_property
    def states(self) -> FloatArray:
        """Give T_R^O (3, n), mm, mm, rad, of the cells' centroids."""
        grid, letter, state = self.grid, np.empty_like(self.index), np.empty((3, len(self.index)))
        middles(state, letter, self.times, self.index, bins_of(grid))
        return state

    @property
    def size(self) -> FloatArray:
        """Give each cell's size in x, y and angle (3, n), mm, mm, rad."""
        return np.array(self.grid.spacing)[:, None] * 0.5**self.times

    def bins(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Find the angle, row and column (n,) of the grid's bin in which each cell lies."""
        first = np.array([[axis[0]] for axis in self.grid.centres])
        column, row, angle = np.rint((self.states - first) / np.array(self.grid.spacing)[:, None]).astype(
            np.int64
        )
        return angle, row, column
