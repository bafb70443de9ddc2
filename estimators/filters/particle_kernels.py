"""The inner loops of the particle filter: independent draws in proportion to weights, and the command update."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core.compiling import Bools1D, Ints1D, Reals1D, Reals2D, compiled
from tactsim.core.poses import FloatArray


@compiled()
def draw(chosen: Ints1D, weight: Reals1D, spacing: Reals1D) -> None:
    """Choose indices with probability proportional to their weights, with replacement; ascending.

    chosen: (draws,) is overwritten. weight: (n,). spacing: (draws + 1,) exponential random numbers: their running sums,
    as shares of the sum of all, are uniform numbers in ascending order, so that nothing needs to be sorted (Devroye
    1986, section V.3.1).
    """
    share, last = weight.sum() / spacing.sum(), len(weight) - 1
    index, filled, reached = 0, weight[0], 0.0
    for i in range(len(chosen)):
        reached += spacing[i] * share
        while reached >= filled and index < last:
            index += 1
            filled += weight[index]
        chosen[i] = index


@compiled()
def move(
    state: Reals2D, before: Reals2D, chosen: Ints1D, normal: Reals2D, noise: Reals1D, reach: float
) -> None:
    """Copy the chosen states and corrupt them with noise (command update); x and y stay within reach.

    state: (3, draws) T_R^O is overwritten. before: (3, n). chosen: (draws,) indices into it. normal: (3, draws) normal
    random numbers of deviation 1. noise: (3,) standard deviations, mm, mm, rad. reach: mm.
    """
    for axis in range(3):
        limit = reach if axis < 2 else math.inf
        for i in range(len(chosen)):
            moved = before[axis, chosen[i]] + noise[axis] * normal[axis, i]
            state[axis, i] = min(max(moved, -limit), limit)


# The grid on which the paper evaluates the density of eq. 11: mm, mm, rad.
PARZEN_STEP = np.array([0.5, 0.5, 0.04 * np.pi])
TURN = 50  # of its nodes in a circle
# Particles with less than this share of the mean weight hold together less than this share of all weight.
_LIGHT = 0.01
# Upper bounds are raised by this share, so that rounding does not matter.
_ROUNDING = 1e-9
# Columns along a side of an array of bounds, 0.5 m: the paper's poses fit into one array.
_LARGEST = 1000


def parzen_mode(
    state: FloatArray, weight: FloatArray, rho: float = 1.0, skip: bool = True
) -> tuple[FloatArray, int]:
    """Find the pose of highest density (eq. 10 to 12) on the grid of 0.5 mm and 0.04 pi rad.

    state: (3, n) mm, mm, rad. weight: (n,) from 0, not all 0. Of equally high nodes the first counts, by y, x, angle.
    Also returns how many particles were skipped.

    A column is all nodes of one x and y. Nowhere in it is the density higher than if all particles had the node's
    angle; of light particles, which are most of them, all weight is taken. Columns are summed in the order of these
    upper bounds, until a bound is below the highest node; particles that reach none of them are skipped. skip=False:
    all columns are summed.
    """
    state, weight = np.ascontiguousarray(state), weight / weight.max()
    is_light = weight < (_LIGHT * weight.mean() if skip else 0.0)
    heavy, light = np.flatnonzero(~is_light), float(weight @ is_light)
    columns, bounds = _columns(state[:2].take(heavy, axis=1), weight[heavy], rho)
    density, summed = np.empty(TURN), np.zeros(len(weight), dtype=np.bool_)
    best, node = 0.0, (0, 0, 0)
    for k in np.argsort(-bounds).tolist():
        if skip and (bounds[k] + light) * (1 + _ROUNDING) < best:
            break
        column, row = columns[k].tolist()
        sum_column(density, summed, columns[k] * PARZEN_STEP[:2], state, weight, rho)
        angle = int(density.argmax())
        here = row, column, angle
        if density[angle] > best or (density[angle] == best > 0 and here < node):
            best, node = float(density[angle]), here
    if light > 0 and best <= light:  # the highest node may be in a column that light particles alone reach
        return parzen_mode(state, weight, rho, skip=False)
    if best == 0:  # no particle reaches a node
        column, row, angle = np.rint(state[:, weight.argmax()] / PARZEN_STEP).astype(np.int64).tolist()
        node = row, column, angle % TURN
    row, column, angle = node
    pose = PARZEN_STEP * [column, row, angle if 2 * angle < TURN else angle - TURN]
    return pose, int(np.count_nonzero(~summed)) if skip else 0


def _columns(place: FloatArray, weight: FloatArray, rho: float) -> tuple[NDArray[np.int64], FloatArray]:
    """List the columns [x, y] (m, 2), in steps of the grid, that particles reach, and their upper bounds (m,).

    place: (2, n) mm, weight: (n,). Particles that lie far apart are split into two parts. A column near the cut is then
    listed twice, once with all its particles.
    """
    lowest, highest = place.min(axis=1), place.max(axis=1)
    first = np.floor((lowest - rho) / PARZEN_STEP[:2]).astype(np.int64)
    size = np.floor((highest + rho) / PARZEN_STEP[:2]).astype(np.int64) - first + 2
    if size.max() > _LARGEST:
        axis = int(size.argmax())
        cut = (lowest[axis] + highest[axis]) / 2
        parts = place[axis] < cut + rho, place[axis] > cut - rho
        listed = [_columns(place[:, part], weight[part], rho) for part in parts]
        return np.concatenate([columns for columns, _ in listed]), np.concatenate(
            [bound for _, bound in listed]
        )
    bound = np.zeros(size[::-1])
    add_bounds(bound, np.ascontiguousarray(place), weight, first, rho)
    y, x = np.divmod(np.flatnonzero(bound), size[0])
    return np.stack([x, y], axis=1) + first, bound[y, x]


@compiled(ordered=False)
def add_bounds(bound: Reals2D, place: Reals2D, weight: Reals1D, first: Ints1D, rho: float) -> None:
    """Add the weighted cones of particles to the upper bounds of columns, as if they had the angle of each node.

    bound: (rows, columns) from the node first = [column, row], before all that a cone reaches, to one after them.
    place: (2, n) mm. weight: (n,). rho: mm and rad.
    """
    step = PARZEN_STEP[0]  # in x as in y
    radius = rho / step
    wide = math.ceil(2 * radius)
    for i in range(len(weight)):
        x, y = place[0, i] / step - first[0], place[1, i] / step - first[1]
        left, low = int(x - radius) + 1, int(y - radius) + 1
        for row in range(low, low + wide):
            for column in range(left, left + wide):
                away = math.sqrt((column - x) ** 2 + (row - y) ** 2)
                bound[row, column] += weight[i] * max(0.0, 1 - away / radius)


@compiled(ordered=False)
def sum_column(
    density: Reals1D, summed: Bools1D, column: Reals1D, state: Reals2D, weight: Reals1D, rho: float
) -> None:
    """Sum the weighted cones (eq. 10, 11) of particles at the nodes of a column, around the circle.

    density: (TURN,) is overwritten. summed: (n,) becomes true for the particles that reach the column. column: [x, y]
    mm. state: (3, n) mm, mm, rad. weight: (n,). The distance of eq. 10 counts mm and rad alike.
    """
    density[:] = 0
    step = PARZEN_STEP[2]
    for i in range(len(weight)):
        square = (state[0, i] - column[0]) ** 2 + (state[1, i] - column[1]) ** 2
        if square < rho * rho:
            summed[i] = True
            turn, reach = state[2, i] / step, math.sqrt(rho * rho - square) / step
            for k in range(math.ceil(turn - reach), math.floor(turn + reach) + 1):
                away = math.sqrt(square + ((k - turn) * step) ** 2)
                density[k % TURN] += weight[i] * max(0.0, 1 - away / rho)
