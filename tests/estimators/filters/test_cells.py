"""Cells of different sizes and their halving, against plain code that evaluates all of them at every reading."""

import math

import numpy as np
import pytest
from synthetic import draw_trial

from tactsim.estimators.filters.cells import Cells, held, least_chosen
from tactsim.estimators.filters.refined import RefinedFilter, RefinedOptions
from tactsim.estimators.filters.states import Weights

LETTERS = "EIL"


def halves(grid, times, cell):
    """Eight cells of half the size for each of n cells: flat indices (n, 8)."""
    shape = len(LETTERS), grid.angle << times, grid.y << times, grid.x << times
    letter, *place = np.unravel_index(cell, shape)
    within = [
        [2 * axis + k for axis, k in zip(place, (part >> 2, part >> 1 & 1, part & 1), strict=True)]
        for part in range(8)
    ]
    finer = shape[0], *(2 * count for count in shape[1:])
    return np.stack([np.ravel_multi_index((letter, *one), finer) for one in within], axis=-1)


def plainly(filter, cell, log_p):
    """Halve cells as the filter's docstring says; returns what is left of each size, as it is and in what it holds."""
    options, weight, left = filter.options, filter.trust(len(filter.field)), []
    for times in range(options.halvings):
        if times >= 3 and Weights(weight * log_p).ess > 64:
            break
        most = np.sort(log_p)[::-1]
        chosen = log_p > (most[options.cells] if options.cells < len(most) else -np.inf)
        left.append((cell[~chosen], log_p[~chosen]))
        cell = halves(filter.grid, times, np.sort(cell[chosen])).ravel()
        smaller = Cells(filter.grid, np.full(len(cell), times + 1), cell)
        log_p = filter.field.log_p(smaller.letter, smaller.states)
    return [*left, (cell, log_p)]


@pytest.mark.parametrize("skip", [True, False])
@pytest.mark.parametrize(
    "options",
    [{}, {"cells": 7, "halvings": 5}, {"split": "5x7x9", "cells": 5000, "halvings": 1}, {"halvings": 0}],
)
def test_cells_are_halved_as_in_plain_code(scan, options, skip):
    filter, depths = RefinedFilter(RefinedOptions(**{"bins": 500, "skip": skip, **options})), set()
    filter.fit(scan)
    for seed in range(2):
        filter.reset(np.random.default_rng(0))
        trial = draw_trial(scan, LETTERS[seed], 6, np.random.default_rng(seed))
        other = draw_trial(
            scan, LETTERS[seed + 1], 3, np.random.default_rng(seed)
        )  # which contradicts the first
        for reading, pose in (*zip(*trial[:2], strict=True), *zip(*other[:2], strict=True)):
            filter.update(reading, pose)
            expected = plainly(filter, *filter._coarse.listed)
            end, cell, log_p = filter._leaves
            depths.add(len(end))
            assert np.diff(end, prepend=0).tolist() == [len(one) for one, _ in expected]
            assert cell.tolist() == np.concatenate([one for one, _ in expected]).tolist()
            assert log_p.tolist() == np.concatenate([one for _, one in expected]).tolist()
    if options:
        assert max(depths) == filter.options.halvings + 1
    else:
        assert len(depths) > 1, "it ends sooner and later"


def test_of_equal_cells_all_are_chosen_or_none():
    values = np.array([3.0, 1.0, 3.0, 5.0, 3.0, 0.0])
    for count, chosen in ((1, [3]), (2, [3]), (4, [0, 2, 3, 4]), (5, [0, 1, 2, 3, 4])):
        assert np.flatnonzero(values > least_chosen(values, count)).tolist() == chosen
    assert least_chosen(values, 6) == least_chosen(values, 9) == -np.inf
    assert not (np.zeros(5) > least_chosen(np.zeros(5), 3)).any()


def test_a_cell_holds_its_likelihood_times_its_volume():
    end, cell = np.array([2, 2, 5]), np.array([3, 1, 40, 41, 47])
    log_p = np.array([-10.0, -400.0, 0.0, -3.0, -50.0])
    times, index, log_weight = held(end, cell, log_p, 0.5, 20.0)
    volume = 2 * math.log(8)
    assert (times.tolist(), index.tolist()) == ([0, 2, 2], [3, 40, 41])
    assert log_weight == pytest.approx([-5 + volume, 0, -1.5])
