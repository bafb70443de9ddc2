"""The log-likelihood of a sequence, against sums written down plainly."""

from dataclasses import replace

import numpy as np
import pytest
import reference
from synthetic import make_scan, model_of, paper_poses, started

from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.table_field import TableField


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(3, 4))


@pytest.fixture(scope="module", params=["paper", "calibrated", "force"])
def model(request, scan):
    return model_of(request.param, scan)


def begun(model, scan, readings, spacing=(0.4, 0.4)):
    """A field with some readings, and the terms (evidence, pose) of each."""
    field = TableField(model, scan.letters, scan.taxel_xy, spacing, 0.4)
    rng = np.random.default_rng(readings)
    told = []
    for _ in range(readings):
        told.append((model.evidence(scan.readings[rng.integers(len(scan))]), rng.uniform(-8, 8, 3)))
        field.add(*told[-1])
    return field, told


def plainly(field, letter, state, evidence, pose):
    """One reading at one state: bilinear between the nodes, term by term."""
    tables, total = field.tables, 0.0
    at = reference.place(state, reference.place(pose, field.taxel_xy))
    for kind, taxel, weight in zip(evidence.table, evidence.taxel, evidence.weight, strict=True):
        nodes = tables.nodes[kind, letter].astype(float)
        there = reference.interpolate(nodes, tables.origin, tables.step, *at[taxel], 0.0)
        total += float(weight) * (tables.unit * there + tables.outside[kind, letter])
    return total


@pytest.mark.parametrize("spacing", [(0.4, 0.4), (1.3, 0.9)])
def test_log_p_is_the_sum_of_interpolated_tables(model, scan, spacing):
    field, told = begun(model, scan, 3, spacing)
    rng = np.random.default_rng(0)
    letter, state = rng.integers(3, size=20), rng.uniform(-12, 12, (3, 20))
    expected = np.array(
        [[plainly(field, own, pose, *one) for own, pose in zip(letter, state.T, strict=True)] for one in told]
    )
    assert np.ptp(expected) > 1
    for first, last in ((0, None), (0, 3), (1, 2), (2, None), (1, 1)):
        got = field.log_p(letter, state, first, last)
        assert got == pytest.approx(expected[first:last].sum(axis=0), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("states", [1, 128, 300])  # less, as many and more than are done at once
def test_readings_are_added_one_by_one_in_however_many_calls(model, scan, states):
    field, _ = begun(model, scan, 4)
    rng = np.random.default_rng(states)
    letter, state = rng.integers(3, size=states), rng.uniform(-9, 9, (3, states))
    total, each = np.zeros(states), [field.log_p(letter, state, k, k + 1) for k in range(4)]
    for log_p in each:
        total = total + log_p
    assert (total == field.log_p(letter, state)).all()
    for said in (field.each(letter, state, 1, 4), LikelihoodField.each(field, letter, state, 1, 4)):
        assert np.array_equal(said, each[1:])
    some = slice(states // 3, None)
    assert (field.log_p(letter[some], state[:, some]) == total[some]).all()


@pytest.mark.parametrize(("axis", "wrong"), [(0, np.nan), (1, -np.inf), (2, np.inf)])
def test_a_state_that_is_nowhere_disturbs_no_other(model, scan, wrong, axis):
    field, _ = begun(model, scan, 2)
    state = np.random.default_rng(0).uniform(-9, 9, (3, 40))
    expected = field.log_p(1, state)
    state[axis, 7] = wrong
    got = field.log_p(1, state)
    others = np.arange(40) != 7
    assert np.array_equal(got[others], expected[others])


def test_a_field_that_was_reset_is_as_new(model, scan):
    field, told = begun(model, scan, 200)  # past several times that its arrays grow
    state = np.random.default_rng(0).uniform(-9, 9, (3, 7))
    last = field.log_p(0, state, 199)
    field.reset()
    assert len(field) == 0
    assert not field.log_p(0, state).any()
    field.add(*told[-1])
    assert (field.log_p(0, state) == last).all()


@pytest.mark.parametrize(
    ("name", "value"), [("table", 64), ("table", -1), ("taxel", 36), ("weight", -1.0), ("weight", np.nan)]
)
def test_a_likelihood_that_names_what_does_not_exist_is_stopped(model, scan, name, value):
    field, told = begun(model, scan, 2)
    state = np.random.default_rng(0).uniform(-9, 9, (3, 7))
    before = field.log_p(1, state)
    faulty = getattr(told[0][0], name).copy()
    faulty[3] = value
    with pytest.raises(ValueError, match="a likelihood"):
        field.add(replace(told[0][0], **{name: faulty}), np.zeros(3))
    assert (field.log_p(1, state) == before).all()


@pytest.mark.parametrize("name", ["histogram", "particle"])
def test_no_state_is_above_the_upper_bound(name, scan):
    filter = started(name, scan)
    for k in range(6):
        filter.update(scan.readings[7 * k], scan.poses[7 * k])
    state = np.random.default_rng(1).uniform(-10, 10, (3, 5000))
    bound = filter.field.terms.upper[len(filter.field)]
    highest = max(filter.field.log_p(letter, state).max() for letter in range(3))
    assert highest <= bound < 0
