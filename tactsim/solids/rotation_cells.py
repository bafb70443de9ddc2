"""Cells that part all rotations nearly evenly and halve into eight each: the four cubes about the unit quaternions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
