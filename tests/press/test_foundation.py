"""How far independent springs are from the other ideal foundation, an elastic half-space (docs/sensor.md)."""

import numpy as np
import pytest

from tactsim import models
from tactsim.core import Pad, transform
from tactsim.press import press_letter
from tactsim.press.clip import covers
from tactsim.press.spread import felt_along

PAD = Pad()
FINE = 0.25  # mm


def half_space_reading(letter, pose, force=2.0, sigma=1.0):
    """Press a rigid flat face on a half-space: Love's closed form for squares of even pressure, solved densely."""
    left, right, low, high = PAD.load_bounds
    x, y = np.meshgrid(np.arange(left + FINE / 2, right, FINE), np.arange(low + FINE / 2, high, FINE))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[covers(letter.contours, transform(pose, points))]

    def corner(u, v):
        return u * np.arcsinh(v / np.abs(u)) + v * np.arcsinh(u / np.abs(v))

    dx, dy = np.moveaxis(points[:, None] - points, -1, 0)
    half = FINE / 2
    sink = corner(dx + half, dy + half) - corner(dx + half, dy - half)
    sink += corner(dx - half, dy - half) - corner(dx - half, dy + half)
    pressure = np.linalg.solve(sink, np.ones(len(points)))
    load = force * pressure / pressure.sum()
    columns = felt_along(points[:, 0], PAD.column_edges, sigma)
    rows = felt_along(points[:, 1], PAD.row_edges, sigma)
    return 1e3 * np.einsum("ir,ic,i->rc", rows, columns, load).ravel() / (PAD.taxel_width * PAD.taxel_height)


@pytest.mark.parametrize("name", ["E", "O"])
def test_the_foundation_is_the_largest_error_of_the_model(name):
    letter, distance = models.letter(name), []
    for pose in ([-3.4, -3.4, 0.5], [3.4, 3.4, 2.1], [-3.4, 10.2, 4.2]):
        springs = press_letter(letter, pose).ideal
        difference = half_space_reading(letter, pose) - springs
        distance.append([np.sqrt(np.mean(difference**2)), np.abs(difference).max()] / springs.max())
    rms, largest = np.mean(distance, axis=0)
    assert 0.08 < rms < 0.22
    assert 0.25 < largest < 0.5
