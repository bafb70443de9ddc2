"""Sums of weighted cones, node by node."""

import math

import numpy as np
import pytest

from tactsim.core import wrap_angle
from tactsim.estimators.filters.cones import add_cones, sum_cones


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
