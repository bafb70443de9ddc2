"""The surface of meshes and of bodies of several geoms that carry a pad: what is seen of them along the pad's normal.

A pad on such a body is projected along its normal, as on an ellipsoid: (u, v) are x and y of the pad's frame. A mesh is
its convex hull, as in MuJoCo's collision. The heights are looked up on a fine grid, with the slope on each point's
flatter side, so that a step between two geoms stays one.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.attach.geom_gap import Body, Pose, body_of, measure
from tactsim.attach.pad_surface import RELIEF, Face, Lines, PadSurface, pad_axes
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_SEEN = 200  # points along each axis of the grid that finds the body's outline
_FINE = 400, 1000  # and of that of its heights, at most: of one mesh, and of several geoms
_STEP = 0.02  # mm between the latter's points, at least
_JUMP = 1e-3  # mm of height from point to point, beyond the slope's, which is a step between geoms
_STEEPEST = 3.0  # mm of height for a mm along the pad; what is steeper carries no pad
_NO_WIDTH = 1e-6 * np.eye(3)[:2]  # mm along x and y, of a cell that no wall cuts
_EVERYWHERE = np.array([0.0, 0.0, 0.0, np.inf])  # no face of a geom is too far to be looked at
_UP, _DOWN = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])


def relief_surface(
    model: mujoco.MjModel, geoms: Sequence[int], normal: FloatArray, at: FloatArray, name: str
) -> PadSurface:
    """Find the surface of geoms of one body that is seen against `normal`, (3,) in the body's frame.

    at: (2,) mm, the pad's middle from that of what is seen, along the pad's x and y, which lie to the body's frame as
    to a geom's in `pad_surface`. The frame of the result is in that of the first geom.
    Raises InputError, naming the pad's place, if nothing is seen there.
    """
    axes = pad_axes(normal)
    listed = list(geoms)
    rotations = np.array([axes.T @ _matrix(model.geom_quat[geom]) for geom in listed])
    middles, radii = model.geom_pos[listed] @ axes * _MM, model.geom_rbound[listed] * _MM
    body, pose = body_of(model, listed), Pose(rotations, middles)
    far = float((np.abs(middles[:, 2]) + radii).max()) + 1
    low, high = (middles[:, :2] - radii[:, None]).min(axis=0), (middles[:, :2] + radii[:, None]).max(axis=0)
    x, y = (np.linspace(low[axis], high[axis], _SEEN) for axis in (0, 1))
    rows, columns = np.nonzero(np.isfinite(_seen(body, pose, x, y, far)[0]))
    if not len(rows):
        raise InputError(f"{name} has no face that looks along normal={tuple(np.round(normal, 3).tolist())}")
    apart = (high - low) / (_SEEN - 1)
    low = np.array([x[columns.min()], y[rows.min()]]) - apart
    high = np.array([x[columns.max()], y[rows.max()]]) + apart
    count = np.clip(np.ceil((high - low) / _STEP), 2, _FINE[len(geoms) > 1]).astype(int)
    x, y = (np.linspace(low[axis], high[axis], count[axis]) for axis in (0, 1))
    height, depth = _seen(body, pose, x, y, far)
    steps = x[1] - x[0], y[1] - y[0]
    slope_y, slope_x = (_slopes(height, steps[1 - axis], axis) for axis in (0, 1))
    seen = np.isfinite(height) & (np.hypot(slope_x, slope_y) < _STEEPEST)
    rows, columns = np.nonzero(seen)
    low = np.array([x[columns.min()], y[rows.min()]]) - np.array(steps)
    high = np.array([x[columns.max()], y[rows.max()]]) + np.array(steps)
    middle = (low + high) / 2 + at
    column, row = np.abs(x - middle[0]).argmin(), np.abs(y - middle[1]).argmin()
    top = height[row, column] if seen[row, column] else height[seen].max()
    relief = np.where(seen, [height - top, slope_x, slope_y, np.ones_like(height)], 0.0)
    jumps = _jumps(height, seen, slope_x * steps[0], slope_y * steps[1]) * (len(listed) > 1)
    grid = np.array([x[0] - middle[0], y[0] - middle[1], *steps])
    first = _matrix(model.geom_quat[geoms[0]])
    origin = axes @ np.array([*middle, top]) - model.geom_pos[geoms[0]] * _MM
    # Column by column, as a lattice's cells come.
    layers = np.ascontiguousarray(np.stack([*relief, jumps]).T)
    face = Face(RELIEF, np.zeros(3), grid, layers, low - middle, high - middle, depth)
    return PadSurface(first.T @ origin, first.T @ axes, face)


def _matrix(quat: FloatArray) -> FloatArray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def _seen(body: Body, pose: Pose, x: FloatArray, y: FloatArray, far: float) -> tuple[FloatArray, float]:
    """Look at a body from `far` mm above on a grid: z of what is seen (rows, columns), -inf for nothing.

    Returns also how thick the body is from the highest point to the lowest, mm.
    """
    at_x, at_y = (each.ravel() for each in np.meshgrid(x, y))
    top, lowest = np.full(at_x.size, -np.inf), np.inf
    for geom, (x_there, y_there, _) in enumerate(pose.positions):
        ends: list[FloatArray] = []
        (met,) = np.nonzero(np.hypot(at_x - x_there, at_y - y_there) <= body.radii[geom])
        for side, way in ((far, _DOWN), (-far, _UP)):
            points = np.stack([at_x[met], at_y[met], np.full(met.size, side)], 1)
            gap, share, shift = np.empty(met.size), np.empty(met.size), np.empty((2, met.size))
            lines = Lines(points, way, _NO_WIDTH[:1], _NO_WIDTH[1:], np.ones(1))
            measure(body, geom, pose, lines, _EVERYWHERE, gap, share, shift)
            there = np.isfinite(gap) & (share > 0.5)
            met, ends = met[there], [end[there] for end in (*ends, side + way[0, 2] * gap)]
        there = ends[0] > ends[1]
        top[met[there]] = np.maximum(top[met], ends[0])[there]
        lowest = min(lowest, ends[1][there].min(initial=np.inf))
    return top.reshape(len(y), len(x)), float(top.max() - lowest)


def _jumps(height: FloatArray, seen: NDArray[np.bool_], rise_x: FloatArray, rise_y: FloatArray) -> FloatArray:
    """Count the steps, and the rims of what is seen, up to each point along both x and y: (rows, columns).

    height: mm. rise_x, rise_y: mm by which the slopes rise to the next point. The sides of the rectangle that holds all
    that is seen do not count: there the face ends.
    """
    jumps = np.zeros(height.shape)
    for each, rise in ((jumps, rise_x), (jumps.T, rise_y.T)):
        high, there = (height, seen) if each is jumps else (height.T, seen.T)
        with np.errstate(invalid="ignore"):
            off = np.abs(np.diff(high, axis=1)) > np.maximum(*np.abs([rise[:, 1:], rise[:, :-1]])) + _JUMP
        each[:, 1:] += np.where(there[:, 1:] & there[:, :-1], off, there[:, 1:] != there[:, :-1])
    rows, columns = np.nonzero(seen)
    within = slice(rows.min() + 1, rows.max() + 1), slice(columns.min() + 1, columns.max() + 1)
    inner = np.zeros(height.shape)
    inner[within] = jumps[within]
    return inner.cumsum(axis=0).cumsum(axis=1)


def _slopes(height: FloatArray, step: float, axis: int) -> FloatArray:
    """Take the smaller of the slopes to both sides, along an axis of a grid; where there is nothing, 0."""
    with np.errstate(invalid="ignore"):
        rise = np.diff(height, axis=axis) / step
    rise = np.where(np.isfinite(rise), rise, np.inf)
    edge = [(1, 0) if i == axis else (0, 0) for i in (0, 1)]
    before = np.pad(rise, edge, constant_values=np.inf)
    after = np.pad(rise, [pair[::-1] for pair in edge], constant_values=np.inf)
    least = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(np.isfinite(least), least, 0.0)
