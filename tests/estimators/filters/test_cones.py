"""Sums of weighted cones, node by node."""

import math

import numpy as np
import pytest

from tactsim.core import wrap_angle
from tactsim.estimators.filters.cone_search import lift_nearby, nearly_sum_cones, sum_cones
from tactsim.estimators.filters.cones import (
    PARZEN_STEP,
    TURN,
    add_cones,
    cone_profiles,
    fold,
    heaviest,
    window,
)


def random_states(count, seed=0):
    rng = np.random.default_rng(seed)
    state = np.stack([rng.uniform(-2, 2, count), rng.uniform(1, 5, count), rng.uniform(-9, 9, count)])
    return np.ascontiguousarray(state), rng.random(count)


@pytest.mark.parametrize("rho", [0.3, 1.0, 2.2, 3.0])
def test_a_grid_bounds_the_sum_of_cones_node_by_node(rho):
    state, weight = random_states(30)
    wide, ahead, lanes = window(rho)
    # All nodes that a cone between -2 and 2, 1 and 5 mm may reach; `wide` may be a few nodes more.
    corner = np.array([math.floor((-2 - rho) / 0.5) - 1, math.floor((1 - rho) / 0.5) - 1])
    size = math.ceil(4 / 0.5) + wide + 3
    bound = np.zeros((size, size, TURN + 1 + lanes), dtype=np.float32)
    highest = np.empty((size, size), dtype=np.float32)
    chosen = np.arange(0, 30, 2)
    add_cones(bound, state, weight, chosen, corner, rho, cone_profiles(rho))
    fold(bound, highest, ahead)
    circle = bound[:, :, ahead : ahead + TURN]
    assert highest.tolist() == circle.max(axis=2).tolist()

    row, column, angle = np.indices(circle.shape).reshape(3, -1)
    node = np.stack([column + corner[0], row + corner[1], angle], axis=1) * PARZEN_STEP
    away = state.T[chosen] - node[:, None]
    away[..., 2] = wrap_angle(away[..., 2])
    exact = np.maximum(0, 1 - np.linalg.norm(away, axis=-1) / rho) @ weight[chosen]
    over = circle.ravel() - exact
    assert over.min() > -1e-5  # float32's rounding
    assert exact.max() > 0.3
    # An eighth of a step in angle, and a square of 1/128 next to the tip.
    assert over.max() < weight[chosen].sum() * (PARZEN_STEP[2] / 8 / rho + 128**-0.5)


@pytest.mark.parametrize("rho", [0.3, 1.0, 3.0])
def test_cones_that_share_a_cell_are_added_one_by_one(rho):
    # More of them than are added in one go, among others, and each with a weight of its own.
    state, weight = random_states(700, seed=3)
    state[:, 0] = 0.05, 3.05, 0.02
    state[:, 100:500] = state[:, :1]
    corner, size = np.array([-12, -6]), 32
    bounds = np.zeros((3, size, size, TURN + 1 + window(rho)[2]), dtype=np.float32)
    for bound, chosen in zip(
        bounds, (np.arange(700), np.arange(500, 700), np.zeros(1, dtype=int)), strict=True
    ):
        add_cones(bound, state, weight, chosen, corner, rho, cone_profiles(rho))
    alone = sum(weight[100:500]) / weight[0] * bounds[2]
    early = np.zeros_like(bounds[0])
    add_cones(early, state, weight, np.arange(100), corner, rho, cone_profiles(rho))
    assert alone.max() > 100
    assert bounds[0] == pytest.approx(alone + bounds[1] + early, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("rho", [0.4, 1.0, 3.0])
def test_cones_are_summed_around_the_circle_at_single_nodes(rho):
    state, weight = random_states(50, seed=1)
    rng = np.random.default_rng(2)
    node, density = rng.uniform([-2, 1, 0], [2, 5, 2 * np.pi], (20, 3)), np.ones(20)
    node[0, 2], node[1, 2] = 0.0, 6.28
    sum_cones(density, np.ascontiguousarray(node.T), state, weight, rho)
    away = state.T[None] - node[:, None]
    away[..., 2] = wrap_angle(away[..., 2])
    exact = np.maximum(0, 1 - np.linalg.norm(away, axis=-1) / rho) @ weight
    assert density == pytest.approx(exact)
    nearly = np.ones(20)
    error = nearly_sum_cones(nearly, np.ascontiguousarray(node.T), state, weight, rho)
    assert abs(nearly - exact).max() < error < 1e-3 * weight.sum()


@pytest.mark.parametrize("rho", [0.05, 0.4, 1.0, 3.0])
def test_states_that_are_not_chosen_lift_the_nodes_near_them(rho):
    state, weight = random_states(40, seed=4)
    state[:2, 0] = 100.0, -50.0
    chosen, corner = np.arange(0, 40, 3), np.array([-12, -6])
    lift, others = np.empty((26, 24)), np.setdiff1d(np.arange(40), np.arange(0, 40, 3))
    light = weight[others].sum()
    lift_nearby(lift, state, weight, chosen, corner, rho, light)
    row, column = np.indices(lift.shape)
    away = np.hypot(
        (column[..., None] + corner[0]) * PARZEN_STEP[0] - state[0, others],
        (row[..., None] + corner[1]) * PARZEN_STEP[1] - state[1, others],
    )
    assert (lift >= (away < rho) @ weight[others] * (1 - 1e-12)).all()
    side = max(rho, 0.5)
    assert (lift <= np.minimum(light, (away < 3 * side) @ weight[others]) * (1 + 1e-12)).all()


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3])
def test_the_lightest_are_left_out_up_to_their_share(share):
    state, _ = random_states(2000)
    weight = np.exp(-np.random.default_rng(3).exponential(5, 2000))
    weight[7], weight[8], weight[9] = 1.0, 0.0, 1e-310
    chosen, box = np.empty(2000, dtype=np.int64), np.empty(4)
    count, light = heaviest(chosen, box, state, weight, share)
    kept = chosen[:count]
    others = np.setdiff1d(np.arange(2000), kept)
    assert (np.diff(kept) > 0).all()
    assert len(others) == 0 if share == 0 else weight[others].max() <= weight[kept].min()
    assert light == pytest.approx(weight[others].sum())
    assert light <= share * weight.sum()
    assert light > 0.1 * share * weight.sum() or share == 0
    assert box.tolist() == [
        *state[:2, kept].min(axis=1)[:1], *state[:2, kept].max(axis=1)[:1],
        *state[:2, kept].min(axis=1)[1:], *state[:2, kept].max(axis=1)[1:],
    ]  # fmt: skip
