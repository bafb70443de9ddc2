"""Resistive matrices without guards, against circuits solved by hand and node by node."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.core.matrix import mixed, of_uniform, unmixed


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
    assert (
        np.abs(flows.sum(axis=1)[free]).max(initial=0) < 1e-9 * flows.max()
    )  # Kirchhoff's law at each free wire
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
