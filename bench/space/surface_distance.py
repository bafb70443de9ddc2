"""How far an estimated pose of a solid is from the true one: mean distance of surface points, and angle.

A solid with symmetry looks the same in several poses, so both are the least over its symmetry group. The mean distance
of corresponding points, the least over the group, is the error of Hodan et al. 2020 (MSSD) with the mean for the
maximum; without symmetry it is the ADD of Hinterstoisser et al. 2012.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import rigid
from tactsim.core.poses import FloatArray

POINTS = 256  # on a solid's surface; the mean of so many differs from the surface's by some 1 %
_AT_ONCE = 1 << 21  # numbers of one array
_GOLDEN = (np.sqrt(5) - 1) / 2
_HALVINGS = 20  # of the interval in which the turn about an axis is sought, by the golden section
_STARTS = 8  # turns about an axis from which the least is sought


@dataclass(frozen=True, eq=False)
class Surface:
    """What the distance needs of a solid.

    points: (s, 3) mm in the object frame, even over its surface. rotations: (k, 4) its finite symmetry group, with the
    identity. axis: (3,) unit vector if every turn about it leaves the solid as it is; `rotations` are then those
    beside it.
    """

    points: FloatArray
    rotations: FloatArray
    axis: FloatArray | None = None

    @property
    def thinned(self) -> Surface:
        """Give it with a quarter of its points, for what is asked often and need not be exact."""
        return replace(self, points=self.points[::4])


def surface_distance(estimated: ArrayLike, true: ArrayLike, of: Surface) -> FloatArray:
    """Compute the mean distance (n,) mm of corresponding surface points between object poses (n, 7).

    Both are object_in_robot, or object_in_anything if it is the same frame. The least over the symmetry group counts;
    the least over turns about an axis is found to 1e-3 rad.
    """
    between = rigid.compose(rigid.invert(true), np.asarray(estimated, dtype=float))
    size = max(1, _AT_ONCE // (of.points.size * len(of.rotations)))
    parts = [_least(between[first : first + size], of) for first in range(0, len(between), size)]
    return np.concatenate([np.empty(0), *parts])


def turn_between(estimated: ArrayLike, true: ArrayLike, of: Surface) -> FloatArray:
    """Compute the angle (n,) rad between object poses (n, 7), the least over the symmetry group."""
    between = rigid.multiply(rigid.conjugate(np.asarray(true)[..., 3:]), np.asarray(estimated)[..., 3:])
    beside = rigid.multiply(between[:, None], rigid.conjugate(of.rotations))
    if of.axis is None:
        cosine = np.abs(beside[..., 0])
        sine = np.linalg.norm(beside[..., 1:], axis=-1)
    else:  # what is left when the best turn about the axis has been taken off
        along = beside[..., 1:] @ of.axis
        cosine = np.hypot(beside[..., 0], along)
        sine = np.linalg.norm(beside[..., 1:] - along[..., None] * of.axis, axis=-1)
    return np.asarray(2 * np.arctan2(sine, cosine).min(axis=1), dtype=float)


def _least(between: FloatArray, of: Surface) -> FloatArray:
    """Compute the distance (n,) for poses (n, 7) of the estimated in the true object's frame."""
    placed = rigid.transform(between, of.points)[:, None]  # (n, 1, s, 3)
    alike = rigid.turned(of.rotations[:, None], of.points)  # (k, s, 3)
    if of.axis is None:
        return _mean(placed - alike).min(axis=1)
    return _least_about_axis(placed, alike, of.axis)


def _mean(difference: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", difference, difference)).mean(axis=-1))


def _least_about_axis(placed: FloatArray, alike: FloatArray, axis: FloatArray) -> FloatArray:
    """Find the least distance (n,) over the rotations and every turn about the axis, by golden sections."""
    along = (alike @ axis)[..., None] * axis
    across, beside = alike - along, np.cross(axis, alike)

    def distance(turn: FloatArray) -> FloatArray:
        turned = along + np.cos(turn)[..., None, None] * across + np.sin(turn)[..., None, None] * beside
        return _mean(placed - turned)

    shape = (len(placed), len(alike))
    starts = np.arange(_STARTS) * (2 * np.pi / _STARTS)
    found = np.stack([distance(np.full(shape, start)) for start in starts])
    low = starts[found.argmin(axis=0)] - 2 * np.pi / _STARTS
    width = np.full(shape, 4 * np.pi / _STARTS)
    best = found.min(axis=0)
    for _ in range(_HALVINGS):
        left, right = low + (1 - _GOLDEN) * width, low + _GOLDEN * width
        at_left, at_right = distance(left), distance(right)
        best = np.minimum(best, np.minimum(at_left, at_right))
        low = np.where(at_left < at_right, low, left)
        width = _GOLDEN * width
    return np.asarray(best.min(axis=1))
