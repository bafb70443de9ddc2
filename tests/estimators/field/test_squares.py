"""Squares of states beside the same states one by one."""

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.squares import replay_squares
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.likelihood import Evidence
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

# mm between the nodes of the tables.
STEP = 0.4
# Of which squares are so many apart: into windows of three rows, of four, and into none.
APART = [0.05, 0.6, 0.98, 1.2, 1.98, 2.0, 5.0]


@pytest.fixture(scope="module", params=["paper", "calibrated", "force"])
def model(request):
    scan = make_scan("EIL", poses=paper_poses(3, 4))
    made = likelihood.create(LikelihoodOptions(likelihood=request.param))
    made.fit(scan, learn_maps(scan))
    return made, scan


def new_field(model):
    made, scan = model
    return LikelihoodField(made, scan.letters, scan.taxel_xy, (STEP, STEP), STEP)


def begun(model, readings):
    field, rng = new_field(model), np.random.default_rng(readings)
    for _ in range(readings):
        reading = model[1].readings[rng.integers(len(model[1]))]
        field.append(model[0].evidence(reading), rng.uniform(-8, 8, 3))
    return field


def some_squares(count, wide, tall, reach=12.0):
    """x, y (count, 2), angles and letters of squares anywhere within so many mm."""
    rng = np.random.default_rng(count)
    corner = rng.uniform(-reach, reach, (2, count, 1))
    x, y = corner[0] + [0, wide], corner[1] + [0, tall]
    return x, y, rng.uniform(-9, 9, count), rng.integers(3, size=count)


def states_of(x, y, angle):
    """The states [y, x] of squares: (3, 4 * count)."""
    count = len(angle)
    states = np.broadcast_to(x[:, None, :], (count, 2, 2)), np.broadcast_to(y[:, :, None], (count, 2, 2))
    return np.stack([*(one.ravel() for one in states), np.repeat(angle, 4)])


def replayed(field, x, y, angle, letter, wide, tall, first=0, last=None):
    log_p = np.zeros((len(letter), 4))
    replay_squares(
        log_p, x, y, angle, letter, wide, tall, field.terms, field.vectors, first,
        len(field) if last is None else last, field.tables.sampled,
    )  # fmt: skip
    return log_p


def one_by_one(field, x, y, angle, letter):
    return field.log_p(np.repeat(letter, 4), states_of(x, y, angle)).reshape(-1, 4)


def rounding(field):
    """By how much two sums may differ that are rounded in different orders, nats."""
    return 2 * field.terms.slack[: len(field)].sum()


@pytest.mark.parametrize("tall", APART)
@pytest.mark.parametrize("wide", APART)
def test_a_square_is_four_states(model, wide, tall):
    field, squares = begun(model, 3), some_squares(60, wide * STEP, tall * STEP)
    got, expected = (
        replayed(field, *squares, wide * STEP, tall * STEP),
        one_by_one(field, *squares),
    )
    assert np.ptp(expected) > 1
    # Sums are rounded in another order; where squares are too large for windows it is the same code.
    assert np.abs(got - expected).max() <= (0 if max(wide, tall) >= 2 else rounding(field))


@pytest.mark.parametrize("reach", [30.0, 1e3, 3e7])
def test_at_the_rim_and_beyond_squares_read_what_states_do(model, reach):
    field = begun(model, 2)
    for apart in (0.5, 1.5):
        squares = some_squares(400, apart * STEP, apart * STEP, reach)
        got = replayed(field, *squares, apart * STEP, apart * STEP)
        assert np.abs(got - one_by_one(field, *squares)).max() <= rounding(field)


@pytest.mark.parametrize("squares", [1, 2, 5, 6, 16, 17, 40])  # as many as are done at once, and more
def test_a_square_does_not_depend_on_those_beside_it(model, squares):
    field, every = begun(model, 3), some_squares(40, 0.3, 0.3)
    expected = replayed(field, *every, 0.3, 0.3)
    assert np.array_equal(replayed(field, *(part[:squares] for part in every), 0.3, 0.3), expected[:squares])


def test_readings_are_added_one_by_one_in_however_many_calls(model):
    field, squares = begun(model, 4), some_squares(23, 0.3, 0.5)
    parts = (replayed(field, *squares, 0.3, 0.5, k, k + 1) for k in range(4))
    assert np.array_equal(sum(parts), replayed(field, *squares, 0.3, 0.5))


def test_vectors_are_those_of_all_readings_however_often_they_are_asked_for(model):
    """Past several times that their arrays grow, and again after a reset."""
    made, scan = model
    field, late, squares = new_field(model), new_field(model), some_squares(9, 0.3, 0.3)
    rng = np.random.default_rng(0)
    for asked in (2, 30, 7):
        field.reset()
        late.reset()
        for number in range(200):
            evidence = made.evidence(scan.readings[rng.integers(len(scan))])
            # Also readings of many more terms than the arrays have room for at first.
            times = 100 if number in (3, 150) else 1
            many = Evidence(
                *(np.tile(part, times) for part in (evidence.table, evidence.taxel, evidence.weight))
            )
            pose = rng.uniform(-8, 8, 3)
            for one in (field, late):
                one.append(many, pose)
            if number % asked == 0:
                replayed(field, *squares, 0.3, 0.3)
        got = replayed(field, *squares, 0.3, 0.3)
        assert np.array_equal(got, replayed(late, *squares, 0.3, 0.3))
        assert np.abs(got - one_by_one(field, *squares)).max() <= rounding(field)


def test_windows_of_three_and_of_four_rows_say_the_same(model):
    field, squares = begun(model, 3), some_squares(90, 0.3, 0.3)
    low, tall = (replayed(field, *squares, 0.3, apart * STEP) for apart in (0.8, 1.8))
    assert np.array_equal(low, tall)


@pytest.mark.parametrize("counts", [(1,), (2,), (3,), (1, 2), (2, 2, 2, 5), (36,)])
@pytest.mark.parametrize("terms", [0, 1, 2, 15, 16, 17, 31, 32, 33, 40, 71, 72, 73, 700])
def test_terms_may_come_in_any_number_and_order(model, terms, counts):
    """counts: how many terms of a taxel follow each other, in turns."""
    field, rng = new_field(model), np.random.default_rng(terms)
    for _ in range(2):
        taxel = np.repeat(np.arange(terms) % 36, np.resize(counts, terms))[:terms]
        kinds = rng.integers(len(field.tables.nodes), size=terms)
        weight = rng.uniform(0, 1, terms).astype(np.float32)
        field.append(Evidence(kinds, taxel, weight), rng.uniform(-5, 5, 3))
    squares = some_squares(7, 0.3, 0.3, 6.0)
    got, expected = replayed(field, *squares, 0.3, 0.3), one_by_one(field, *squares)
    assert np.abs(got - expected).max() <= rounding(field)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_square_that_is_nowhere_disturbs_no_other(model, wrong, axis):
    field, squares = begun(model, 2), some_squares(20, 0.3, 0.3)
    expected = replayed(field, *squares, 0.3, 0.3)
    squares[axis][7] = wrong
    got, others = replayed(field, *squares, 0.3, 0.3), np.arange(20) != 7
    assert np.array_equal(got[others], expected[others])


class Narrow:
    """A table with fewer nodes than a window."""

    extent = np.array([-0.4, -20.0]), np.array([0.4, 20.0])

    def log_tables(self, label, xy):
        return np.where((np.abs(np.asarray(xy)) < self.extent[1] / 2).all(axis=-1), 3.0, 0.0)[None]


def test_tables_that_are_smaller_than_a_window_are_read_without():
    field = LikelihoodField(Narrow(), "ABC", np.zeros((1, 2)), (STEP, STEP), STEP)
    assert min(field.tables.nodes.shape[2:]) < 4
    one = Evidence(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.float32))
    field.append(one, np.zeros(3))
    squares = some_squares(500, 0.3, 0.3, 1.0)
    got = replayed(field, *squares, 0.3, 0.3)
    assert got.max() > 1
    assert np.array_equal(got, one_by_one(field, *squares))


@pytest.mark.parametrize("apart", [0.6, 1.6])
def test_nothing_is_read_beyond_the_tables(model, apart):
    """What lies before and after them in memory changes nothing, wherever squares lie."""
    field = begun(model, 2)
    squares = some_squares(2_000, apart * STEP, apart * STEP, 40.0)
    expected = replayed(field, *squares, apart * STEP, apart * STEP)
    nodes = field.tables.nodes
    for beyond in (-32_768, 32_767):
        around = np.full(3 * nodes.size, beyond, dtype=np.int16)
        inside = around[nodes.size : 2 * nodes.size].reshape(nodes.shape)
        inside[:] = nodes
        log_p = np.zeros_like(expected)
        replay_squares(
            log_p, *squares, apart * STEP, apart * STEP, field.terms, field.vectors, 0, 2,
            field.tables.sampled._replace(nodes=inside),
        )  # fmt: skip
        assert np.array_equal(log_p, expected)
