"""Parts of the training readings that are predicted from the others: what a model says of places it was not shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray

# As many parts; each is predicted from the rest.
FOLDS = 4
# mm; presses that are as near as that are at one position and belong to one part.
_APART = 1.0
# mm and rad; poses that are as near as that are the same.
_SAME = 1e-6
# mm; a place is known if a taxel lay as near as that.
_NEAR = 1.0


def by_letter(divide: Callable[[FloatArray], NDArray[Any]], train: Scan) -> NDArray[Any]:
    """Apply a function of poses (n, 3) to the training readings of each letter by itself: (readings,)."""
    result = np.empty(len(train), dtype=divide(train.poses[:1]).dtype)
    for label in train.letters:
        mine = train.labels == label
        result[mine] = divide(train.poses[mine])
    return result


def positions(poses: FloatArray) -> NDArray[np.intp]:
    """Count off the positions at which presses at poses (n, 3) were made: (n,), from 0."""
    return np.unique(np.round(poses[:, :2] / _APART), axis=0, return_inverse=True)[1].reshape(-1)


def as_one(poses: FloatArray, values: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give each of n readings what all readings at its very pose say together: values and weights (n, taxels).

    The moments of one press, and the presses of a machine that comes back to a pose, are at one pose. In least squares
    they are as one reading that has the mean of their values and the sum of their weights. So what is looked up without
    that one reading is looked up without all of them, as it must be: they are near copies.
    """
    pose, which = np.unique(np.round(poses / _SAME), axis=0, return_inverse=True)
    if len(pose) == len(poses):
        return values, weight
    which = which.reshape(-1)
    sums = np.zeros((2, len(pose), values.shape[1]))
    np.add.at(sums[0], which, weight)
    np.add.at(sums[1], which, weight * values)
    mean = np.divide(sums[1], sums[0], out=np.zeros_like(sums[1]), where=sums[0] > 0)
    return mean[which], sums[0][which]


def folds(poses: FloatArray) -> NDArray[np.intp]:
    """Divide training presses at poses (n, 3) into at most FOLDS parts by position: (n,), from 0.

    Presses at one position share more than the map: what lies under the rim, how the pad tilts. So a press says
    little of a press elsewhere unless all presses at its own position are left out. Neighbours go to different parts,
    so that no large hole is left. If there is one position only, presses are divided.
    """
    which = positions(poses)
    count = int(which.max()) + 1
    if count == 1:
        return np.arange(len(poses)) % FOLDS
    places = np.array([poses[which == number, :2].mean(axis=0) for number in range(count)])
    parts: list[list[FloatArray]] = [[] for _ in range(min(FOLDS, count))]
    chosen = np.empty(count, dtype=np.intp)
    most = -(-count // len(parts))
    for number, position in enumerate(places):
        room = [
            np.min([((other - position) ** 2).sum() for other in part], initial=np.inf)
            if len(part) < most
            else -1.0
            for part in parts
        ]
        chosen[number] = int(np.argmax(room))
        parts[chosen[number]].append(position)
    return chosen[which]


def presses(poses: FloatArray) -> NDArray[np.intp]:
    """Divide training presses at poses (n, 3) into FOLDS parts, of every position as many in each: (n,), from 0.

    Presses at one position are dealt out by their angle, at the next position beginning with another part. So a press
    is predicted from others at its own position, as far as there are any, and elsewhere.
    """
    which = positions(poses)
    order = np.lexsort((poses[:, 2] % (2 * np.pi), which))
    part = np.empty(len(poses), dtype=np.intp)
    part[order] = np.arange(len(poses)) - np.searchsorted(which[order], which[order]) + which[order]
    return part % FOLDS


def touched_elsewhere(train: Scan, part: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which taxels of training readings lie where presses of other parts had a taxel too: (n, taxels).

    The others are at the rim of what was felt. Left out, they are not interpolated, as readings within the trained
    range are, but extrapolated, and say nothing of how good the map is. part: (n,) as `folds` divides.
    """
    from scipy.spatial import cKDTree  # imported here: only a fit needs it

    xy = transform(train.poses, train.taxel_xy)
    near = np.zeros(train.readings.shape, dtype=bool)
    for label in train.letters:
        for number in range(FOLDS):
            mine, rest = (
                (train.labels == label) & (part == number),
                (train.labels == label) & (part != number),
            )
            if mine.any() and rest.any():
                away, _ = cKDTree(xy[rest].reshape(-1, 2)).query(
                    xy[mine].reshape(-1, 2), distance_upper_bound=_NEAR
                )
                near[mine] = np.isfinite(away).reshape(-1, len(train.taxel_xy))
    return near
