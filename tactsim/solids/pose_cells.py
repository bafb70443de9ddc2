"""Cells of poses about a touched place: which object, which rotation, and which of its points lies there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.poses import FloatArray

CUBES = 4  # q and -q are one rotation, so four of a tesseract's eight cubes hold all
ACROSS = np.pi  # rad, how far a cube reaches along each of its axes through its middle


def middles(cube: NDArray[np.int64], place: NDArray[np.int64], side: int) -> FloatArray:
    """Give the rotations, unit quaternions (n, 4), in the middles of cells.

    cube: (n,) which part of the quaternion is the largest. place: (n, 3) from 0 to side - 1, the cell's number along
    each axis of its cube. The axes are angles: equal steps in them are equal turns, as on a cubed sphere (Ronchi et al.
    1996), here in four dimensions.
    """
    tangent = np.tan(((place + 0.5) * (2 / side) - 1) * (np.pi / 4))
    others = (cube[:, None] + np.arange(1, 4)) % 4
    rotation = np.empty((len(cube), 4))
    np.put_along_axis(rotation, cube[:, None], 1.0, axis=1)
    np.put_along_axis(rotation, others, tangent, axis=1)
    return rotation / np.sqrt(1 + (tangent**2).sum(axis=1, keepdims=True))


def volumes(place: NDArray[np.int64], side: int) -> FloatArray:
    """Give the share (n,) of all rotations that cells hold, by the middle's density: exact in the limit of small cells.

    The density of even rotations over the tangents is (1 + |t|^2)^-2; over the angles, each tangent's slope is added.
    The shares of all CUBES * side^3 cells sum to 1 to within 3 % at side 4, and the nearer the larger it is.
    """
    tangent = np.tan(((place + 0.5) * (2 / side) - 1) * (np.pi / 4))
    slope = np.prod(1 + tangent**2, axis=1)
    # Half of the unit sphere in four dimensions has the area pi^2.
    return slope / (1 + (tangent**2).sum(axis=1)) ** 2 * (np.pi / 2 / side) ** 3 / np.pi**2


def every_cell(side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List all CUBES * side^3 cells: cube (n,), place (n, 3)."""
    cube, *place = np.indices((CUBES, side, side, side)).reshape(4, -1)
    return cube, np.stack(place, axis=1)


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
        return replace(self, side=2 * self.side)

    def shifted(self) -> CellSizes:
        """Halve the voxels."""
        return replace(self, voxel=self.voxel / 2)


@dataclass(frozen=True, eq=False)
class PoseCells:
    """n cells of poses. label: (n,) the object. cube (n,), place (n, 3): the rotations, see `middles`.

    voxel: (n, 3) from 0, where on the object the touched place lies.
    """

    label: NDArray[np.int64]
    cube: NDArray[np.int64]
    place: NDArray[np.int64]
    voxel: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.label)

    @classmethod
    def joined(cls, parts: Sequence[PoseCells]) -> PoseCells:
        """Put cells one after another."""
        columns = zip(*((one.label, one.cube, one.place, one.voxel) for one in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    def some(self, which: NDArray[np.intp]) -> PoseCells:
        """Take some of the cells."""
        return PoseCells(self.label[which], self.cube[which], self.place[which], self.voxel[which])

    def turned_halves(self) -> PoseCells:
        """Give the cells of half the turns, the eight of each one after another: (8 n,)."""
        place = (2 * self.place[:, None] + _EIGHT).reshape(-1, 3)
        return replace(self.some(np.repeat(np.arange(len(self)), 8)), place=place)

    def shifted_halves(self) -> PoseCells:
        """Give the cells of half the voxel, the eight of each one after another: (8 n,)."""
        voxel = (2 * self.voxel[:, None] + _EIGHT).reshape(-1, 3)
        return replace(self.some(np.repeat(np.arange(len(self)), 8)), voxel=voxel)

    def poses(self, sizes: CellSizes, anchor: FloatArray) -> FloatArray:
        """Give object_in_robot (n, 7) in the cells' middles: the voxel's middle lies at the anchor (3,) mm."""
        rotation = middles(self.cube, self.place, sizes.side)
        touched = (self.voxel + 0.5) * sizes.voxel - sizes.reach
        return np.concatenate([anchor - rigid.turned(rotation, touched), rotation], axis=1)

    def log_prior(self, poses: FloatArray, sizes: CellSizes, slack: float = 0.0) -> FloatArray:
        """Give the log of the prior probability (n,) of cells: even over rotations and over the box of origins.

        poses: (n, 7), as `poses` gives them; -inf where the origin is more than `slack` mm outside of the box.
        """
        held = np.log(volumes(self.place, sizes.side)) + 3 * math.log(sizes.voxel / (2 * sizes.box))
        inside = np.abs(poses[:, :3]).max(axis=1, initial=0.0) <= sizes.box + slack
        return np.where(inside, held, -np.inf)


def shared(log_mass: FloatArray, label: NDArray[np.int64]) -> FloatArray:
    """Give log-masses (n,) by which cells of objects (n,) are to be chosen, so that no object loses all of its cells.

    The masses come from a quick look, which may be wrong by several nats: a part of their sum is shared evenly among
    the objects that have any.
    """
    finite = log_mass > -np.inf
    if not finite.any():
        return log_mass
    mass = np.exp(log_mass - log_mass[finite].max())
    held = np.bincount(label, mass)
    there = np.count_nonzero(held)
    gain = 1 - _EVEN + _EVEN * held.sum() / there / np.where(held > 0, held, 1.0)
    return np.where(finite, log_mass + np.log(gain)[label], -np.inf)


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
