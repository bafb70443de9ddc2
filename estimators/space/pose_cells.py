"""Cells of poses about a touched place: which object, which rotation, and which of its points lies there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.space.rotation_cells import ACROSS, middles, volumes

# A cell is one whole number: label, cube, its place in the cube and its voxel, with so many bits each.
_LABEL, _CUBE, _PLACE, _VOXEL = 7, 2, 8, 10
MOST_LABELS = 2**_LABEL
MOST_PLACES, MOST_VOXELS = 2**_PLACE, 2**_VOXEL
_EVEN = 0.2  # the share of the cells that is divided evenly among objects
_EIGHT = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True)
class CellSizes:
    """How large cells are.

    side: cells along each side of a cube of rotations. voxel: mm. reach: mm; the voxels hold the object's places from
    -reach to reach. box: mm, half the side of the box that the object's origin lies in, about the robot's.
    """

    side: int
    voxel: float
    reach: float
    box: float

    @property
    def turn(self) -> float:
        """Give how far rotations of a cell are turned from its middle about any one axis, rms, rad."""
        return ACROSS / self.side / math.sqrt(12)

    @property
    def shift(self) -> float:
        """Give how far places in a voxel are from its middle along any one axis, rms, mm."""
        return self.voxel / math.sqrt(12)

    def turned(self) -> CellSizes:
        """Halve the turns."""
        return CellSizes(2 * self.side, self.voxel, self.reach, self.box)

    def shifted(self) -> CellSizes:
        """Halve the voxels."""
        return CellSizes(self.side, self.voxel / 2, self.reach, self.box)


def check_room(labels: Sequence[int], sizes: CellSizes, halvings: int) -> None:
    """Raise InputError if cells of these labels and sizes, halved so often, are more than can be numbered."""
    finer = 2**halvings
    for what, count, most, advice in (
        ("objects that differ", max(labels) + 1, MOST_LABELS, "train on fewer objects"),
        (
            "cells along a cube of rotations",
            sizes.side * finer,
            MOST_PLACES,
            "choose smaller rotations or halvings",
        ),
        (
            "voxels along the largest object",
            math.ceil(2 * sizes.reach / sizes.voxel) * finer,
            MOST_VOXELS,
            "choose a larger voxel or fewer halvings",
        ),
    ):
        if count > most:
            raise InputError(f"{count:,} {what} are more than the {most:,} that cells can number; {advice}")


def packed(
    label: int, cube: NDArray[np.int64], place: NDArray[np.int64], voxel: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Make the numbers of cells (n,) of one label: cube (n,), place (n, 3) and voxel (n, 3)."""
    number = np.full(len(cube), label, dtype=np.int64) << _CUBE | cube
    for part, bits in ((place, _PLACE), (voxel, _VOXEL)):
        for axis in range(3):
            number = number << bits | part[:, axis]
    return number


def label_of(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the labels (n,) of cells."""
    return cell >> (_CUBE + 3 * _PLACE + 3 * _VOXEL)


def _parts(cell: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Give cube (n,), place (n, 3), voxel (n, 3)."""
    voxel = np.stack([cell >> axis * _VOXEL & MOST_VOXELS - 1 for axis in (2, 1, 0)], axis=1)
    rest = cell >> 3 * _VOXEL
    place = np.stack([rest >> axis * _PLACE & MOST_PLACES - 1 for axis in (2, 1, 0)], axis=1)
    return rest >> 3 * _PLACE & 2**_CUBE - 1, place, voxel


def turned_halves(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the eight cells (n, 8) of half the turns in each cell (n,)."""
    cube, place, voxel = _parts(cell)
    place = (2 * place[:, None] + _EIGHT).reshape(-1, 3)
    return _children(cell, cube, place, np.repeat(voxel, 8, axis=0))


def shifted_halves(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the eight cells (n, 8) of half the voxel in each cell (n,)."""
    cube, place, voxel = _parts(cell)
    voxel = (2 * voxel[:, None] + _EIGHT).reshape(-1, 3)
    return _children(cell, cube, np.repeat(place, 8, axis=0), voxel)


def _children(
    cell: NDArray[np.int64], cube: NDArray[np.int64], place: NDArray[np.int64], voxel: NDArray[np.int64]
) -> NDArray[np.int64]:
    label = label_of(cell) << 3 * (_PLACE + _VOXEL) + _CUBE
    return np.repeat(label, 8).reshape(-1, 8) | packed(0, np.repeat(cube, 8), place, voxel).reshape(-1, 8)


def poses_of(cell: NDArray[np.int64], sizes: CellSizes, anchor: FloatArray) -> FloatArray:
    """Give object_in_robot (n, 7) in the middles of cells: the voxel's middle lies at the anchor (3,) mm."""
    cube, place, voxel = _parts(cell)
    rotation = middles(cube, place, sizes.side)
    touched = (voxel + 0.5) * sizes.voxel - sizes.reach
    return np.concatenate([anchor - rigid.turned(rotation, touched), rotation], axis=1)


def log_prior(cell: NDArray[np.int64], poses: FloatArray, sizes: CellSizes, slack: float = 0.0) -> FloatArray:
    """Give the log of the prior probability (n,) of cells: even over rotations and over the box of origins.

    poses: (n, 7), as `poses_of` gives them; -inf where the origin is more than `slack` mm outside of the box.
    """
    _, place, _ = _parts(cell)
    held = np.log(volumes(place, sizes.side)) + 3 * math.log(sizes.voxel / (2 * sizes.box))
    inside = np.abs(poses[:, :3]).max(axis=1, initial=0.0) <= sizes.box + slack
    return np.where(inside, held, -np.inf)


def shared(log_mass: FloatArray, cell: NDArray[np.int64]) -> FloatArray:
    """Give log-masses (n,) by which cells (n,) are to be chosen, so that no object loses all of its cells.

    The masses come from a quick look, which may be wrong by several nats: a part of their sum is shared evenly among
    the objects that have any.
    """
    labels = label_of(cell)
    finite = log_mass > -np.inf
    if not finite.any():
        return log_mass
    mass = np.exp(log_mass - log_mass[finite].max())
    held = np.bincount(labels, mass)
    there = np.count_nonzero(held)
    gain = 1 - _EVEN + _EVEN * held.sum() / there / np.where(held > 0, held, 1.0)
    return np.where(finite, log_mass + np.log(gain)[labels], -np.inf)


def thinned(log_mass: FloatArray, count: int, offset: float = 0.5) -> tuple[NDArray[np.intp], FloatArray]:
    """Keep at most `count` of n masses, so that sums stay what they are: which, ascending, and the logs of factors.

    The larger ones stay as they are; of the others some stand for all (Fearnhead and Clifford 2003): chosen evenly
    along the sum in the given order from `offset` (of a step, 0 to 1) on, they all get the same mass.
    """
    there = np.flatnonzero(log_mass > -np.inf)
    if len(there) <= count:
        return there, np.zeros(len(there))
    mass = np.exp(log_mass[there] - log_mass[there].max())
    order = np.argsort(-mass, kind="stable")
    rest = np.cumsum(mass[order][::-1])[::-1]
    limit = rest[:count] / (count - np.arange(count))
    kept = int(np.argmax(mass[order[:count]] < limit)) if (mass[order[:count]] < limit).any() else count
    large = order[:kept]
    if kept == count:
        return there[np.sort(large)], np.zeros(count)
    small = np.sort(order[kept:])
    reached = np.cumsum(mass[small])
    step = reached[-1] / (count - kept)
    chosen = small[
        np.minimum(np.searchsorted(reached, (np.arange(count - kept) + offset) * step), len(small) - 1)
    ]
    which = np.concatenate([large, chosen])
    factor = np.concatenate([np.zeros(kept), np.log(step / mass[chosen])])
    order = np.argsort(which, kind="stable")
    return there[which[order]], factor[order]
