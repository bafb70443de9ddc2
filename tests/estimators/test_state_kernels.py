"""The kernels of states that lie anywhere, against sums written down plainly."""

import math

import numpy as np
import pytest
import reference

from estimators.state_kernels import add_cones, weigh


@pytest.mark.parametrize("states", [1, 128, 300])  # less, as many and more than are done at once
def test_weights_are_the_sum_of_interpolated_tables(states):
    rng = np.random.default_rng(states)
    nodes = np.zeros((2, 3, 9, 12), dtype=np.float32)  # tables, letters, rows, columns
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


@pytest.mark.parametrize("rho", [0.4, 1.0, 2.2])
def test_the_density_is_the_sum_of_cones_node_by_node(rho):
    rng = np.random.default_rng(0)
    step, corner, before = np.array([0.5, 0.4, 0.3]), np.array([-1.0, 2.0]), int(rho / 0.3) + 1
    density = np.zeros((9, 7, 21 + 2 * before + 1))
    state = np.stack([rng.uniform(-1.5, 2.5, 20), rng.uniform(1.5, 6, 20), rng.uniform(0, 2 * np.pi, 20)])
    weight = rng.random(20)
    add_cones(density, before, np.ascontiguousarray(state), weight, corner, step, rho)
    for (row, column, angle), got in np.ndenumerate(density):
        node = (corner[0] + column * step[0], corner[1] + row * step[1], (angle - before) * step[2])
        away = np.array([math.dist(node, one) for one in state.T])
        assert got == pytest.approx(weight @ np.maximum(0, 1 - away / rho), abs=1e-12)
