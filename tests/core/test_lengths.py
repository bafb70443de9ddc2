import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import Pad
from tactsim.core.pad import OFFSET, offsets, pitch, relative_size, size


def test_the_paper_s_pad_is_the_measure():
    pad = Pad()
    assert pitch(pad.taxel_xy) == pytest.approx(1.9)
    assert size(pad.taxel_xy) == pytest.approx(np.sqrt((9.8 + 1.9) * (9.5 + 1.9)))
    assert (relative_size(pad.taxel_xy), offsets(pad.taxel_xy)) == (1.0, OFFSET)


@given(st.floats(0.05, 50), st.integers(2, 9), st.integers(2, 9))
def test_lengths_follow_the_pad(k, rows, columns):
    pad = Pad(rows=rows, columns=columns, seam=None)
    assert pitch(k * pad.taxel_xy) == pytest.approx(k * pitch(pad.taxel_xy))
    assert size(k * pad.taxel_xy) == pytest.approx(k * 1.9 * np.sqrt(rows * columns))
    assert relative_size(k * pad.taxel_xy) == pytest.approx(
        size(k * pad.taxel_xy) / size(Pad().taxel_xy), rel=0.031
    )


def test_a_masked_taxel_or_row_changes_little():
    taxels = Pad().taxel_xy
    assert relative_size(np.delete(taxels, [0, 7, 14], axis=0)) == 1.0
    assert 0.9 < relative_size(taxels[6:]) < 0.95
    assert 1.9 - 1e-9 < pitch(taxels[::2]) < 3.9
