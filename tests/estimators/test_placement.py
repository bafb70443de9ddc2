"""The mean placement around a mode."""

import numpy as np
import pytest

from estimators.placement import mean_around
from tactsim import invert, wrap_angle


def test_a_mean_goes_round_the_circle_and_leaves_the_turned_copy_out():
    placed = np.array([[1.0, 2.0, np.pi - 0.01], [1.0, 2.0, -np.pi + 0.03], [1.0, 2.0, 0.01]])
    pose = mean_around(invert(placed).T, np.log([0.5, 0.25, 10.0]), 0)
    x, y, turn = invert(pose)
    assert [x, y] == pytest.approx([1, 2])
    assert wrap_angle(turn - np.pi) == pytest.approx(-0.01 * 2 / 3 + 0.03 / 3)
