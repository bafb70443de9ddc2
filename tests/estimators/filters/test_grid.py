import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import InputError
from tactsim.estimators.filters.grid import StateGrid, _mean_square, state_grid


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
    assert grid.describe() == "16 x 20 x 36 = 11,520 bins a letter, each 1.25 mm x 1 mm x 10 deg"


@pytest.mark.parametrize("split", ["16x16", "0x5x5", "axbxc", "1.5x2x2", "5000x5000x5000"])
def test_what_is_no_split_is_refused(split):
    with pytest.raises(InputError, match="16x16x36"):
        state_grid(10_000, split)


@pytest.mark.parametrize("bins", [0, -5, 10**9])
def test_impossible_counts_are_refused(bins):
    with pytest.raises(InputError, match="bins"):
        state_grid(bins)
