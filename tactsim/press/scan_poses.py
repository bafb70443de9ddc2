"""Where a scan presses: the paper's grid of 16 positions with 12 angles each (section II), or poses drawn off it."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray

POSITIONS = (-10.2, -3.4, 3.4, 10.2)  # mm along x and along y: 4 x 4 positions, 6.8 mm apart
ANGLES = 12
POSES = len(POSITIONS) ** 2 * ANGLES
# mm; test poses off the grid have x and y in [-REACH, REACH], which is wider than what is trained on.
REACH = 12.0


def grid_poses() -> FloatArray:
    """List the 192 poses of the paper's grid, (192, 3) sensor_in_object.

    x varies slowest, then y, then the angle, k * 2 pi / 12 for k = 0 .. 11.
    """
    x, y, angle = np.meshgrid(POSITIONS, POSITIONS, 2 * np.pi * np.arange(ANGLES) / ANGLES, indexing="ij")
    return np.stack([x, y, angle], axis=-1).reshape(-1, 3)


def random_poses(rng: np.random.Generator, count: int = POSES) -> FloatArray:
    """Draw poses off the grid, (count, 3): x and y uniform in [-REACH, REACH] mm, theta on the circle."""
    return rng.uniform((-REACH, -REACH, 0.0), (REACH, REACH, 2 * np.pi), size=(count, 3))
