"""The mean placement around a mode, and poses that stand for cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.core import invert, wrap_angle
from tactsim.estimators.filters.placement import mean_around, placements, samples_of_cells
from tactsim.estimators.filters.states import CORNERS, SPREAD


def states(placed):
    """Give T_R^O (3, n) of objects that lie at `placed` (n, 3), as the kernels take it."""
    return np.ascontiguousarray(invert(placed).T)


def test_states_are_placed_as_poses_are_inverted():
    placed = np.random.default_rng(2).uniform(-9, 9, (40, 3))
    placed[0, 2], placed[:, 2] = -np.pi, wrap_angle(placed[:, 2])
    assert placements(states(placed)) == pytest.approx(placed.T)


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


def normal_cells(mean, deviation, size):
    """Give `samples_of_cells` of a normal belief in cells that have a middle at [0, 0, 0]."""
    index = np.stack(np.meshgrid(*3 * [np.arange(-12, 13)], indexing="ij")).reshape(3, -1)
    state = index * np.array(size)[:, None]
    log_p = -0.5 * (((state.T - mean) / deviation) ** 2).sum(axis=1)
    held = log_p > log_p.max() - 20
    weight = np.exp(log_p[held]) / np.exp(log_p[held]).sum()
    state = np.ascontiguousarray(state[:, held])
    sizes = np.repeat(np.array(size)[:, None], held.sum(), axis=1)
    poses, weight = samples_of_cells(state, weight, sizes, CORNERS, SPREAD)
    return poses, weight, np.count_nonzero(held)


@given(
    st.tuples(*3 * [st.floats(-0.5, 0.5)]),
    st.tuples(*3 * [st.floats(0.6, 2.5)]),
    st.tuples(*3 * [st.floats(0.01, 0.2)]),
)
@settings(max_examples=50)
def test_cells_that_resolve_a_belief_do_not_widen_it(mean, deviation, size):
    mean, deviation = np.array(mean) * size, np.array(deviation) * size
    poses, weight, cells = normal_cells(mean, deviation, size)
    assert len(poses) == cells
    found = weight @ poses
    assert found == pytest.approx(mean, abs=0.02 * max(size))
    assert weight @ (poses - found) ** 2 == pytest.approx(deviation**2, rel=0.03)


def test_a_belief_at_half_a_turn_is_as_wide_as_at_none():
    angle = np.pi - 0.05 + 0.1 * np.arange(-2, 3)
    weight = np.exp(-0.5 * np.arange(-2, 3.0) ** 2)
    weight /= weight.sum()
    size = np.full((3, 5), 0.1)
    found = []
    for turn in (angle, (angle + np.pi) % (2 * np.pi) - np.pi, angle - np.pi):
        poses, _ = samples_of_cells(np.stack([0 * turn, 0 * turn, turn]), weight, size, CORNERS, SPREAD)
        found.append(len(poses))
        assert set(poses[:, 2]) == set(turn)
    assert found == 3 * [8 * 5]


def test_regions_of_cells_hold_what_a_normal_belief_holds():
    # Cells 2.5 deviations wide and less: a region of 90 % holds the truth in 90 % of beliefs, wherever among cells.
    rng, held = np.random.default_rng(0), []
    for deviation in np.repeat([0.4, 0.5, 0.7, 1.0, 1.5], 300):
        mean, truth = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
        poses, weight, _ = normal_cells(mean, deviation, np.ones(3))
        centre = weight @ poses
        away, off = (np.linalg.norm(x - centre, axis=-1) for x in (poses, mean + deviation * truth))
        held.append(weight[away < off].sum() <= 0.9)
    assert np.mean(held) == pytest.approx(0.9, abs=3 * np.sqrt(0.9 * 0.1 / 1500))
