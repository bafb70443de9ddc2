"""Make the relief that the suite `sequence` presses, 20 mm across: `python examples/relief/make.py FOLDER`.

It made the .stl files beside it. Their tops differ by a few tenths of a mm, so that a light touch meets less of them
than a firm one.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold

from tactsim import models

SIDE, HEIGHT = 20.0, 5.0  # mm


def profile(tops: np.ndarray) -> Manifold:
    """Extrude a profile along y: its heights (n,) mm at equal steps along x."""
    x = np.linspace(-SIDE / 2, SIDE / 2, len(tops))
    outline = [(-SIDE / 2, 0.0), (SIDE / 2, 0.0), *zip(x[::-1], tops[::-1], strict=True)]
    return Manifold.extrude(CrossSection([outline]), SIDE).rotate((90, 0, 0)).translate((0, SIDE / 2, 0))


def block(x: float, y: float, size: tuple[float, float], top: float) -> Manifold:
    """Stand a block of this size on z = 0 with its middle at (x, y)."""
    return Manifold.cube((*size, top), True).translate((x, y, top / 2))


def turned(radius: np.ndarray, height: np.ndarray) -> Manifold:
    """Turn a profile (n,) mm about the z axis; it ends on the axis or stands on z = 0."""
    outline = [(0.0, 0.0), (float(radius[0]), 0.0), *zip(radius, height, strict=True)]
    return Manifold.revolve(CrossSection([outline]), 40)


along, out = np.linspace(-1, 1, 41), np.linspace(SIDE / 2, 0, 21)
SHAPES = {
    "dome": turned(out, HEIGHT - out**2 / 60),
    "cone": turned(out, HEIGHT - out * 0.08),
    "dish": turned(out, HEIGHT - 0.4 * np.cos(np.pi * out / 9) ** 2),
    "roller": profile(HEIGHT - (SIDE / 2 * along) ** 2 / 60),
    "waves": profile(HEIGHT - 0.3 * (1 - np.cos(3 * np.pi * along)) - 0.2 * (1 + along)),
    "stairs": block(-6, 0, (8, 20), HEIGHT)
    + block(2, 0, (8.01, 20), HEIGHT - 0.15)
    + block(8, 0, (4.01, 20), HEIGHT - 0.3),
    "studs": block(0, 0, (20, 20), HEIGHT - 1)
    + block(-6, -6, (5, 5), HEIGHT)
    + block(6, -5, (5, 5), HEIGHT - 0.1)
    + block(0, 6, (5, 5), HEIGHT - 0.2)
    + block(7, 6, (4, 4), HEIGHT - 0.3),
}


def write(name: str, solid: Manifold, folder: Path) -> None:
    """Write a solid as it is pressed, about its centre of area, with corners at whole pm."""
    mesh = models.relief(name, solid).solid.to_mesh64()
    # A corner that belongs at 0 lies 1e-16 mm beside it, otherwise on every machine.
    corners = np.round(mesh.vert_properties[:, :3], 9) + 0.0
    trimesh.Trimesh(corners, mesh.tri_verts, process=False).export(folder / f"{name}.stl")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the relief of the suite `sequence` as .stl files.")
    parser.add_argument("folder", type=Path, help="where they are written; it is made if it is not there")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, solid in SHAPES.items():
        write(name, solid, folder)
