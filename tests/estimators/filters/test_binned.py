"""The log-belief of all bins: what compiled code reads, and the bounds that make skipping exact."""

import math

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.binned import BinnedBelief
from tactsim.estimators.filters.cells import Cells, bins_of, middles
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.states import Weights, pose_samples
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions


@pytest.fixture(scope="module")
def model():
    scan = make_scan("EI", poses=paper_poses(3, 4))
    made = likelihood.create(LikelihoodOptions())
    made.fit(scan, learn_maps(scan))
    return made, scan


def field_of(model, grid, finest=0.4):
    made, scan = model
    return LikelihoodField(made, scan.letters, scan.taxel_xy, grid.spacing[:2], finest)


def margin(field, grid):
    """Nats below the best from which bins hold next to nothing, all together."""
    return math.log(len(field.labels) * grid.bins / 1e-8)


def of_all_bins(field, grid):
    """Replay all readings at the middle of every bin: (letters, angles, rows, columns)."""
    flat, states = np.arange(grid.bins), np.empty((3, grid.bins))
    middles(states, np.empty_like(flat), np.zeros_like(flat), flat, bins_of(grid))
    log_p = [field.log_p(letter, states) for letter in range(len(field.labels))]
    return np.reshape(log_p, (-1, grid.angle, grid.y, grid.x))


@pytest.mark.parametrize("split", [(25, 25, 4), (3, 5, 2), (1, 1, 1), (17, 33, 2)])
@pytest.mark.parametrize("what", [-32_768, 32_767])
def test_planes_that_hang_over_the_tables_read_nothing_beyond_them(model, split, what, monkeypatch):
    plain = LikelihoodField.lattice

    def amid(*args):
        lattice = plain(*args)
        around = np.full(3 * lattice.nodes.size, what, dtype=np.int16)
        inside = around[lattice.nodes.size : 2 * lattice.nodes.size]
        inside[:] = lattice.nodes
        return lattice._replace(nodes=inside)

    grid = StateGrid(*split)
    field = field_of(model, grid)
    expected = BinnedBelief(field, grid, skip=True)
    monkeypatch.setattr(LikelihoodField, "lattice", amid)
    belief = BinnedBelief(field, grid, skip=True)
    rng = np.random.default_rng(0)
    for _ in range(4):
        field.reset()
        belief.reset()
        expected.reset()
        # Anywhere from the middle of the map to far off it, so that every edge is hung over.
        for reach in (10, 30, 60, 1e4, 1e9):
            reading = model[1].readings[rng.integers(len(model[1]))]
            field.append(model[0].evidence(reading), rng.uniform(-reach, reach, 3))
            belief.update(margin(field, grid))
            expected.update(margin(field, grid))
        mass, mode = belief.summary()
        assert np.array_equal(mass, expected.summary()[0])
        assert np.array_equal(belief.log_belief(), expected.log_belief())
        assert np.array_equal(belief.upper_bounds(), expected.upper_bounds())
        assert np.isfinite(mass).all()
        assert mode.max() >= 0
        assert np.isfinite(belief.upper_bounds()).all()
        assert not np.isnan(belief.log_belief()).any()


@pytest.mark.parametrize("columns", [3, 17])  # fewer and more than are summed together
@pytest.mark.parametrize(
    "away",
    [(25, 0), (-25, 0), (0, 25), (0, -25), (40, 3), (-3, -40), (9e8, 0), (-9e8, 0), (0, 9e8), (0, -9e8)],
)
def test_bins_beside_the_tables_are_those_of_the_field(model, away, columns):
    """Off the map along one axis alone, where the nodes beyond a row's end are those of the next row."""
    grid = StateGrid(columns, 33, 2)
    field = field_of(model, grid)
    belief = BinnedBelief(field, grid)
    for index in (0, 7):
        field.append(model[0].evidence(model[1].readings[index]), np.array([*away, 0.3], dtype=float))
        belief.update(margin(field, grid))
    x, y, angle = grid.centres
    turned, up, across = np.meshgrid(angle, y, x, indexing="ij")
    states = np.stack([across.ravel(), up.ravel(), turned.ravel()])
    for letter, found in enumerate(belief.log_belief()):
        assert np.allclose(found.ravel(), field.log_p(letter, states), rtol=0, atol=1e-3)


def test_no_bin_is_above_its_upper_bound(model):
    # The bound is what makes skipping exact; check it bin by bin against all bins.
    grid = StateGrid(20, 20, 6)
    field = field_of(model, grid)
    lazy, full = BinnedBelief(field, grid, skip=True), BinnedBelief(field, grid)
    left_alone = 0
    for seed in range(2):
        rng = np.random.default_rng(seed)
        field.reset()
        lazy.reset()
        full.reset()
        for _ in range(8):
            reading = model[1].readings[rng.integers(len(model[1]))]
            field.append(model[0].evidence(reading), rng.uniform(-15, 15, 3))
            lazy.update(margin(field, grid))
            full.update(margin(field, grid))
            everything = full.log_belief()
            assert np.isfinite(everything).all()
            assert (everything <= lazy.upper_bounds() + 1e-9).all()
            left_alone += (lazy.log_belief() == -np.inf).sum()
    assert left_alone > 0


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("readings", [0, 1, 2, 6])
def test_the_summary_is_what_the_log_belief_of_all_bins_says(model, readings, skip):
    grid = StateGrid(20, 17, 6)
    field = field_of(model, grid)
    belief = BinnedBelief(field, grid, skip=skip)
    rng = np.random.default_rng(readings)
    for count in (3, readings):  # the first sequence leaves something behind that the second must not see
        field.reset()
        belief.reset()
        for _ in range(count):
            field.append(
                model[0].evidence(model[1].readings[rng.integers(len(model[1]))]), rng.uniform(-8, 8, 3)
            )
            belief.update(margin(field, grid))
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
    assert samples.weights.sum() == pytest.approx(1)


def test_a_sequence_that_was_left_alone_for_long_is_caught_up_reading_by_reading(model):
    """Blocks far behind take in what they missed: the sums are those of a belief that never waits."""
    grid = StateGrid(12, 12, 4)
    field = field_of(model, grid)
    lazy, full = BinnedBelief(field, grid, skip=True), BinnedBelief(field, grid)
    train = model[1].where("train")
    poses = np.zeros((400, 3))
    # A long time at one letter, then at the other, until it leads.
    shown = [("E", k) for k in range(150)] + [("I", k) for k in range(250)]
    behind = 0
    for pose, (label, k) in zip(poses, shown, strict=True):
        mine = train.where("train", label)
        index = k % len(mine)
        field.append(model[0].evidence(mine.readings[index]), mine.poses[index] + pose)
        evaluated, _ = lazy.update(margin(field, grid))
        full.update(margin(field, grid))
        behind = max(behind, evaluated)
        ours, whole = lazy.log_belief(), full.log_belief()
        known = ours > -np.inf
        assert (ours[known] == whole[known]).all()
        assert whole[~known].max(initial=-np.inf) < whole.max() - 20
    assert behind > 1000  # some were caught up at once


@pytest.mark.parametrize("readings", [1, 2, 6, 12])
def test_the_certified_bin_is_the_best_of_the_whole_grid(model, readings):
    made, scan = model
    grid = StateGrid(25, 25, 8)
    field = field_of(model, grid)
    skipping, every = BinnedBelief(field, grid, skip=True), BinnedBelief(field, grid)
    rng = np.random.default_rng(readings)
    letter = scan.labels == scan.letters[readings % 2]
    for k in rng.choice(np.flatnonzero(letter), readings, replace=False):
        field.append(made.evidence(scan.readings[k]), np.array(scan.poses[k]))
        skipping.update(margin(field, grid))
        every.update(margin(field, grid))
    proof, log_p = skipping.certificate(), every.log_belief()
    best = np.unravel_index(log_p.argmax(), log_p.shape)
    x, y, theta = grid.centres
    assert proof.label == field.labels[best[0]]
    np.testing.assert_array_equal(proof.robot_in_object, [x[best[3]], y[best[2]], theta[best[1]]])
    waits = skipping.log_belief() == -np.inf
    gap = log_p.max() - log_p[waits].max(initial=-np.inf)
    assert 0 < proof.lead <= gap + 1e-6
    assert every.certificate().lead == np.inf


@pytest.fixture(scope="module", params=["calibrated", "force"])
def other_model(request):
    """Tables of three classes that count fully, and of pressures between which each reading interpolates."""
    scan = make_scan("EIL", poses=paper_poses(3, 4))
    made = likelihood.create(LikelihoodOptions(likelihood=request.param))
    made.fit(scan, learn_maps(scan))
    return made, scan


@pytest.mark.parametrize("split", [(25, 25, 4), (12, 12, 10), (3, 5, 2), (33, 7, 3)])
@pytest.mark.parametrize(("keep", "within"), [(1, 0.0), (7, 3.0), (100, 20.0), (10**6, 1.0)])
def test_the_best_bins_are_those_of_all_bins(other_model, split, keep, within):
    made, scan = other_model
    grid = StateGrid(*split)
    field = field_of(other_model, grid)
    beliefs = [BinnedBelief(field, grid, skip=skip) for skip in (True, False)]
    counted = np.zeros((2, 2), dtype=int)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        field.reset()
        for belief in beliefs:
            belief.reset()
        for reading in rng.integers(len(scan), size=7):
            # One touch in seven contradicts the others, and one is off the map.
            field.append(
                made.evidence(scan.readings[reading]), rng.uniform(-1, 1, 3) * rng.choice([9, 9, 60])
            )
            counted += [belief.update(within, keep) for belief in beliefs]
            everything = beliefs[1].log_belief().ravel()
            rounding = field.terms.slack[: len(field)].sum()
            assert np.allclose(everything, of_all_bins(field, grid).ravel(), rtol=0, atol=2 * rounding)
            highest = np.sort(everything)[::-1]
            least = min(highest[0] - within, highest[min(keep, len(highest) - 1)])
            if keep >= len(highest):
                least = -np.inf
            for belief in beliefs:
                flat, log_p = belief.listed
                assert np.array_equal(log_p, everything[flat])  # to the bit
                assert (np.diff(flat) > 0).all()
                assert np.array_equal(flat, np.flatnonzero(everything >= least - 1e-6))
    assert counted[1].tolist() == [len(field.labels) * grid.bins * 14, 0]
    assert counted[0].sum() == counted[1].sum()
