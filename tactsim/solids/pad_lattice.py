"""The pad as a lattice of points in space: where its surface is, where it looks, and what its taxels feel there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.press.spread import felt_along
from tactsim.solids.options import SpaceOptions
from tactsim.solids.touch_kernels import COARSE, Lattice

_KPA = 1e3  # kPa in a N/mm^2
_PARTS = 4  # of a cell along each axis, over which what a taxel feels is averaged
_EDGE = 1e-9  # mm by which a point may lie beside the pad and still be on it


@dataclass(frozen=True, eq=False)
class PadLattice:
    """The points of the pad's surface, and its taxels.

    kpa: what a taxel reads of 1 N. taxel_points, taxel_normals: (taxels, 3) mm and unit vectors, where the taxels'
    middles are and look.
    """

    points: Lattice
    kpa: float
    taxel_points: FloatArray
    taxel_normals: FloatArray


def pad_lattice(options: SpaceOptions) -> PadLattice:
    """Lay the options' pad on its body.

    Raises InputError if the pad reaches further round the body than a pad can.
    """
    pad, sigma = options.pad, options.sensor.psf_sigma
    x_low, x_high, y_low, y_high = pad.load_bounds
    low, high = np.array([x_low, y_low]), np.array([x_high, y_high])
    if options.radius is None:
        start, end = low, high
    else:
        start, end = _shadow(low, options), _shadow(high, options)
    count = COARSE * np.ceil((end - start) / options.spacing / COARSE - _EDGE).astype(int)
    columns, rows = int(count[0]), int(count[1])
    step = (end - start) / count
    x, y = start[0] + step[0] * (np.arange(columns) + 0.5), start[1] + step[1] * (np.arange(rows) + 0.5)
    at = np.stack([np.tile(x, rows), np.repeat(y, columns)], 1)
    taxels = pad.taxel_xy
    if options.radius is None:
        surface, facing = np.zeros(len(at)), np.ones(len(at))
        taxel_points = np.column_stack([taxels, np.zeros(len(taxels))])
        normals = np.tile((0.0, 0.0, 1.0), (len(taxels), 1))
    else:
        at, surface, facing, taxel_points, normals = _laid(
            at, taxels, low, high, options.radius, options.body
        )
    cell = np.clip(np.floor((at - low) / (high - low) * count), 0, count - 1).astype(np.int64)
    felt_u = _felt(x_low, x_high, columns, pad.column_edges, sigma)
    felt_v = _felt(y_low, y_high, rows, pad.row_edges, sigma)
    kpa = _KPA / (pad.taxel_width * pad.taxel_height)
    bounds = np.array(pad.load_bounds) if options.radius is None else np.full(4, np.nan)
    points = Lattice(start + step / 2, step, columns, rows, bounds, surface, facing, cell, felt_u, felt_v)
    return PadLattice(points, kpa, taxel_points, normals)


def _shadow(edge: FloatArray, options: SpaceOptions) -> FloatArray:
    """Tell where edges (2,) mm along the pad's surface lie along its x and y, mm."""
    assert options.radius is not None
    round_x, round_y = options.radius * np.sin(edge / options.radius)
    return np.array([round_x, round_y if options.body == "sphere" else edge[1]])


def _laid(
    at: FloatArray, taxels: FloatArray, low: FloatArray, high: FloatArray, radius: float, body: str
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lay the lattice and the taxels on a cylinder or sphere.

    at: (points, 2) mm along x and y. taxels: (taxels, 2) mm and low, high: (2,) mm, along the surface.
    Returns the points (points, 2) mm along the surface, their z mm, NaN beside the pad, and the normals' part along z;
    and of the taxels the points (taxels, 3) mm and normals. Raises InputError if the pad reaches too far round.
    """
    import mujoco

    from tactsim.attach.pad_surface import pad_surface

    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{body.upper()}")
    half_length = float(np.abs([low[1], high[1]]).max())
    surface = pad_surface(
        kind, np.array([radius, half_length, 0]) / 1e3, np.array([1.0, 0, 0]), np.zeros(2), body
    )
    beyond = np.maximum(surface.face.low - low, high - surface.face.high).max()
    if beyond > _EDGE:
        reach = float(np.abs([low, high]).max() if body == "sphere" else np.abs([low[0], high[0]]).max())
        least = radius * reach / float(surface.face.high[0])
        raise InputError(
            f"radius is {radius:g} mm, and the pad reaches too far round such a {body}: it needs {least:.2f} mm or more"
        )
    across = at[:, 0] ** 2 + (at[:, 1] ** 2 if body == "sphere" else 0)
    on = across < radius**2
    z = np.sqrt(np.where(on, radius**2 - across, 0.0)) - radius
    laid = surface.place(np.column_stack([at, z]))
    on &= (laid > low - _EDGE).all(axis=1) & (laid < high + _EDGE).all(axis=1)
    facing = np.where(on, (z + radius) / radius, 1.0)
    lines = surface.lines(*np.ascontiguousarray(taxels.T))
    return laid, np.where(on, z, np.nan), facing, lines.points, lines.normals


def _felt(low: float, high: float, count: int, edges: FloatArray, sigma: float) -> FloatArray:
    """Tell which share of a force on one of `count` cells falls on each taxel along one axis: (2, count, taxels).

    The force is even over a cell, and over COARSE cells about it.
    """
    width = (high - low) / count
    middle = low + width * (np.arange(count) + 0.5)
    felt = []
    for wide in (width, COARSE * width):
        if sigma == 0:
            ends = middle[:, None, None] + wide / 2 * np.array([-1.0, 1.0])
            felt.append(np.diff(np.clip(ends, edges[:, :1], edges[:, 1:]), axis=-1)[..., 0] / wide)
        else:
            parts = wide * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
            felt.append(felt_along(middle[:, None] + parts, edges, sigma).mean(axis=1))
    return np.array(felt)
