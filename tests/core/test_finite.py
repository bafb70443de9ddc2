import numpy as np
import pytest

from tactsim.core import InputError
from tactsim.core.finite import LARGEST, finite


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1.001e9])
def test_the_first_number_that_may_not_enter_is_named(bad):
    table = np.zeros((3, 4))
    table[1, 2] = table[2, 0] = bad
    with pytest.raises(InputError, match=r"^readings\[1, 2\] is .*; only finite numbers up to 1e\+09 are"):
        finite(table, "readings")


def test_what_is_finite_passes_as_it_is():
    values = [LARGEST, -LARGEST, 0.0, 5e-324]
    assert finite(values, "x").tolist() == values
    assert finite([[1, 2]], "x").dtype == np.float64
    assert finite([], "x").shape == (0,)
