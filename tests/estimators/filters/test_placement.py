"""The mean placement around a mode."""

import numpy as np
import pytest

from tactsim.core import invert, wrap_angle
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.weights import Weights


def test_an_angle_goes_round_the_circle_and_leaves_the_turned_copy_out():
    placed = np.array([[1.0, 2.0, np.pi - 0.01], [1.0, 2.0, -np.pi + 0.03], [1.0, 2.0, 0.01]])
    pose = mean_around(invert(placed).T, Weights(np.log([0.5, 0.25, 10.0])), 0)
    x, y, turn = invert(pose)
    assert [x, y] == pytest.approx([1, 2])
    assert wrap_angle(turn - np.pi) == pytest.approx(-0.01 * 2 / 3 + 0.03 / 3)


def test_a_position_is_averaged_over_turned_copies_but_not_over_other_places():
    placed = np.array([[1.0, 2.0, 0.0], [1.4, 2.0, 2.0], [1.0, 2.8, -2.0], [4.0, 2.0, 0.0]])
    x, y, turn = invert(mean_around(invert(placed).T, Weights(np.log([1.0, 2.0, 1.0, 50.0])), 0))
    assert [x, y, turn] == pytest.approx([1.2, 2.2, 0.0])


def test_a_mode_that_weighs_nothing_beside_another_is_kept():
    placed = np.array([[1.0, 2.0, 0.5], [5.0, 2.0, 0.5]])
    pose = mean_around(invert(placed).T, Weights(np.array([-2000.0, 0.0])), 0)
    assert invert(pose) == pytest.approx(placed[0])
