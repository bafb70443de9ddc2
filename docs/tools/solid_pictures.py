"""Shaded pictures of solids on one scale: `python docs/tools/solid_pictures.py FILE.png [NAME ...]`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from tactsim import models
from tactsim.bench.runs.figures import Picture
from tactsim.core.files import write_bytes
from tactsim.core.poses import FloatArray
from tactsim.models import Solid

_FROM = (0.55, -0.7, 0.46)  # where the eye is
_LIGHT = (0.25, 0.45, 0.86)  # where the light is, seen by the eye: x to the right, y up, z towards it
_POINTS = 100  # points drawn on the surface for each mm^2
_PIXEL = 0.3  # mm


def shaded(solid: Solid, half: float) -> FloatArray:
    """Draw a solid in a square of `half` mm to each side: grey values (n, n) in [0, 1], NaN beside it.

    Each pixel shows the nearest of many points drawn evenly from the surface.
    """
    points, normals = solid.sample_surface(int(_POINTS * solid.areas.sum()), np.random.default_rng(0))
    back = np.asarray(_FROM) / np.linalg.norm(_FROM)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    eye = np.stack([right, np.cross(back, right), back])
    points, normals = points @ eye.T, normals @ eye.T
    size = round(2 * half / _PIXEL)
    column, row = np.floor((points[:, :2] + half) / _PIXEL).astype(int).T
    shown = (normals[:, 2] > 0) & (np.minimum(column, row) >= 0) & (np.maximum(column, row) < size)
    order = np.flatnonzero(shown)[np.argsort(points[shown, 2], kind="stable")]  # the nearest is written last
    image = np.full((size, size), np.nan)
    light = np.asarray(_LIGHT) / np.linalg.norm(_LIGHT)
    image[row[order], column[order]] = 0.25 + 0.75 * np.maximum(normals[order] @ light, 0)
    return image


def solids_figure(solids: Sequence[Solid], across: int = 6) -> Picture:
    """Draw solids on one scale, `across` in a row, each with its name and its number of turns onto itself."""
    half = 1.02 * max(solid.radius for solid in solids)
    rows = -(-len(solids) // across)
    figure = Picture(figsize=(1.7 * across, 1.95 * rows), layout="constrained")
    for number, solid in enumerate(solids):
        axes = figure.add_subplot(rows, across, number + 1)
        axes.imshow(
            shaded(solid, half), origin="lower", cmap="bone", vmin=0, vmax=1.1, interpolation="antialiased"
        )
        axes.set_title(f"{solid.name}\n{_turns(solid)}", fontsize=9)
        axes.set_axis_off()
    return figure


def _turns(solid: Solid) -> str:
    symmetry = solid.symmetry
    if symmetry.axis is not None:
        return "round" if len(symmetry.rotations) == 1 else "round, both ends alike"
    count = len(symmetry.rotations)
    return "1 turn" if count == 1 else f"{count} turns"


if __name__ == "__main__":
    chosen = sys.argv[2:] or models.solid_names()
    write_bytes(sys.argv[1], solids_figure([models.solid(name) for name in chosen]).png())
