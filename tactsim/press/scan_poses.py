"""The poses of the paper's scan: 16 positions in a square grid, 12 angles at each (section II)."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray

POSITIONS = (-10.2, -3.4, 3.4, 10.2)  # mm along x and along y: 4 x 4 positions, 6.8 mm apart
ANGLES = 12
POSES = len(POSITIONS) ** 2 * ANGLES


def grid_poses() -> FloatArray:
    """List the 192 poses of the paper's grid, (192, 3) sensor_in_object.

    x varies slowest, then y, then the angle, k * 2 pi / 12 for k = 0 .. 11.
    """
    x, y, angle = np.meshgrid(POSITIONS, POSITIONS, 2 * np.pi * np.arange(ANGLES) / ANGLES, indexing="ij")
    return np.stack([x, y, angle], axis=-1).reshape(-1, 3)


def random_poses(rng: np.random.Generator, count: int = POSES) -> FloatArray:
    """Draw poses off the grid, uniform over the grid's range and all angles: (count, 3)."""
    low, high = (POSITIONS[0], POSITIONS[0], 0.0), (POSITIONS[-1], POSITIONS[-1], 2 * np.pi)
    return rng.uniform(low, high, size=(count, 3))
