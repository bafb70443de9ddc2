"""The pad as a lattice of points in space, and what its taxels feel of a force on one of its cells."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.space.space_options import SpaceOptions
from tactsim.press.space.touch_kernels import COARSE, Lattice
from tactsim.press.spread import felt_along

_PARTS = 4  # of a cell along each axis, over which what a taxel feels is averaged
_EDGE = 1e-9  # share of a cell by which the pad may reach beyond one


def pad_lattice(options: SpaceOptions) -> Lattice:
    """Lay points over the surface of the options' pad that carries load, at most `spacing` mm apart."""
    pad, sigma = options.pad, options.sensor.psf_sigma
    x_low, x_high, y_low, y_high = pad.load_bounds
    low, high = np.array([x_low, y_low]), np.array([x_high, y_high])
    count = COARSE * np.ceil((high - low) / options.spacing / COARSE - _EDGE).astype(int)
    columns, rows = int(count[0]), int(count[1])
    step = (high - low) / count
    felt_u = _felt(x_low, x_high, columns, pad.column_edges, sigma)
    felt_v = _felt(y_low, y_high, rows, pad.row_edges, sigma)
    return Lattice(low + step / 2, step, columns, rows, np.array(pad.load_bounds), felt_u, felt_v)


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
