"""The bounds of tables, where tables are the same everywhere or hardly differ."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from tactsim.estimators.field.table_levels import levels_of


@pytest.mark.parametrize("value", [0, 1, 3, 254, 255, 256, 32_766, -1, -3, -300, -32_766])
def test_a_table_that_is_the_same_everywhere_is_bounded_inside_and_outside(value):
    # Of training readings that all are faults: its rim may not be 0, as it is outside.
    nodes = np.full((1, 1, 8, 8), value, dtype=np.int16)
    levels = levels_of(nodes, 0.25, (2, 2))
    assert levels.lowest[0] <= 0 < levels.step[0]
    bound = levels.lowest[0] + levels.step[0] * levels.level.astype(float)
    assert bound.min() >= 0.25 * min(value, 0)
    assert bound.max() >= 0.25 * max(value, 0)


def test_tables_of_different_spans_are_bounded_by_at_most_one_step_more_than_the_highest_of_four_nodes():
    nodes = np.zeros((3, 2, 12, 10), dtype=np.int16)
    inside = np.random.default_rng(0).normal(size=(3, 2, 10, 8)) * np.array([1, 300, 9_000]).reshape(
        3, 1, 1, 1
    )
    nodes[:, :, 1:-1, 1:-1] = inside
    levels = levels_of(nodes, 0.5, (3, 2))
    assert levels.step[0] / 0.5 <= np.ptp(nodes[2].astype(float)) // 255 + 1
    # As `laid_out` does it: 15 bytes before and after all, in each table 3 rows first, then planes of 4 rows and 3.
    planes = levels.level[15:-15].reshape(3, -1)[:, 3 * 5 :].reshape(3, 2, 3, 2, 7, 5)
    level = planes[..., :4, :].transpose(0, 1, 4, 2, 5, 3).reshape(3, 2, 12, 10)
    bound = levels.lowest.reshape(3, 1, 1, 1) + levels.step[0] * level
    largest = 0.5 * sliding_window_view(nodes, (2, 2), axis=(2, 3)).max(axis=(-2, -1))
    assert (bound[:, :, :-1, :-1] >= largest).all()
    assert (bound[:, :, :-1, :-1] < largest + levels.step[0]).all()
