"""Where the object is, from weighted states: the posterior mean around a mode, and samples of cells (compiled)."""

from __future__ import annotations

import math

import numpy as np

from tactsim.core.compiling import Reals1D, Reals2D, compiled

# The mean is over states whose placement is at most this far from the mode's: mm, in the metric of the placement
# error for a radius of gyration of 8 mm. Only the choice of the neighbourhood depends on that radius.
_NEAR, _GYRATION = 1.0, 8.0
# A belief is resolved along an axis if its variance in so many cells either way is this many squares of a cell's size:
# a normal density then is no narrower than .35 of a cell, and the moments over the cells' middles are its own to some
# per cent, in the mean of how it lies among them.
_NEIGHBOURS, _RESOLVED = 3, 1 / 8
# The mode's own weight may underflow beside a heavier state elsewhere.
_TINY = float(np.finfo(float).tiny)


@compiled(called_from_python=False)
def _wrapped(angle: float) -> float:
    """Fold an angle into [-pi, pi), as `core.wrap_angle` does."""
    folded = (angle + math.pi) % (2 * math.pi) - math.pi
    return folded if folded < math.pi else -math.pi


@compiled(called_from_python=False)
def inverse(x: float, y: float, angle: float) -> tuple[float, float, float]:
    """Invert a transform, as `core.invert` does."""
    cos, sin = math.cos(angle), math.sin(angle)
    return -cos * x - sin * y, sin * x - cos * y, _wrapped(-angle)


@compiled()
def placements(state: Reals2D) -> Reals2D:
    """Invert states T_R^O (3, n) mm, mm, rad: T_O^R (3, n)."""
    place = np.empty_like(state)
    for k in range(state.shape[1]):
        place[0, k], place[1, k], place[2, k] = inverse(state[0, k], state[1, k], state[2, k])
    return place


@compiled()
def mean_around(state: Reals2D, weight: Reals1D, mode: int) -> Reals1D:
    """Average the object's placement over the states near the one of index `mode`: robot_in_object (3,).

    state: (3, n) T_R^O mm, mm, rad of one letter. weight: (n,) of any unit. Placements, not states, are averaged,
    because a turn moves the state of the same placement. The angle's mean leaves out what is turned away,
    because a symmetric letter has copies that are as probable; the position's mean does not, because they
    say as much about where the letter is, and for an O all angles do.
    """
    mode_x, mode_y, mode_angle = inverse(state[0, mode], state[1, mode], state[2, mode])
    total = sum_x = sum_y = near = near_turn = 0.0
    for k in range(len(weight)):
        x, y, angle = inverse(state[0, k], state[1, k], state[2, k])
        away = (x - mode_x) ** 2 + (y - mode_y) ** 2
        if away <= _NEAR**2:
            share, turn = max(weight[k], _TINY), _wrapped(angle - mode_angle)
            total += share
            sum_x += share * x
            sum_y += share * y
            if away + (_GYRATION * turn) ** 2 <= _NEAR**2:
                near += share
                near_turn += share * turn
    return np.array(inverse(sum_x / total, sum_y / total, mode_angle + near_turn / near))


@compiled(called_from_python=False)
def _unresolved(state: Reals2D, weight: Reals1D, size: Reals2D, densest: int) -> Reals1D:
    """Tell along which axes a belief is no wider than its cells are: (3,), 1 there and 0 elsewhere.

    Looks at the cells of the densest one's size that are at most three cells from it along every axis. Arguments as for
    `samples_of_cells`.
    """
    total, first, second = 0.0, np.zeros(3), np.zeros(3)
    away, reach = np.empty(3), _NEIGHBOURS + 0.5
    for k in range(len(weight)):
        if size[0, k] != size[0, densest]:
            continue
        away[0] = (state[0, k] - state[0, densest]) / size[0, k]
        away[1] = (state[1, k] - state[1, densest]) / size[1, k]
        if abs(away[0]) < reach and abs(away[1]) < reach:
            away[2] = _wrapped(state[2, k] - state[2, densest]) / size[2, k]
            if abs(away[2]) < reach:
                total += weight[k]
                for axis in range(3):
                    first[axis] += weight[k] * away[axis]
                    second[axis] += weight[k] * away[axis] ** 2
    unresolved = np.empty(3)
    for axis in range(3):
        unresolved[axis] = second[axis] / total - (first[axis] / total) ** 2 < _RESOLVED
    return unresolved


@compiled()
def samples_of_cells(
    state: Reals2D, weight: Reals1D, size: Reals2D, corners: Reals2D, spread: float
) -> tuple[Reals2D, Reals1D]:
    """List poses that stand for cells: the middle of one that weighs at most `spread`, eight poses of another.

    Cells as small as the densest one keep to their middle along an axis along which they resolve the belief: sums over
    the middles are nearly exact there, and the width of the cells is no part of the belief's. state, size: (3, n) the
    cells' middles and sizes, mm, mm, rad. weight: (n,). corners: (8, 3) where the poses of a cell lie, in units of its
    size. Returns poses (m, 3) and weights (m,).
    """
    densest = (weight / (size[0] * size[1] * size[2])).argmax()
    blurred = _unresolved(state, weight, size, densest)
    smallest = size[0] == size[0, densest]
    whole = (weight <= spread) | (smallest & (blurred.sum() == 0))
    heavy = len(weight) - whole.sum()
    parts = len(corners)
    light, part = 0, len(weight) - heavy
    poses, share = np.empty((part + parts * heavy, 3)), np.empty(part + parts * heavy)
    for k in range(len(weight)):
        if whole[k]:
            for axis in range(3):
                poses[light, axis] = state[axis, k]
            share[light] = weight[k]
            light += 1
        else:
            for corner in corners:
                for axis in range(3):
                    width = size[axis, k] * blurred[axis] if smallest[k] else size[axis, k]
                    poses[part, axis] = state[axis, k] + width * corner[axis]
                share[part] = weight[k] / parts
                part += 1
    return poses, share
