"""The mosaic against closed forms, least squares node by node, and fits without the taxel in question."""

import numpy as np
import pytest

from tactsim.estimators.likelihoods.mosaic import Grid, learn_mosaic, learn_with_spread

GRID = Grid(origin=np.array([-3.0, -2.0]), cell=0.4, shape=(16, 21), sigma=1.0)


def scattered(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform([-3, -2], [5, 4], (count, 2)), rng


def test_it_converges_to_a_plane_that_is_felt():
    def felt(xy):
        return 0.3 + 0.11 * xy[..., 0] - 0.07 * xy[..., 1]

    inside = np.random.default_rng(1).uniform([-1, 0], [3, 2], (50, 2))
    worst = []
    for count in (3_000, 300_000):  # what is left is the prior, whose part falls as taxels come
        xy, _ = scattered(count)
        value, slope = learn_mosaic(xy, felt(xy), np.ones(count), GRID)(inside)
        worst.append(np.abs(value - felt(inside)).max())
    assert worst[0] < 5e-3
    assert worst[1] < worst[0] / 20
    assert slope == pytest.approx(0.11**2 + 0.07**2, rel=1e-3)


def test_every_node_is_a_weighted_least_squares_fit():
    xy, rng = scattered(300)
    values, weight = rng.normal(size=300), rng.uniform(0, 2, 300)
    mosaic = learn_mosaic(xy, values, weight, GRID)
    for row, column in [(0, 0), (7, 10), (15, 20), (3, 18)]:
        offset = (xy - GRID.origin) / 0.4 - (column, row)
        k = weight * np.exp(-2 * (offset**2).sum(axis=1) * 0.4**2) * (np.abs(offset) <= 2.0 / 0.4).all(axis=1)
        rows = np.column_stack([np.ones(300), offset]) * np.sqrt(k)[:, None]
        prior = np.sqrt(0.01) * np.diag([1, 1 / 0.4, 1 / 0.4])
        wanted, *_ = np.linalg.lstsq(
            np.vstack([rows, prior]), np.append(values * np.sqrt(k), np.zeros(3)), rcond=None
        )
        assert mosaic.plane[row, column] == pytest.approx(wanted, abs=1e-9)


def test_leaving_an_taxel_out_is_learning_without_it():
    xy, rng = scattered(200)
    values, weight = rng.normal(size=200), rng.uniform(0.1, 2, 200)
    got = learn_with_spread(xy, values, weight, GRID).without(xy, values, weight)
    for i in range(0, 200, 13):
        rest = np.arange(200) != i
        wanted, _ = learn_mosaic(xy[rest], values[rest], weight[rest], GRID)(xy[i])
        assert got[i] == pytest.approx(wanted, abs=1e-9)
