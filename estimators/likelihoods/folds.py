"""Parts of the training readings that are predicted from the others: what a model says of places it was not shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan, transform
from tactsim.core.compiling import Bools1D, Ints1D, Reals1D, compiled
from tactsim.core.poses import FloatArray

# As many parts; each is predicted from the rest.
FOLDS = 4
# mm; presses that are as near as that are at one position and belong to one part.
_APART = 1.0
# mm and rad; poses that are as near as that are the same.
_SAME = 1e-6
# Levels of load that are told apart.
_LEVELS, _COMMON = 4, 0.1
_LETTERS = 6  # more are not needed to learn one number
# mm; a place is known if a taxel lay as near as that.
_NEAR = 1.0


def by_letter(divide: Callable[[Scan], NDArray[np.intp]], train: Scan) -> NDArray[np.intp]:
    """Divide the training readings of each letter by itself: (readings,)."""
    part = np.empty(len(train), dtype=np.intp)
    for label in train.letters:
        part[train.labels == label] = divide(train.where(label=label))
    return part


def parts_of_presses(train: Scan) -> NDArray[np.intp]:
    """Divide the presses of each letter into FOLDS parts, wherever they were made: (readings,)."""
    return by_letter(
        lambda own: np.unique(own.press_numbers, return_inverse=True)[1].reshape(-1) % FOLDS, train
    )


def _pressed(train: Scan) -> tuple[FloatArray, NDArray[np.intp]]:
    """Give the poses of the presses (p, 3), in the middle of their readings, and of which press each reading is (n,).

    A press has several readings if its image was cut into windows, or if several of its moments were taken.
    """
    if train.presses is None:
        return train.poses, np.arange(len(train))
    _, first, which = np.unique(train.presses, return_index=True, return_inverse=True)
    which, count = which.reshape(-1), np.bincount(which.reshape(-1))
    middle = [np.round(np.bincount(which, train.poses[:, axis]) / count, 9) for axis in (0, 1)]
    return np.column_stack([*middle, train.poses[first, 2]]), which


def some_labels(train: Scan) -> list[str]:
    """Choose six objects at most, from which a number of all is learned, in any order of the scan the same."""
    return sorted(train.letters)[:: math.ceil(len(train.letters) / _LETTERS) or 1]


def can_leave_out(train: Scan) -> bool:
    """Tell whether an object was pressed twice: else no press can be foretold from others."""
    pressed = (train.where(label=label) for label in train.letters)
    return any(len(one if one.presses is None else np.unique(one.presses)) > 1 for one in pressed)


def _at_positions(poses: FloatArray) -> NDArray[np.intp]:
    return np.unique(np.round(poses[:, :2] / _APART), axis=0, return_inverse=True)[1].reshape(-1)


def positions(train: Scan) -> NDArray[np.intp]:
    """Count off the positions at which presses were made: (readings,), from 0."""
    poses, press = _pressed(train)
    return _at_positions(poses)[press]


def as_one(train: Scan, values: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give each taxel of training readings what all that lay just like it say together, taxel after taxel.

    values, weight: (n * taxels,). Taxels lay alike at the same place on the object in the same direction. Those of the
    moments of one press do, of presses of a machine that comes back to a pose, and of touches that were cut from one
    image. In least squares they are as one taxel that has the mean of their values and the sum of their weights. So
    what is looked up without that one is looked up without all of them, as it must be: they are near copies.
    Returns places (n * taxels, 2) mm, values and weights.
    """
    xy = transform(train.poses, train.taxel_xy).reshape(-1, 2)
    which = _alike(np.column_stack([xy, np.repeat(train.poses[:, 2], len(train.taxel_xy))]))
    if which.max(initial=-1) == len(xy) - 1:
        return xy, values, weight
    whole = np.bincount(which, weight).astype(float)
    sums = np.bincount(which, weight * values).astype(float)
    mean = np.divide(sums, whole, out=np.zeros_like(sums), where=whole > 0)
    return xy, mean[which], whole[which]


def _alike(poses: FloatArray) -> NDArray[np.intp]:
    """Give poses (n, 3), places or angles, numbers from 0, the same ones the same: (n,); whole turns do not count."""
    key = np.round(poses / _SAME).astype(np.int64)
    around = np.round(np.mod(poses[:, 2], 2 * np.pi) / _SAME).astype(np.int64)
    key[:, 2] = np.where(around == np.round(2 * np.pi / _SAME), 0, around)
    order = np.lexsort(key.T)  # ten times as fast as `np.unique` of rows
    other = (np.diff(key[order], axis=0) != 0).any(axis=1)
    which = np.empty(len(key), dtype=np.intp)
    which[order] = np.append(0, other).cumsum()[: len(key)]
    return which


def load_levels(poses: FloatArray, readings: FloatArray) -> NDArray[np.intp]:
    """Divide training readings (n, taxels) at poses (n, 3) by their loads: (n,), quarters of the largest at each pose.

    The load of a reading is what its taxels feel together, beside the most that they felt at that pose. So one reading
    a pose is of the highest level whatever it felt, and so are presses of one load that come back to a pose. Levels
    of fewer than a tenth of the readings come of noise, where hardly anything is felt; they count as the highest.
    """
    felt = np.maximum(readings.sum(axis=1), 0)
    which = _alike(poses)
    most = np.zeros(int(which.max(initial=-1)) + 1)
    np.maximum.at(most, which, felt)
    share = np.divide(felt, most[which], out=np.ones_like(felt), where=most[which] > 0)
    level = np.minimum(np.round(_LEVELS * share), _LEVELS).astype(np.intp)
    count = np.bincount(level, minlength=_LEVELS + 1)
    return np.where(count[level] >= _COMMON * len(level), level, _LEVELS)


def _images(train: Scan) -> tuple[FloatArray, FloatArray]:
    """Give each reading the pose of its press (n, 3), and what was felt in all windows of its image together (n, 1).

    The readings of a press that come first at each pose are one image, those that come second another, and so on.
    """
    poses, press = _pressed(train)
    at = press * len(press) + _alike(train.poses)
    order = np.argsort(at, kind="stable")
    number = np.empty(len(at), dtype=np.intp)
    number[order] = np.arange(len(at)) - np.searchsorted(at[order], at[order])
    image = np.unique(press * len(press) + number, return_inverse=True)[1].reshape(-1)
    return poses[press], np.bincount(image, train.readings.sum(axis=1)).astype(float)[image, None]


def loads_of(train: Scan, of_images: bool = False) -> NDArray[np.intp]:
    """Tell the loads of training readings apart: (n,), from 0, the lightest; all 0 if they are of one load.

    They are the shares of its press's load at which each was taken, or without those what was felt at a pose beside the
    most that was felt there. Where poses were found by laying presses over each other, which come to lie at the same
    ones by chance, nothing tells loads apart.

    of_images: whether windows of one image tell its load together; one by itself, which the object hardly reaches,
    feels more and less by chance.
    """
    if train.moments is None and "aligned" in train.meta:
        return np.zeros(len(train), dtype=np.intp)
    if train.moments is None:
        load = by_letter(
            lambda one: load_levels(*(_images(one) if of_images else (one.poses, one.readings))), train
        )
        return np.unique(load, return_inverse=True)[1].reshape(-1)
    return np.unique(np.round(train.moments, 6), return_inverse=True)[1].reshape(-1)


def folds(train: Scan) -> NDArray[np.intp]:
    """Divide training readings into at most FOLDS parts by the positions of their presses: (readings,), from 0.

    Presses at one position share more than the map: what lies under the rim, how the pad tilts. So a press says
    little of a press elsewhere unless all presses at its own position are left out. Readings of one press, such as
    windows of its image, share how far it was misplaced, too: wherever they are, they are left out together.
    Neighbours go to different parts, so that no large hole is left. If there is one position only, its windows are
    divided by where they lie, and if there are none elsewhere the presses.
    """
    poses, press = _pressed(train)
    part_of = press
    if not _at_positions(poses).any():  # the object was never moved: only windows of its image lie elsewhere
        poses, part_of = train.poses, np.arange(len(train))
    which = _at_positions(poses)
    count = int(which.max()) + 1
    if count == 1:
        return press % FOLDS
    places = np.array([poses[which == number, :2].mean(axis=0) for number in range(count)])
    parts = min(FOLDS, count)
    # mm^2, how near the nearest position of each part is to each position.
    room = np.full((parts, count), np.inf)
    held = np.zeros(parts, dtype=np.intp)
    chosen = np.empty(count, dtype=np.intp)
    most = -(-count // parts)
    for number, position in enumerate(places):
        part = int(np.argmax(np.where(held < most, room[:, number], -1.0)))
        chosen[number] = part
        held[part] += 1
        room[part] = np.minimum(room[part], ((places - position) ** 2).sum(axis=1))
    return chosen[which][part_of]


def presses(train: Scan) -> NDArray[np.intp]:
    """Divide training readings into FOLDS parts, of every position as many presses in each: (readings,), from 0.

    Presses at one position are dealt out by their angle, at the next position beginning with another part. So a press
    is predicted from others at its own position, as far as there are any, and elsewhere.
    """
    poses, press = _pressed(train)
    which = _at_positions(poses)
    order = np.lexsort((poses[:, 2] % (2 * np.pi), which))
    part = np.empty(len(poses), dtype=np.intp)
    part[order] = np.arange(len(poses)) - np.searchsorted(which[order], which[order]) + which[order]
    return part[press] % FOLDS


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Training readings in parts, each of which is predicted from the others.

    part: (n,) from 0. known: (n, taxels) which taxels the other parts say something of, see `touched_elsewhere`.
    """

    part: NDArray[np.intp]
    known: NDArray[np.bool_]

    @classmethod
    def of(cls, train: Scan, divide: Callable[[Scan], NDArray[np.intp]] = folds) -> LeftOut:
        """Divide each letter's training readings by `folds` or `presses`."""
        part = by_letter(divide, train)
        return cls(part, touched_elsewhere(train, part))

    def __iter__(self) -> Iterator[NDArray[np.bool_]]:
        """Give for each part which readings are in it, (n,)."""
        for number in range(int(self.part.max(initial=-1)) + 1):
            yield self.part == number

    def predicted(self, predict: Callable[[NDArray[np.bool_]], FloatArray]) -> FloatArray:
        """Predict all readings (..., n, taxels); predict(gone) gives (..., gone, taxels) of those left out."""
        found: FloatArray | None = None
        for gone in self:
            values = predict(gone)
            if found is None:
                found = np.empty((*values.shape[:-2], *self.known.shape))
            found[..., gone, :] = values
        assert found is not None
        return found


def touched_elsewhere(train: Scan, part: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which taxels of training readings lie where presses of other parts had a taxel too: (n, taxels).

    The others are at the rim of what was felt. Left out, they are not interpolated, as readings within the trained
    range are, but extrapolated, and say nothing of how good the map is. part: (n,) as `folds` divides.
    """
    xy = transform(train.poses, train.taxel_xy)
    near = np.empty(train.readings.shape, dtype=bool)
    for label in train.letters:
        mine = train.labels == label
        x, y = xy[mine].reshape(-1, 2).T
        order = np.argsort(x)
        of_taxel = np.repeat(part[mine], len(train.taxel_xy))
        found = np.empty(len(x), dtype=bool)
        found[order] = near_another_part(x[order], y[order], of_taxel[order], _NEAR)
        near[mine] = found.reshape(-1, len(train.taxel_xy))
    return near


@compiled()
def near_another_part(x: Reals1D, y: Reals1D, part: Ints1D, near: float) -> Bools1D:
    """Tell which points (n,) lie less than `near` from a point of another part.

    x, y: (n,), in order of x. part: (n,).
    """
    count = len(x)
    found = np.zeros(count, dtype=np.bool_)
    for i in range(count):
        for step in (-1, 1):
            j = i + step
            while not found[i] and 0 <= j < count and abs(x[j] - x[i]) < near:
                found[i] = part[j] != part[i] and (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 < near**2
                j += step
    return found
