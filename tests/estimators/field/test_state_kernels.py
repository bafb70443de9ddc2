"""The kernels of states that lie anywhere, against sums written down plainly."""

import math

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import wrap_angle
from tactsim.estimators.field.state_kernels import (
    add_cones,
    replay,
    replay_halves,
    sort_uniform,
    sum_cones,
    weigh,
)
from tactsim.estimators.filters.grid import Cells, StateGrid


@pytest.mark.parametrize("states", [1, 128, 300])  # less, as many and more than are done at once
def test_weights_are_the_sum_of_interpolated_tables(states):
    rng = np.random.default_rng(states)
    # tables, letters, rows, columns; what lies around them in memory must not be read
    nodes = np.pad(np.zeros(2 * 3 * 9 * 12, dtype=np.float32), 50, constant_values=np.nan)[50:-50]
    nodes = nodes.reshape(2, 3, 9, 12)
    nodes[:, :, 1:-1, 1:-1] = rng.normal(size=(2, 3, 7, 10))
    origin, step = np.array([-3.0, -2.5]), np.array([0.6, 0.7])
    state = np.stack([*rng.uniform(-4, 4, (2, states)), rng.uniform(-7, 7, states)])
    letter, table = rng.integers(3, size=states), rng.integers(2, size=5)
    xy, weight = rng.uniform(-2, 2, (5, 2)), rng.uniform(0, 3, 5).astype(np.float32)
    begin = rng.normal(size=states)
    total = begin.copy()
    weigh(total, state, letter, table, xy, weight, nodes, np.concatenate([origin, step]))
    expected = [
        sum(
            float(factor) * reference.interpolate(nodes[kind, own].astype(float), origin, step, x, y, 0.0)
            for kind, factor, (x, y) in zip(table, weight, reference.place(pose, xy), strict=True)
        )
        for own, pose in zip(letter, state.T, strict=True)
    ]
    assert np.ptp(expected) > 1 or states == 1
    assert total - begin == pytest.approx(np.array(expected), abs=2e-5)


def several_readings(rng, readings):
    """Tables, lattice and the terms of readings of different lengths, as `History.terms` has them."""
    nodes = np.zeros((2, 3, 9, 12), dtype=np.float32)
    nodes[:, :, 1:-1, 1:-1] = rng.normal(size=(2, 3, 7, 10))
    start = np.concatenate([[0], np.cumsum(rng.integers(1, 6, readings))])
    terms = (
        start, rng.integers(2, size=start[-1]), rng.uniform(-2, 2, (start[-1], 2)),
        rng.uniform(0, 3, start[-1]).astype(np.float32), rng.normal(size=(readings, 3)),
    )  # fmt: skip
    return nodes, np.array([-3.0, -2.5, 0.6, 0.7]), terms


@pytest.mark.parametrize("states", [1, 128, 300])
def test_replaying_adds_readings_one_by_one_in_however_many_calls(states):
    rng = np.random.default_rng(states)
    nodes, lattice, terms = several_readings(rng, 4)
    start, table, xy, weight, constant = terms
    state = np.stack([*rng.uniform(-4, 4, (2, states)), rng.uniform(-7, 7, states)])
    letter, once = rng.integers(3, size=states), rng.normal(size=states)
    by_one, by_weigh = once.copy(), once.copy()
    replay(once, state, letter, *terms, 1, 4, nodes, lattice)
    for k in range(1, 4):
        replay(by_one, state, letter, *terms, k, k + 1, nodes, lattice)
        mine = slice(start[k], start[k + 1])
        by_weigh += constant[k][letter]
        weigh(by_weigh, state, letter, table[mine], xy[mine], weight[mine], nodes, lattice)
    assert (by_one == once).all()
    assert by_weigh == pytest.approx(once, abs=1e-12)


def test_halves_are_replayed_where_they_lie():
    rng = np.random.default_rng(3)
    nodes, lattice, terms = several_readings(rng, 3)
    grid = StateGrid(3, 4, 5, reach=7.0)
    cell = np.sort(rng.permutation(3 * grid.bins)[:40])
    which = np.array([0, 7, 39])
    half, log_p = np.full((40, 8), -1), rng.normal(size=(40, 8))
    before = log_p.copy()
    replay_halves(
        half, log_p, cell, which, np.array([3, 4, 5]), np.array(grid.spacing), *terms, 1, 3, nodes, lattice
    )
    others = np.setdiff1d(np.arange(40), which)
    assert (half[others] == -1).all()
    assert (log_p[others] == before[others]).all()
    cells = Cells(grid, np.ones(24, dtype=np.int64), half[which].ravel())
    outer = Cells(grid, np.zeros(3, dtype=np.int64), cell[which])
    assert len(set(half[which].ravel())) == 24
    assert cells.letter.reshape(-1, 8) == pytest.approx(np.repeat(outer.letter[:, None], 8, axis=1))
    away = np.abs(cells.states().reshape(3, 3, 8) - outer.states()[:, :, None])
    assert away == pytest.approx(np.broadcast_to(np.array(grid.spacing)[:, None, None] / 4, away.shape))
    expected = before[which].ravel()
    replay(expected, cells.states(), cells.letter, *terms, 1, 3, nodes, lattice)
    assert log_p[which].ravel() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("rho", [0.4, 1.0, 2.2])
def test_the_density_is_the_sum_of_cones_node_by_node(rho):
    rng = np.random.default_rng(0)
    step, corner, before = np.array([0.5, 0.4, 0.3]), np.array([-1.0, 2.0]), int(rho / 0.3) + 1
    density = np.zeros((9, 7, 21 + 2 * before + 1), dtype=np.float32)
    state = np.stack([rng.uniform(-1.5, 2.5, 20), rng.uniform(1.5, 6, 20), rng.uniform(0, 2 * np.pi, 20)])
    weight = rng.random(20)
    add_cones(density, before, np.ascontiguousarray(state), weight, corner, step, rho)
    for (row, column, angle), got in np.ndenumerate(density):
        node = (corner[0] + column * step[0], corner[1] + row * step[1], (angle - before) * step[2])
        away = np.array([math.dist(node, one) for one in state.T])
        # A state is given float32's rounding of its distance to the node.
        assert got == pytest.approx(weight @ np.maximum(0, 1 - away / rho), abs=1e-5)


@pytest.mark.parametrize("rho", [0.4, 1.0, 3.0])
def test_cones_are_summed_around_the_circle_at_single_nodes(rho):
    rng = np.random.default_rng(1)
    state = np.ascontiguousarray(rng.uniform([-2, -2, 0], [2, 2, 2 * np.pi], (50, 3)).T)
    node, weight, density = rng.uniform([-1, -1, 0], [1, 1, 2 * np.pi], (20, 3)), rng.random(50), np.ones(20)
    node[0, 2], node[1, 2] = 0.0, 6.28
    sum_cones(density, node, state, weight, rho)
    away = state.T[None] - node[:, None]
    away[..., 2] = wrap_angle(away[..., 2])
    assert density == pytest.approx(np.maximum(0, 1 - np.linalg.norm(away, axis=-1) / rho) @ weight)


@given(st.lists(st.floats(0, 1, exclude_max=True), max_size=60))
def test_numbers_are_sorted(values):
    array = np.array(values)
    sort_uniform(array)
    assert array.tolist() == sorted(values)
