"""The bounds of tables, where tables are the same everywhere or hardly differ."""

import numpy as np
import pytest

from tactsim.estimators.field.table_levels import levels_of


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e-7, 3.0, -1e-30, -3.0])
def test_a_table_that_is_the_same_everywhere_is_bounded_inside_and_outside(value):
    # Of training readings that all are faults: its rim may not be 0, as it is outside.
    nodes = np.full((1, 1, 8, 8), value, dtype=np.float32)
    levels = levels_of(nodes, (2, 2))
    assert levels.lowest[0] <= 0 < levels.step[0]
    bound = levels.lowest[0] + levels.step[0] * levels.level.astype(float)
    assert bound.min() >= min(value, 0.0) * (1 + 1e-6)
    assert bound.max() >= max(value, 0.0) * (1 - 1e-6)
