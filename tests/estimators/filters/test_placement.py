"""The mean placement around a mode, and poses that stand for cells."""

import numpy as np
import pytest

from tactsim.core import invert, wrap_angle
from tactsim.estimators.filters.placement import mean_around, samples_of_cells


def states(placed):
    """Give T_R^O (3, n) of objects that lie at `placed` (n, 3), as the kernels take it."""
    return np.ascontiguousarray(invert(placed).T)


def test_an_angle_goes_round_the_circle_and_leaves_the_turned_copy_out():
    placed = np.array([[1.0, 2.0, np.pi - 0.01], [1.0, 2.0, -np.pi + 0.03], [1.0, 2.0, 0.01]])
    pose = mean_around(states(placed), np.array([0.5, 0.25, 10.0]), 0)
    x, y, turn = invert(pose)
    assert [x, y] == pytest.approx([1, 2])
    assert wrap_angle(turn - np.pi) == pytest.approx(-0.01 * 2 / 3 + 0.03 / 3)


def test_a_position_is_averaged_over_turned_copies_but_not_over_other_places():
    placed = np.array([[1.0, 2.0, 0.0], [1.4, 2.0, 2.0], [1.0, 2.8, -2.0], [4.0, 2.0, 0.0]])
    x, y, turn = invert(mean_around(states(placed), np.array([1.0, 2.0, 1.0, 50.0]), 0))
    assert [x, y, turn] == pytest.approx([1.2, 2.2, 0.0])


def test_a_mode_that_weighs_nothing_beside_another_is_kept():
    placed = np.array([[1.0, 2.0, 0.5], [5.0, 2.0, 0.5]])
    pose = mean_around(states(placed), np.array([0.0, 1.0]), 0)
    assert invert(pose) == pytest.approx(placed[0])


def test_the_mean_is_that_of_its_definition():
    rng = np.random.default_rng(4)
    placed = np.column_stack([rng.normal(0, 0.6, (300, 2)), rng.uniform(-8, 8, 300)])
    weight = rng.exponential(size=300)
    mode = int(weight.argmax())
    off = placed[:, :2] - placed[mode, :2]
    turn = wrap_angle(placed[:, 2] - placed[mode, 2])
    away = (off**2).sum(axis=1)
    here, alike = weight * (away <= 1), weight * (away + (8 * turn) ** 2 <= 1)
    assert (here > 0).sum() > (alike > 0).sum() > 3
    x, y, angle = invert(mean_around(states(placed), weight, mode))
    assert [x, y] == pytest.approx(here @ placed[:, :2] / here.sum())
    assert wrap_angle(angle - placed[mode, 2]) == pytest.approx(alike @ turn / alike.sum())


def test_light_cells_are_one_pose_and_heavy_ones_are_eight():
    state, size = np.arange(9.0).reshape(3, 3), np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 4.0
    poses, weight = samples_of_cells(state, np.array([0.1, 0.8, 0.1]), size, corners, 0.1)
    assert poses[:2].tolist() == [[0, 3, 6], [2, 5, 8]]
    assert weight == pytest.approx([0.1, 0.1] + 8 * [0.1])
    assert poses[2:] == pytest.approx(np.array([1.0, 4, 7]) + np.array([2.0, 5, 8]) * corners)
