"""Pads: their taxels, their files, and lengths that follow them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tactsim.core import InputError, Pad
from tactsim.core.pad import OFFSET, offsets, pitch, relative_size, size
from tactsim.press import ScanOptions


def test_the_default_pad_is_the_paper_s():
    pad = Pad()
    assert pad.taxel_xy.shape == (36, 2)
    size = pad.taxel_xy.max(axis=0) - pad.taxel_xy.min(axis=0) + 1.8
    assert size == pytest.approx([11.6, 11.3])
    assert 36 * 1.8**2 / size.prod() == pytest.approx(0.89, abs=5e-3)
    assert pad.taxel_xy.mean(axis=0) == pytest.approx([0, 0])


def test_taxels_count_along_x_then_y_and_the_seam_is_in_the_middle():
    xy = Pad().taxel_xy
    assert np.diff(xy[:6, 0]) == pytest.approx([1.9, 1.9, 2.2, 1.9, 1.9])
    assert xy[6] - xy[0] == pytest.approx([0, 1.9])


def test_load_reaches_over_the_unread_columns():
    assert Pad().load_bounds == pytest.approx((-7.7, 7.7, -5.65, 5.65))


@pytest.mark.parametrize("gaps", [False, True])
def test_cells_fill_the_surface_that_carries_load(gaps):
    pad = Pad()
    for lines, low, high in zip(
        pad.grid_lines(2, gaps), pad.load_bounds[::2], pad.load_bounds[1::2], strict=True
    ):
        assert lines[0] == pytest.approx(low)
        assert lines[-1] == pytest.approx(high)
        assert (np.diff(lines) > 0).all()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("rows = 0", "rows"),
        ("pitch = 2", "pitch"),
        ("pitch_x = 1.0", "overlap"),
        ("columns = 5\nseam = 0.4", "even"),
    ],
)
def test_a_wrong_pad_file_gets_one_line(tmp_path, content, says):
    path = tmp_path / "pad.toml"
    path.write_text(content)
    with pytest.raises(InputError, match=says) as error:
        Pad.load(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("other", [{"rows": 3}, {"columns": 5}, {"pitch_x": 4.0}, {"taxel_width": 1.5}])
def test_a_pad_of_other_measures_keeps_no_seam_and_no_column_of_the_papers(other):
    pad = Pad(**other)
    assert (pad.seam, pad.unread_columns) == (None, 0)
    assert np.diff(pad.column_edges.mean(axis=1)) == pytest.approx(pad.pitch_x)
    stated = Pad(**other, unread_columns=2)
    assert (stated.seam, stated.unread_columns) == (None, 2)
    assert (Pad(rows=6, pitch_x=1.9).seam, Pad(unread_rows=1).unread_columns) == (0.4, 1)


@pytest.mark.parametrize(
    "change",
    [
        {"pad": {"pitch_x": 1e-300, "taxel_width": 1e-300}},
        {"pad": {"rows": 300, "columns": 300}},
        {"pad": {"rows": 60, "columns": 60}, "press": {"cells_per_taxel": 16}},
        {"sensor": {"resolution": 1e-320}},
    ],
)
def test_a_pad_without_a_finite_reading_is_refused_before_memory_is_asked_for(change):
    with pytest.raises(ValidationError):
        ScanOptions.model_validate(change)


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
