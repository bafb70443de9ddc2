"""The log-belief of bins, by both engines: none of the best is missed, bounds hold, nothing beyond tables is read."""

import math

import numpy as np
import pytest
from synthetic import field_of, make_scan, model_of, of_all_bins, paper_poses

from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.binned import BinnedBelief
from tactsim.estimators.filters.cells import Cells
from tactsim.estimators.filters.coarse_bounds import CoarseBins
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.states import Weights, pose_samples
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.likelihood import Evidence
from tactsim.estimators.likelihoods.load_mixture import LoadMixture
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

# Tables of three classes that count fully, of pressures between which each reading interpolates, both; loads: 1 or 3.
MODELS = [("calibrated", 1), ("force", 1), ("stacked", 1), ("calibrated", 3)]


@pytest.fixture(scope="module", params=MODELS, ids=str)
def model(request):
    name, loads = request.param
    scan = make_scan("EIL", poses=paper_poses(3, 4))
    options = LikelihoodOptions(likelihood=name)
    trained = np.count_nonzero(scan.split == "train")
    made = likelihood.create(options) if loads == 1 else LoadMixture(options, np.arange(trained) % loads)
    made.fit(scan, learn_maps(scan))
    return made, scan


@pytest.fixture(scope="module")
def plain():
    """Give the paper's likelihood, whose table of what is not known says nothing."""
    scan = make_scan("EI", poses=paper_poses(3, 4))
    return model_of("paper", scan), scan


def waits(belief, field, grid):
    """Tell which bins wait: (letters, angles, rows, columns)."""
    if isinstance(belief, BinnedBelief):
        return belief.log_belief() == -np.inf
    seen = belief._coarse.seen.reshape(grid.angle, grid.y, grid.x, -1).transpose(3, 0, 1, 2)
    return seen < len(field)


def upper_bounds(belief, field, grid):
    """Give a bound that no bin is above, of a bin itself or of its plane: (letters, angles, rows, columns)."""
    if isinstance(belief, CoarseBins):
        return belief._coarse.upper.reshape(grid.angle, grid.y, grid.x, -1).transpose(3, 0, 1, 2)
    planes, most = belief._belief, field.terms.upper
    bounds = planes.peak + (most[len(field)] - most[planes.seen])
    return np.broadcast_to(bounds[:, :, None, None], planes.log_p.shape)


@pytest.mark.parametrize(
    ("model", "engine"),
    # Touches that may be of several loads are never given to the first.
    [*((one, BinnedBelief) for one in MODELS[:2]), *((one, CoarseBins) for one in MODELS)],
    indirect=["model"],
    ids=str,
)
@pytest.mark.parametrize(
    ("split", "keep", "within"),
    [
        ((25, 25, 4), 1, 0.0),
        ((12, 12, 10), 7, 3.0),
        ((33, 7, 3), 100, 20.0),
        ((3, 5, 2), 1000, 1.0),  # more than there are
    ],
)
def test_the_best_bins_are_those_of_all_bins_and_none_is_above_its_bound(model, engine, split, keep, within):
    made, scan = model
    grid = StateGrid(*split)
    field = field_of(model, grid)
    lazy, full = beliefs = [engine(field, grid, skip=skip) for skip in (True, False)]
    counted = np.zeros((2, 2), dtype=int)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        for one in (field, *beliefs):
            one.reset()
        for reading in rng.integers(len(scan), size=7):
            # One touch in seven contradicts the others, and one is off the map.
            field.add(made.evidence(scan.readings[reading]), rng.uniform(-1, 1, 3) * rng.choice([9, 9, 60]))
            counted += [belief.update(within, keep) for belief in beliefs]
            everything = of_all_bins(field, grid)
            if engine is BinnedBelief:  # it rounds in an order of its own
                rounding = field.terms.slack[: len(field)].sum()
                assert np.allclose(full.log_belief(), everything, rtol=0, atol=2 * rounding)
                everything = full.log_belief()
            highest = np.sort(everything, axis=None)[::-1]
            least = min(highest[0] - within, highest[min(keep, len(highest) - 1)])
            for belief in beliefs:
                flat, log_p = belief.listed
                assert np.array_equal(log_p, everything.ravel()[flat])  # to the bit
                assert len(np.unique(flat)) == len(flat)
                assert np.isin(np.flatnonzero(everything >= least), flat).all()
                assert log_p.min() >= least - 2e-6
            assert np.array_equal(lazy.listed[0], full.listed[0])
            upper, waiting = upper_bounds(lazy, field, grid), waits(lazy, field, grid)
            assert (everything <= upper + 1e-9 * (engine is BinnedBelief)).all()
            assert engine is BinnedBelief or np.array_equal(upper[~waiting], everything[~waiting])
            assert upper[waiting].max(initial=-np.inf) < everything.max()
    assert counted[1].tolist() == [len(field.labels) * grid.bins * 14, 0]
    assert counted[0].sum() == counted[1].sum()


@pytest.mark.parametrize("split", [(25, 25, 4), (1, 1, 1), (17, 33, 2)])
@pytest.mark.parametrize("what", [-32_768, 32_767])
def test_planes_that_hang_over_the_tables_read_nothing_beyond_them(plain, split, what, monkeypatch):
    lattice_of = TableField.lattice

    def amid(*args):
        lattice = lattice_of(*args)
        around = np.full(3 * lattice.nodes.size, what, dtype=np.int16)
        inside = around[lattice.nodes.size : 2 * lattice.nodes.size]
        inside[:] = lattice.nodes
        return lattice._replace(nodes=inside)

    made, scan = plain
    grid = StateGrid(*split)
    field = field_of(plain, grid)
    expected = BinnedBelief(field, grid, skip=True)
    monkeypatch.setattr(TableField, "lattice", amid)
    belief = BinnedBelief(field, grid, skip=True)
    rng = np.random.default_rng(0)
    for _ in range(4):
        for one in (field, belief, expected):
            one.reset()
        # Anywhere from the middle of the map to far off it, so that every edge is hung over.
        for reach in (10, 30, 60, 1e4, 1e9):
            reading = scan.readings[rng.integers(len(scan))]
            field.add(made.evidence(reading), rng.uniform(-reach, reach, 3))
            belief.update(20.0)
            expected.update(20.0)
        mass, mode = belief.summary()
        assert np.array_equal(mass, expected.summary()[0])
        assert np.array_equal(belief.log_belief(), expected.log_belief())
        assert np.array_equal(upper_bounds(belief, field, grid), upper_bounds(expected, field, grid))
        assert np.isfinite(mass).all()
        assert mode.max() >= 0


@pytest.mark.parametrize(
    ("split", "finest"),
    # Bins that are wide have many nodes within each; fewer of them have as many edges.
    [((25, 25, 4), 0.4), ((3, 5, 2), 1.0), ((1, 1, 1), 2.0)],
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

    first = CoarseBins(field, grid, skip=True)
    others = []
    for what in (-128, 127):
        other = CoarseBins(field, grid, skip=True)
        other._levels = first._levels._replace(level=amid(first._levels.level, what))
        others.append(other)
    rng = np.random.default_rng(0)
    for _ in range(4):
        for one in (field, first, *others):
            one.reset()
        for reach in (10, 30, 60, 1e4, 1e9):
            reading = scan.readings[rng.integers(len(scan))]
            field.add(made.evidence(reading), rng.uniform(-reach, reach, 3))
            first.update(5.0, 20)
            assert (of_all_bins(field, grid) <= upper_bounds(first, field, grid)).all()
            for other in others:
                other.update(5.0, 20)
                assert np.array_equal(other.listed, first.listed)
                assert np.array_equal(upper_bounds(other, field, grid), upper_bounds(first, field, grid))


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("readings", [0, 1, 6])
def test_the_summary_is_what_the_log_belief_of_all_bins_says(plain, readings, skip):
    made, scan = plain
    grid = StateGrid(20, 17, 6)
    field = field_of(plain, grid)
    belief = BinnedBelief(field, grid, skip=skip)
    rng = np.random.default_rng(readings)
    # Nats below the best from which bins hold next to nothing, all together.
    margin = math.log(len(field.labels) * grid.bins / 1e-8)
    for count in (3, readings):  # the first sequence leaves something behind that the second must not see
        field.reset()
        belief.reset()
        for _ in range(count):
            field.add(made.evidence(scan.readings[rng.integers(len(scan))]), rng.uniform(-8, 8, 3))
            belief.update(margin)
    mass, mode = belief.summary()
    log_p = belief.log_belief().reshape(2, -1)
    best = log_p.max()
    whole = np.exp(log_p - best).sum(axis=1)
    assert (np.abs(mass - whole) <= 1e-8 * whole.sum()).all()
    assert mode[mass > 0].tolist() == log_p.argmax(axis=1)[mass > 0].tolist()
    letter = int(mass.argmax())
    samples = belief.samples(letter, 15.0)
    flat = np.flatnonzero(log_p[letter] >= best - 15)
    cells = Cells(grid, np.zeros(len(flat), dtype=np.int64), flat)
    expected = pose_samples(cells.states, Weights(log_p[letter][flat]), cells.size)
    order, other = (np.lexsort(poses.T.round(9)) for poses in (samples.poses, expected.poses))
    assert np.allclose(samples.poses[order], expected.poses[other], rtol=0, atol=1e-12)
    assert samples.weights[order] == pytest.approx(expected.weights[other], rel=1e-9)


@pytest.mark.parametrize("each", [1, 2, 3])
@pytest.mark.parametrize("weights", [(1.0, 0.25), (1.0, 1e-6, 0.0), (1e-30, 3e-30)])
def test_any_number_of_terms_and_any_weights_are_bounded(model, weights, each):
    """each: how many terms of a taxel follow each other, of which two are bounded together."""
    grid = StateGrid(12, 13, 5)
    field = field_of(model, grid)
    lazy = CoarseBins(field, grid, skip=True)
    highest = int(np.argmax(field.tables.highest))
    for terms in (1, 5, 63, 64, 65, 1025):
        table, taxel = np.full(terms, highest), np.arange(terms) // each % 36
        weight = np.resize(np.array(weights, dtype=np.float32), terms)
        field.add(Evidence(table, taxel, weight), np.array([1.0, 2.0, 0.3]))
        lazy.update(1.0, 3)
        everything, bound = of_all_bins(field, grid), upper_bounds(lazy, field, grid)
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
    field = TableField(Edge([beside, 0.0]), ["edge"], np.zeros((1, 2)), grid.spacing[:2], 0.4)
    lazy, tables, rng = CoarseBins(field, grid, skip=True), field.tables, np.random.default_rng(0)
    rows, columns = (np.flatnonzero(tables.nodes[0, 0].any(axis=axis)) for axis in (1, 0))
    x, y, theta = grid.centres
    one = Evidence(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.float32))
    for _ in range(60):
        # Just before the last node that says nothing, as some bin sees it.
        node = tables.origin + tables.step * [columns[0] - 1, rng.choice(rows)]
        away = node - [rng.choice(x), rng.choice(y)] + [-(10.0 ** rng.uniform(-9, -4)), 1e-4]
        angle = rng.choice(theta)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        field.reset()
        lazy.reset()
        field.add(one, np.array([*(turn @ away), 0.0]))
        lazy.update(0.0, 0)
        assert (of_all_bins(field, grid) <= upper_bounds(lazy, field, grid)).all()
