import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import CHEAPER, draw_trial, fitted, follow, quick_first

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.filters.cells import Cells, held, least_chosen
from tactsim.estimators.filters.grid import StateGrid, _mean_square, state_grid
from tactsim.estimators.filters.refined import RefinedFilter, RefinedOptions
from tactsim.estimators.filters.states import Weights


@pytest.mark.parametrize(("bins", "split"), [(100, (5, 5, 4)), (1000, (10, 10, 10)), (10_000, (25, 25, 16))])
def test_table_1_is_split_as_printed(bins, split):
    grid = state_grid(bins)
    assert (grid.x, grid.y, grid.angle) == split
    assert grid.bins == bins


@given(st.integers(1, 2_000_000))
def test_any_other_count_is_nearly_used_and_never_exceeded(bins):
    grid = state_grid(bins)
    assert 1 <= grid.bins <= bins
    assert grid.x == grid.y
    assert grid.bins > bins - grid.x**2


@pytest.mark.parametrize("split", [(5, 5, 4), (20, 7, 3), (3, 40, 50), (1, 1, 1)])
def test_the_mean_square_is_that_of_a_ring_s_points_by_brute_force(split):
    # A point 9 mm from the centre, the state uniform in a bin; the bin's centroid holds it unmoved.
    grid = StateGrid(*split)
    middle = (np.arange(200) + 0.5) / 200 - 0.5
    dx, dy, turn = (middle * size for size in grid.spacing)
    shift = (dx**2).mean() + (dy**2).mean()
    turned = np.mean(np.abs(9 * np.exp(1j * turn) - 9) ** 2)
    assert _mean_square(grid) == pytest.approx(shift + turned, rel=1e-4)


@given(st.integers(1, 60), st.integers(1, 60), st.integers(1, 60), st.floats(0.1, 50))
def test_bins_cover_the_space_in_equal_parts(x, y, angle, reach):
    grid = StateGrid(x, y, angle, reach)
    for centres, spacing, size, begin in zip(
        grid.centres, grid.spacing, (2 * reach, 2 * reach, 2 * math.pi), (-reach, -reach, -math.pi),
        strict=True,
    ):  # fmt: skip
        assert len(centres) * spacing == pytest.approx(size)
        assert centres[0] == pytest.approx(begin + spacing / 2)
        assert np.diff(centres) == pytest.approx(spacing)


@given(st.integers(1, 30), st.integers(1, 30), st.floats(1, 50), st.floats(1, 20))
def test_bins_of_a_grid_that_reaches_farther_are_more_and_not_wider(x, y, usual, times):
    grid = StateGrid(x, y, 5, usual)
    far = grid.reaching(times * usual, usual, 10**9)
    assert far.reach == times * usual
    assert far.angle == 5
    for axis, count in enumerate((x, y)):
        assert far.spacing[axis] >= grid.spacing[axis] * (1 - 1e-9)  # as many as whole bins fit in
        assert (2 * far.reach / grid.spacing[axis] - (far.x, far.y)[axis]) < 1 + 1e-6 * count
    assert grid.reaching(usual, usual, 10**9) == grid
    assert grid.reaching(usual / 2, usual, 10**9) == StateGrid(x, y, 5, usual / 2)


@given(st.floats(1, 100), st.integers(1, 10**6))
def test_a_grid_that_reaches_farther_has_at_most_so_many_bins(times, most):
    grid = StateGrid(12, 12, 34)
    far = grid.reaching(10 * times, 10.0, most)
    assert grid.bins <= far.bins <= max(most, grid.bins)
    assert far.x == far.y


@pytest.mark.parametrize("split", ["16x20x36", "16,20,36", " 16 x 20 x 36 "])
def test_an_explicit_split_is_taken(split):
    grid = state_grid(10_000, split)
    assert (grid.x, grid.y, grid.angle) == (16, 20, 36)
    assert grid.describe() == "16 x 20 x 36 = 11,520 bins an object, each 1.25 mm x 1 mm x 10 deg"


@pytest.mark.parametrize("split", ["16x16", "0x5x5", "axbxc", "1.5x2x2", "5000x5000x5000"])
def test_what_is_no_split_is_refused(split):
    with pytest.raises(InputError, match="16x16x36"):
        state_grid(10_000, split)


@pytest.mark.parametrize("bins", [0, -5, 10**9])
def test_impossible_counts_are_refused(bins):
    with pytest.raises(InputError, match="bins"):
        state_grid(bins)


NOT_SHOWING = ("synthesis", "nearest", "bag-of-features", "whole-image", "space-refined")
SHOWING = [name for name in estimators.names() if name not in NOT_SHOWING]


def begun(name, scan, count, **options):
    """Give an estimator after `count` readings."""
    estimator = fitted(name, scan, **CHEAPER.get(name, {}), **options)
    readings, poses, _ = draw_trial(scan, "L", count, np.random.default_rng(5))
    follow(estimator, readings, poses)
    return estimator


@pytest.mark.parametrize("count", [0, 4])
@pytest.mark.parametrize("name", quick_first(SHOWING))
def test_a_plane_says_of_each_letter_what_the_estimate_says(name, count, scan):
    estimator = begun(name, scan, count)
    plane = estimator.belief_over_plane()
    assert plane.probability.shape == (len(plane.labels), len(plane.y), len(plane.x))
    assert plane.probability.min() >= 0
    assert plane.probability.sum() == pytest.approx(1)
    said = estimator.estimate().probabilities
    for label, mass in zip(plane.labels, plane.probability.sum(axis=(1, 2)), strict=True):
        assert mass == pytest.approx(said[label], abs=1e-6)


@pytest.mark.parametrize("split", ["25x25x16", "3x9x2"])
def test_bins_that_are_skipped_are_not_missed_in_the_plane(split, scan):
    planes = [
        begun("histogram", scan, 4, split=split, skip=skip).belief_over_plane() for skip in (True, False)
    ]
    assert planes[0].probability == pytest.approx(planes[1].probability, abs=1e-7)


def test_the_plane_lies_as_the_estimate_does(scan):
    # One angle: the plane's peak is the joint mode.
    estimator = begun("histogram", scan, 4, split="11x8x1")
    plane, estimate = estimator.belief_over_plane(), estimator.estimate()
    letter, row, column = np.unravel_index(plane.probability.argmax(), plane.probability.shape)
    assert plane.labels[letter] == estimate.label
    assert [plane.x[column], plane.y[row]] == pytest.approx(estimate.robot_in_object[:2])


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
        # It contradicts the first
        other = draw_trial(scan, LETTERS[seed + 1], 3, np.random.default_rng(seed))
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
