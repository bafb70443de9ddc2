"""The best coarse bins: that none is missed, that bounds hold, and that nothing beyond the tables is read."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import make_scan, paper_poses

from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.cells import bins_of, middles
from tactsim.estimators.filters.coarse_bounds import CoarseBins
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.likelihood import Evidence
from tactsim.estimators.likelihoods.load_mixture import LoadMixture
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

# Tables of three classes that count fully, and of pressures between which each reading interpolates; loads: 1 or 3.
MODELS = [("calibrated", 1), ("force", 1), ("calibrated", 3)]


def fitted(name, loads):
    scan = make_scan("EIL", poses=paper_poses(3, 4))
    options = LikelihoodOptions(likelihood=name)
    trained = np.count_nonzero(scan.split == "train")
    made = likelihood.create(options) if loads == 1 else LoadMixture(options, np.arange(trained) % loads)
    made.fit(scan, learn_maps(scan))
    return made, scan


@pytest.fixture(scope="module", params=MODELS, ids=str)
def model(request):
    return fitted(*request.param)


def field_of(model, grid, finest=0.4):
    made, scan = model
    return LikelihoodField(made, scan.letters, scan.taxel_xy, grid.spacing[:2], finest)


def of_all_bins(field, grid):
    """Replay all readings at the middle of every bin: (letters, angles, rows, columns)."""
    flat, states = np.arange(grid.bins), np.empty((3, grid.bins))
    middles(states, np.empty_like(flat), np.zeros_like(flat), flat, bins_of(grid))
    log_p = [field.log_p(letter, states) for letter in range(len(field.labels))]
    return np.reshape(log_p, (-1, grid.angle, grid.y, grid.x))


def waits(belief, field, grid):
    """Tell which bins wait: (letters, angles, rows, columns)."""
    seen = belief._coarse.seen.reshape(grid.angle, grid.y, grid.x, -1).transpose(3, 0, 1, 2)
    return seen < len(field)


@pytest.mark.parametrize("split", [(25, 25, 4), (12, 12, 10), (3, 5, 2), (33, 7, 3)])
@pytest.mark.parametrize(("keep", "within"), [(1, 0.0), (7, 3.0), (100, 20.0), (10**6, 1.0)])
def test_the_best_bins_are_those_of_all_bins(model, split, keep, within):
    made, scan = model
    grid = StateGrid(*split)
    field = field_of(model, grid)
    lazy, counted = [CoarseBins(field, grid, skip=skip) for skip in (True, False)], {}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        field.reset()
        for one in lazy:
            one.reset()
        for reading in rng.integers(len(scan), size=7):
            # One touch in seven contradicts the others, and one is off the map.
            field.append(
                made.evidence(scan.readings[reading]), rng.uniform(-1, 1, 3) * rng.choice([9, 9, 60])
            )
            everything = of_all_bins(field, grid).ravel()
            highest = np.sort(everything)[::-1]
            least = min(highest[0] - within, highest[min(keep, len(highest) - 1)])
            for one in lazy:
                counted[one] = counted.get(one, 0) + np.array(one.update(within, keep))
                flat, log_p = one.listed
                assert np.array_equal(log_p, everything[flat])  # to the bit
                assert len(set(flat.tolist())) == len(flat)
                assert np.isin(np.flatnonzero(everything >= least), flat).all()
                assert log_p.min() >= least - 2e-6
            assert np.array_equal(lazy[0].listed[0], lazy[1].listed[0])
    assert counted[lazy[1]].tolist() == [grid.bins * 3 * 14, 0]
    assert counted[lazy[0]].sum() == grid.bins * 3 * 14


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([9.0, 25.0, 60.0]))
def test_no_bin_is_above_its_bound(model, seed, reach):
    made, scan = model
    grid = StateGrid(12, 13, 5)
    field = field_of(model, grid)
    lazy = CoarseBins(field, grid, skip=True)
    rng = np.random.default_rng(seed)
    for reading in rng.integers(len(scan), size=6):
        field.append(made.evidence(scan.readings[reading]), rng.uniform(-reach, reach, 3))
        lazy.update(1.0, 3)
        everything, upper, waiting = of_all_bins(field, grid), lazy.upper_bounds(), waits(lazy, field, grid)
        assert (everything <= upper).all()
        assert np.array_equal(upper[~waiting], everything[~waiting])
        lead = lazy.certificate().lead
        assert 0 < lead <= everything.max() - upper[waiting].max(initial=-np.inf)


@pytest.mark.parametrize(
    ("split", "finest"),
    # Bins that are wide have many nodes within each; fewer of them have as many edges.
    [((25, 25, 4), 0.4), ((3, 5, 2), 1.0), ((1, 1, 1), 2.0), ((17, 33, 2), 0.4)],
)
def test_rows_that_hang_over_the_tables_read_no_bound_beyond_them(model, split, finest):
    made, scan = model
    grid = StateGrid(*split)
    field = field_of(model, grid, finest)

    def amid(values, what):
        around = np.full(3 * values.size, what, dtype=values.dtype)
        inside = around[values.size : 2 * values.size]
        inside[:] = values.ravel()
        return inside.reshape(values.shape)

    plain = CoarseBins(field, grid, skip=True)
    others = []
    for what in (-128, 127):
        other = CoarseBins(field, grid, skip=True)
        other._levels = plain._levels._replace(level=amid(plain._levels.level, what))
        others.append(other)
    rng = np.random.default_rng(0)
    for _ in range(4):
        field.reset()
        for belief in (plain, *others):
            belief.reset()
        # Anywhere from the middle of the map to far off it, so that every edge is hung over.
        for reach in (10, 30, 60, 1e4, 1e9):
            reading = scan.readings[rng.integers(len(scan))]
            field.append(made.evidence(reading), rng.uniform(-reach, reach, 3))
            plain.update(5.0, 20)
            assert (of_all_bins(field, grid) <= plain.upper_bounds()).all()
            for other in others:
                other.update(5.0, 20)
                assert np.array_equal(other.listed, plain.listed)
                assert np.array_equal(other.upper_bounds(), plain.upper_bounds())


def test_a_bin_that_waited_for_long_takes_in_what_it_waited_for(model):
    """Readings contradict each other at first, so that other bins lead later; several may be new at once."""
    made, scan = model
    grid = StateGrid(12, 13, 10)
    field = field_of(model, grid)
    lazy = CoarseBins(field, grid, skip=True)
    rng = np.random.default_rng(4)
    nothing = Evidence(
        np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.float32)
    )
    waited = 0
    for _ in range(2):
        field.reset()
        lazy.reset()
        for number, reading in enumerate(rng.integers(len(scan), size=24)):
            evidence = nothing if number in (0, 9) else made.evidence(scan.readings[reading])
            # From the ninth on all touches agree. The first say little, so that much may lead for a while.
            one = evidence if number > 8 else evidence.of_taxels(np.arange(36) < 3 * number)
            field.append(one, scan.poses[reading].copy() if number > 8 else rng.uniform(-9, 9, 3))
            if number % 5 == 2:
                continue
            before = lazy._coarse.seen.copy()
            lazy.update(2.0, 30)
            flat, log_p = lazy.listed
            everything = of_all_bins(field, grid)
            assert np.array_equal(log_p, everything.ravel()[flat])
            assert np.isin(np.flatnonzero(everything >= np.sort(everything.ravel())[-31]), flat).all()
            assert (everything <= lazy.upper_bounds()).all()
            waited = max(waited, len(np.unique(before[lazy._coarse.seen > before])))
    assert waited > 2  # some for longer than others, at one reading


@pytest.mark.parametrize("each", [1, 2, 3])
@pytest.mark.parametrize("weights", [(1.0,), (1.0, 0.25), (1.0, 1e-6, 0.0), (1e-30, 3e-30), (0.0,)])
def test_any_number_of_terms_and_any_weights_are_bounded(model, weights, each):
    """each: how many terms of a taxel follow each other, of which two are bounded together."""
    grid = StateGrid(12, 13, 5)
    field = field_of(model, grid)
    lazy = CoarseBins(field, grid, skip=True)
    highest = int(np.argmax(field.tables.highest))
    for terms in (1, 5, 63, 64, 65, 1024, 1025, 3001):
        table, taxel = np.full(terms, highest), np.arange(terms) // each % 36
        weight = np.resize(np.array(weights, dtype=np.float32), terms)
        field.append(Evidence(table, taxel, weight), np.array([1.0, 2.0, 0.3]))
        lazy.update(1.0, 3)
        everything, bound = of_all_bins(field, grid), lazy.upper_bounds()
        assert (everything <= bound).all()
        assert np.isfinite(bound).all()


class Edge:
    """A table that leaps from 0 to 30 nats at the edge of a square of 1 mm about a place."""

    loads = 1

    def __init__(self, place):
        self.extent = np.array(place) - 2.0, np.array(place) + 2.0

    def log_tables(self, label, xy):
        away = np.abs(np.asarray(xy) - (self.extent[0] + self.extent[1]) / 2)
        return np.where((away < 1).all(axis=-1), 30.0, 0.0)[None]


@pytest.mark.parametrize("beside", [0.0, 100.0, 1000.0])
def test_a_bound_holds_where_float32_moves_a_place_beyond_a_node(beside):
    """The farther a map lies from the bins, the more of a place is lost in float32."""
    grid = StateGrid(25, 25, 3)
    field = LikelihoodField(Edge([beside, 0.0]), ["edge"], np.zeros((1, 2)), grid.spacing[:2], 0.4)
    lazy, tables, rng = CoarseBins(field, grid, skip=True), field.tables, np.random.default_rng(0)
    rows, columns = (np.flatnonzero(tables.nodes[0, 0].any(axis=axis)) for axis in (1, 0))
    x, y, theta = grid.centres
    one = Evidence(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.float32))
    for _ in range(200):
        # Just before the last node that says nothing, as some bin sees it.
        node = tables.origin + tables.step * [columns[0] - 1, rng.choice(rows)]
        away = node - [rng.choice(x), rng.choice(y)] + [-(10.0 ** rng.uniform(-9, -4)), 1e-4]
        angle = rng.choice(theta)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        field.reset()
        lazy.reset()
        field.append(one, np.array([*(turn @ away), 0.0]))
        lazy.update(0.0, 0)
        assert (of_all_bins(field, grid) <= lazy.upper_bounds()).all()
