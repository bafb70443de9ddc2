"""Pads: their taxels, files and lengths; resistive matrices without guards, against circuits solved node by node."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tactsim.core import InputError, Pad
from tactsim.core.matrix import mixed, of_uniform, unmixed
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
    [("rows = 0", "rows"), ("pitch = 2", "pitch"), ("pitch_x = 1.0", "overlap"),
     ("columns = 5\nseam = 0.4", "even")],
)  # fmt: skip
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
    [{"pad": {"pitch_x": 1e-300, "taxel_width": 1e-300}}, {"pad": {"rows": 300, "columns": 300}},
     {"pad": {"rows": 60, "columns": 60}, "press": {"cells_per_taxel": 16}},
     {"sensor": {"resolution": 1e-320}}],
)  # fmt: skip
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


def cells(rows, columns, seed=0, low=1.0, high=60.0):
    return np.random.default_rng(seed).uniform(low, high, (rows, columns))


def solved(conductance, row, column):
    """Drive a row by 1 V, hold a column at 0 and leave the other wires free: the current that is read.

    Every free wire has an unknown voltage and one equation: what flows into it flows out of it.
    """
    rows, columns = conductance.shape
    volts = np.full(rows + columns, np.nan)
    volts[row], volts[rows + column] = 1.0, 0.0
    between = np.zeros((rows + columns, rows + columns))
    between[:rows, rows:], between[rows:, :rows] = conductance, conductance.T
    free = np.flatnonzero(np.isnan(volts))
    known = np.flatnonzero(~np.isnan(volts))
    matrix = np.diag(between.sum(axis=1))[np.ix_(free, free)] - between[np.ix_(free, free)]
    volts[free] = np.linalg.solve(matrix, between[np.ix_(free, known)] @ volts[known])
    flows = between * (volts[:, None] - volts[None])
    # Kirchhoff's law at each free wire
    assert np.abs(flows.sum(axis=1)[free]).max(initial=0) < 1e-9 * flows.max()
    return float(flows[:, rows + column].sum())


def test_four_cells_by_hand():
    (a, b), (c, d) = conductance = np.array([[3.0, 5.0], [7.0, 11.0]])
    behind = [[(b, d, c), (a, c, d)], [(d, b, a), (c, a, b)]]
    by_hand = conductance + [[1 / sum(1 / cell for cell in way) for way in row] for row in behind]
    assert mixed(conductance) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize("shape", [(2, 3), (5, 9), (16, 16)])
def test_it_reads_the_current_of_the_network(shape):
    conductance = cells(*shape)
    read = mixed(conductance)
    for row, column in [(0, 0), (1, 2), (shape[0] - 1, shape[1] - 1)]:
        assert read[row, column] == pytest.approx(solved(conductance, row, column), rel=1e-10)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (3, 16)])
def test_a_uniform_load_reads_uniform(shape):
    assert mixed(np.full(shape, 4.2)) == pytest.approx(np.full(shape, of_uniform(4.2, *shape)), rel=1e-12)


def test_three_pressed_corners_light_up_the_fourth():
    conductance = np.full((6, 6), 1e-9)
    for corner in ((1, 1), (1, 4), (4, 1)):
        conductance[corner] = 30.0
    read = mixed(conductance)
    assert read[4, 4] == pytest.approx(10.0, rel=1e-6)  # three in a row conduct a third
    assert read[1, 1] == pytest.approx(30.0, rel=1e-6)
    rest = np.ones((6, 6), dtype=bool)
    rest[np.ix_([1, 4], [1, 4])] = False
    assert read[rest].max() < 1e-6
    assert unmixed(read, 1e-9)[4, 4] < 0.02 * read[4, 4]
    assert unmixed(read, 1e-9, steps=2000)[4, 4] < 0.001 * read[4, 4]


@given(st.tuples(st.integers(1, 7), st.integers(1, 7)), st.integers(0, 10**6), st.floats(1e-3, 1e3))
@settings(max_examples=40, deadline=None)
def test_it_is_undone_whatever_the_unit(shape, seed, unit):
    conductance = unit * cells(*shape, seed)
    assert unmixed(mixed(conductance), unit, steps=3000) == pytest.approx(conductance, rel=1e-4)
    assert mixed(conductance).min() >= conductance.min() * (1 - 1e-12)  # ways around only add


@given(st.integers(0, 10**6), st.integers(0, 35))
@settings(max_examples=30, deadline=None)
def test_no_cell_reads_less_when_another_conducts_more(seed, which):
    conductance = cells(6, 6, seed)
    more = conductance.copy()
    more.flat[which] *= 2
    assert (mixed(more) >= mixed(conductance) * (1 - 1e-12)).all()  # Rayleigh's law


def test_values_that_no_cells_give_are_met_as_nearly_as_cells_can():
    noisy = mixed(np.full((6, 6), 2.0)) + np.random.default_rng(1).normal(0, 2.0, (6, 6))
    found = unmixed(noisy, 2.0)
    assert (found >= 2.0).all()
    assert np.abs(found - 2.0).mean() < 2.0  # no more than the noise itself
    assert np.isfinite(unmixed(np.full((6, 6), -5.0), 2.0)).all()
