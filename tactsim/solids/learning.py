"""Learn an object's surface in space from training touches: distances on voxels, merged of what touches felt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.solids.feeling_kernels import feel_all
from tactsim.solids.fusion_kernels import (
    INSIDE,
    OUTSIDE,
    UNKNOWN,
    HeightMaps,
    carve,
    merge,
    redistance,
    settle,
)
from tactsim.solids.rays import Rays
from tactsim.solids.surface import Surface, surface_of
from tactsim.solids.voxels import Voxels, sparse

_BEFORE, _BEHIND = 1.5, 1.5  # mm from a surface, within which a touch says how far away it is
_BAND = 3.0  # mm from the surface, within which voxels are kept
_PART = 0.05  # of the largest piece's volume; smaller pieces are specks that no touch has passed
_SPACING = 2.0  # mm between points of a surface
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


class Chart(NamedTuple):
    """What was learned of one object: signed distances to its surface, and the surface where touches met it."""

    voxels: Voxels
    surface: Surface


def depths(voxels: Voxels, touches: Touches, rays: Rays, deepest: float, ahead: float) -> FloatArray:
    """Foresee how deep the surface lies in the layer at each ray: (n, rays) mm, as `feeling_kernels.feel` does."""
    origin = np.column_stack([rays.xy, rays.base.ravel()])
    found = np.empty((len(touches.places), len(origin)))
    feel_all(voxels, origin, touches.places, touches.turns, deepest, ahead, found)
    return found


def learn_surface(touches: Touches, rays: Rays, stiffness: float, cell: float, stroke: float) -> Chart:
    """Learn signed distances to an object's surface from its touches: heights read off the pressures, merged.

    stiffness: kPa/mm of the pad's layer. cell: mm. stroke: mm over which the pad came.
    """
    least = 0.1 * float(np.median(touches.readings.max(axis=1)))  # kPa from which a taxel counts as touched
    pressure = (touches.readings @ rays.to_rays.T).reshape(len(touches.readings), *rays.base.shape)
    # Heights above the pad's plane, (n, rows, columns) mm, and where there is contact.
    heights, touched = rays.base - pressure / stiffness, (pressure > least).astype(float)
    xy = rays.xy.reshape(*rays.base.shape, 2)
    seen = np.concatenate([np.broadcast_to(xy, (*heights.shape, 2)), heights[..., None]], axis=-1)
    world = np.einsum("nij,nrcj->nrci", touches.turns, seen) + touches.places[:, None, None]
    points = world[touched > 0]
    corner = points.min(axis=0) - _MARGIN
    shape = tuple(np.ceil((points.max(axis=0) + _MARGIN - corner) / cell).astype(int) + 1)
    total, weight, free = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    frame = rays.frame
    maps = HeightMaps(touches.places, touches.turns, heights, touched, frame)
    merge(total, weight, corner, cell, maps, _BEFORE, _BEHIND)
    ends = np.where(touched > 0, heights - cell, rays.base)
    carve(free, corner, cell, touches.places, touches.turns, np.ascontiguousarray(ends), frame, stroke)
    known = weight > free  # else a contact that was none: more touches have passed there than felt something
    side = np.where(known, np.where(total < 0, INSIDE, OUTSIDE), np.where(free > 0, OUTSIDE, UNKNOWN)).astype(
        np.int8
    )
    for axis in range(3):  # the grid is larger than the object
        np.moveaxis(side, axis, 0)[[0, -1]] = OUTSIDE
    settle(side)
    pieces, _ = label(side == INSIDE)
    volume = np.bincount(pieces.ravel())
    volume[0] = 0
    side[(side == INSIDE) & (volume < _PART * volume.max())[pieces]] = OUTSIDE
    nominal = np.where(side == INSIDE, -cell, cell)
    measured = known & ((total < 0) == (side == INSIDE))
    level = np.where(measured, total / np.maximum(weight, 1e-6), nominal).astype(np.float32)
    distance = np.empty_like(level)
    redistance(distance, level, cell)
    return Chart(
        sparse(corner, cell, distance, _BAND), surface_of(corner, cell, distance, measured, spacing=_SPACING)
    )
