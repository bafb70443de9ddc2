"""Learn an object's surface in space from training touches: distances on voxels, merged, foreseen and merged again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, binary_propagation, label

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.space.fusion_kernels import carve, merge, redistance
from tactsim.estimators.space.rays import Rays
from tactsim.estimators.space.touch_kernels import feel_all
from tactsim.estimators.space.voxels import Voxels, sparse

_BEFORE, _BEHIND = 1.5, 1.5  # mm from a surface, within which a touch says how far away it is
_BAND = 3.0  # mm from the surface, within which voxels are kept
_PART = 0.05  # of the largest piece's volume; smaller pieces are specks that no touch has passed
_MARGIN = 4.0  # mm that the grid is larger than what was touched


@dataclass(frozen=True, eq=False)
class Touches:
    """Training touches of one object. readings: (n, taxels) kPa. places: (n, 3) mm, turns: (n, 3, 3), the sensors."""

    readings: FloatArray
    places: FloatArray
    turns: FloatArray

    @classmethod
    def at(cls, readings: FloatArray, poses: FloatArray) -> Touches:
        """Take touches at poses (n, 7) sensor_in_object."""
        turns = np.ascontiguousarray(rigid.matrix(poses[:, 3:]))
        return cls(np.ascontiguousarray(readings), np.ascontiguousarray(poses[:, :3]), turns)

    def __getitem__(self, those: FloatArray) -> Touches:
        return Touches(self.readings[those], self.places[those], self.turns[those])


def first_heights(
    touches: Touches, rays: Rays, stiffness: float, least: float
) -> tuple[FloatArray, FloatArray]:
    """Read heights above the pad's plane off the pressures: (n, rows, columns) mm, and where there is contact.

    least: kPa from which a taxel counts as touched.
    """
    shape = (len(touches.readings), *rays.base.shape)
    pressure = (touches.readings @ rays.to_rays.T).reshape(shape)
    return rays.base - pressure / stiffness, (pressure > least).astype(float)


def fuse(
    touches: Touches, rays: Rays, heights: FloatArray, touched: FloatArray, cell: float, stroke: float
) -> Voxels:
    """Merge heights (n, rows, columns) mm, where `touched` is 1, into signed distances."""
    xy = rays.xy.reshape(*rays.base.shape, 2)
    seen = np.concatenate([np.broadcast_to(xy, (*heights.shape, 2)), heights[..., None]], axis=-1)
    world = np.einsum("nij,nrcj->nrci", touches.turns, seen) + touches.places[:, None, None]
    points = world[touched > 0]
    corner = points.min(axis=0) - _MARGIN
    shape = tuple(np.ceil((points.max(axis=0) + _MARGIN - corner) / cell).astype(int) + 1)
    total, weight, free = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    frame = rays.frame
    merge(
        total, weight, corner, cell, touches.places, touches.turns, heights, touched, frame, _BEFORE, _BEHIND
    )
    ends = np.where(touched > 0, heights - cell, rays.base)
    carve(free, corner, cell, touches.places, touches.turns, np.ascontiguousarray(ends), frame, stroke)
    known = weight > free  # else a contact that was none: more touches have passed there than felt something
    level = np.where(known, total / np.maximum(weight, 1e-6), np.where(free > 0, cell, -cell)).astype(
        np.float32
    )
    level[_outside(known & (level <= 0), free > 0) & ~known] = cell
    inside, _ = label(level < 0)
    volume = np.bincount(inside.ravel())
    volume[0] = 0
    level[(level < 0) & (volume < _PART * volume.max())[inside]] = cell
    distance = np.empty_like(level)
    redistance(distance, level, cell)
    return sparse(corner, cell, distance, _BAND)


def _outside(solid: NDArray[np.bool_], passed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which voxels are outside: what the pad has passed, and what is reached from the grid's border.

    solid: known to be inside. A way that is narrower than three voxels leads nowhere: it is a gap between touches.
    """
    wide = binary_erosion(~solid, iterations=1, border_value=1)
    border = np.ones_like(solid)
    border[1:-1, 1:-1, 1:-1] = False
    reached = binary_propagation(border & wide, mask=wide | passed)
    return np.asarray(binary_dilation(reached, mask=~solid) | passed | border)


def depths(voxels: Voxels, touches: Touches, rays: Rays, deepest: float, ahead: float) -> FloatArray:
    """Foresee how deep the surface lies in the layer at each ray: (n, rays) mm, as `touch_kernels.feel` does."""
    origin = np.column_stack([rays.xy, rays.base.ravel()])
    found = np.empty((len(touches.places), len(origin)))
    feel_all(voxels, origin, touches.places, touches.turns, deepest, ahead, found)
    return found


def learn_surface(touches: Touches, rays: Rays, stiffness: float, cell: float, stroke: float) -> Voxels:
    """Learn signed distances to an object's surface from its touches.

    stiffness: kPa/mm of the pad's layer. cell: mm. stroke: mm over which the pad came.
    """
    least = 0.1 * float(np.median(touches.readings.max(axis=1)))
    heights, touched = first_heights(touches, rays, stiffness, least)
    return fuse(touches, rays, heights, touched, cell, stroke)
