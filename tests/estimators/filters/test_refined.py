"""The coarse-to-fine filter against brute force, against itself without skipping, and on hidden letters."""

import numpy as np
import pytest
import reference
from synthetic import draw_trial, make_scan, paper_poses, scores

from tactsim import estimators
from tactsim.core import Scan
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.refined import RefinedFilter, RefinedOptions
from tactsim.press import ScanOptions, scan_letters

COARSE = paper_poses(positions=3, angles=4)
LETTERS = "EIL"


@pytest.fixture(scope="module")
def small() -> Scan:
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


def fitted(scan, **options):
    estimator = estimators.create("refined", **options)
    estimator.fit(scan)
    return estimator


def updated(estimator, readings, poses):
    estimator.reset(np.random.default_rng(0))
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
    return estimator


def tabulated(estimator, letter, state, readings, poses):
    """Log-likelihood of a history at one state, by brute force."""
    return sum(
        reference.tabulated_log_likelihood(
            estimator.field.tables, letter, state, reading, pose, estimator.taxel_xy
        )
        for reading, pose in zip(readings, poses, strict=True)
    )


def middles(estimator, halvings):
    """Middles of all cells of one letter (n, 3), halved so often everywhere."""
    x, y, angle = StateGrid(
        *(count * 2**halvings for count in (estimator.grid.x, estimator.grid.y, estimator.grid.angle)),
        estimator.grid.reach,
    ).centres
    return np.stack(np.meshgrid(angle, y, x, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]


def test_the_best_of_a_million_bins_are_those_of_the_whole_grid(small):
    split = "110x110x30"
    estimator = fitted(small, split=split, halvings=0)
    whole = estimators.create("histogram", split=split, skip=False, likelihood="calibrated")
    whole.fit(small)
    readings, poses, _ = draw_trial(small, "I", 3, np.random.default_rng(1))
    for one in (estimator, whole):
        updated(one, readings, poses)
    log_p = whole.log_belief().ravel()
    best = np.flatnonzero(log_p >= np.partition(log_p, -50)[-50])
    belief = estimator.weighted_states()
    heaviest = np.sort(np.argsort(-belief.weights.log, kind="stable")[: len(best)])
    assert np.array_equal(belief.letter[heaviest], best // whole.grid.bins)
    assert np.allclose(belief.state[:, heaviest], whole.grid.states(best))
    spread = np.sort(belief.weights.log)[::-1][: len(best)]
    assert np.allclose(
        spread / (spread[-1] or 1),
        (np.sort(log_p[best])[::-1] - log_p.max()) / (log_p[best].min() - log_p.max()),
    )
    assert estimator.certificate().lead > 0
    assert estimator.estimate().label == "I"


def test_bins_are_as_wide_where_a_far_robot_may_be_anywhere_on_a_large_object(small):
    large = Scan(
        small.readings, small.poses * [8, 8, 1], small.labels, small.split, small.taxel_xy, dict(small.meta)
    )
    estimator = fitted(large, bins=200)
    near = estimator.grid
    updated(estimator, large.readings[:1], large.poses[:1])
    assert estimator.grid == near
    updated(estimator, large.readings[:1], large.poses[:1] + [1000, 0, 0])
    assert estimator.grid.reach > 3 * near.reach
    assert estimator.grid.spacing[0] == pytest.approx(near.spacing[0], rel=0.1)
    assert fitted(large, split="5x5x4").grid.bins == 100
    updated(estimator, large.readings[:1], large.poses[:1])
    assert estimator.grid == near


@pytest.mark.parametrize("halvings", [1, 2])
def test_with_every_cell_halved_the_belief_is_the_dense_grid_by_brute_force(halvings):
    scan = make_scan("EI", poses=COARSE)
    estimator = fitted(scan, split="2x3x2", halvings=halvings, cells=1000, likelihood="paper")
    readings, poses, _ = draw_trial(scan, "E", 2, np.random.default_rng(3))
    updated(estimator, readings, poses)
    states = middles(estimator, halvings)
    dense = np.array(
        [[tabulated(estimator, k, state, readings, poses) for state in states] for k in range(2)]
    )
    p = np.exp(dense - dense.max())
    p /= p.sum()
    assert list(estimator.estimate().probabilities.values()) == pytest.approx(p.sum(axis=1), abs=1e-5)
    belief = estimator.weighted_states()
    for k, pose, weight in zip(belief.letter, belief.state.T, belief.weights.normalised, strict=True):
        place = np.abs(states - pose).max(axis=1).argmin()
        assert np.abs(states[place] - pose).max() < 1e-9
        assert weight == pytest.approx(p[k, place], abs=1e-5)


@pytest.mark.long
def test_a_cell_that_is_split_is_worth_the_mean_of_its_halves():
    # One cell is halved, and one of its halves once more: the masses by hand, from the definition.
    scan = make_scan("EI", poses=COARSE)
    options = {"split": "3x2x2", "likelihood": "paper", "gamma": 0.5}
    estimator = fitted(scan, **options, halvings=2, cells=1)
    readings, poses, _ = draw_trial(scan, "I", 3, np.random.default_rng(1))
    updated(estimator, readings, poses)

    def likelihoods(halvings):
        states = middles(estimator, halvings)
        return np.array(
            [[tabulated(estimator, k, state, readings, poses) for state in states] for k in range(2)]
        ).reshape(2, *(n << halvings for n in (2, 2, 3)))

    levels = [likelihoods(halvings) for halvings in range(3)]
    highest = max(level.max() for level in levels)
    levels = [np.exp(level - highest) for level in levels]

    def halves(cell):
        return (cell[0], *(slice(2 * i, 2 * i + 2) for i in cell[1:]))

    first = np.unravel_index(levels[0].argmax(), levels[0].shape)
    inner = levels[1][halves(first)]
    second = np.unravel_index(inner.argmax(), inner.shape)
    inner = inner.copy()
    inner[second] = levels[2][
        halves((first[0], *(2 * i + k for i, k in zip(first[1:], second, strict=True))))
    ].mean()
    levels[0][first] = inner.mean()
    mass = levels[0].sum(axis=(1, 2, 3))
    assert list(estimator.estimate().probabilities.values()) == pytest.approx(mass / mass.sum(), abs=1e-5)
    plane = estimator.belief_over_plane().probability
    assert plane == pytest.approx(levels[0].sum(axis=1) / mass.sum(), abs=1e-5)


@pytest.mark.parametrize(
    "options", [{}, {"cells": 20, "halvings": 5}, {"split": "5x7x9", "likelihood": "paper"}]
)
def test_skipping_changes_no_answer(small, options):
    lazy, full = fitted(small, **options), fitted(small, **options, skip=False)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        trial = draw_trial(small, LETTERS[seed], 10, rng)
        other = draw_trial(small, LETTERS[seed + 1], 6, rng)  # which contradicts the first
        for filter in (lazy, full):
            filter.reset(rng)
        for reading, pose in (*zip(*trial[:2], strict=True), *zip(*other[:2], strict=True)):
            for filter in (lazy, full):
                filter.update(reading, pose)
            ours, whole = lazy.estimate(), full.estimate()
            assert ours.label == whole.label
            assert ours.robot_in_object == pytest.approx(whole.robot_in_object, abs=1e-9)
            assert ours.probabilities == pytest.approx(whole.probabilities, abs=1e-9)
            assert lazy.certificate().robot_in_object.tolist() == full.certificate().robot_in_object.tolist()
            assert lazy.certificate().lead > 0
    assert full.work["skipped"] == {"bins": 0, "replays": 0}
    assert full.work["bound_evaluations"] == 0
    skipped = lazy.work["skipped"]
    assert lazy.work["likelihood_evaluations"] + sum(skipped.values()) == full.work["likelihood_evaluations"]
    assert min(skipped.values()) > 0


@pytest.mark.parametrize("cells", [1, 7, 100])
def test_of_letters_that_look_alike_none_is_preferred(small, cells):
    one = small.where(label="E")
    twins = Scan(
        np.tile(one.readings, (3, 1)), np.tile(one.poses, (3, 1)), np.repeat(list("EFG"), len(one)),
        np.tile(one.split, 3), one.taxel_xy,
    )  # fmt: skip
    estimator = fitted(twins, cells=cells, bins=1000)
    readings, poses, _ = draw_trial(small, "E", 6, np.random.default_rng(3))
    for shown in (readings, np.zeros_like(readings)):
        for count in range(7):
            got = updated(estimator, shown[:count], poses[:count]).estimate()
            assert list(got.probabilities.values()) == pytest.approx([1 / 3] * 3, abs=1e-9)


def test_without_halvings_it_is_the_histogram(small):
    """Both round in float32, each in its own order."""
    plain = estimators.create("histogram", split="9x8x11", likelihood="paper")
    plain.fit(small)
    estimator = fitted(small, split="9x8x11", halvings=0, likelihood="paper")
    readings, poses, _ = draw_trial(small, "L", 5, np.random.default_rng(2))
    for count in range(6):
        whole = updated(plain, readings[:count], poses[:count])
        ours = updated(estimator, readings[:count], poses[:count])
        assert ours.estimate().probabilities == pytest.approx(whole.estimate().probabilities, abs=1e-5)
        assert ours.belief_over_plane().probability == pytest.approx(
            whole.belief_over_plane().probability, abs=1e-5
        )


@pytest.mark.slow
@pytest.mark.parametrize(("test_poses", "most"), [("same", 0.20), ("random", 0.30)])
def test_500_trials_settle_early_and_are_placed_exactly(test_poses, most):
    scan = scan_letters(ScanOptions(test_poses=test_poses), cache=False)[0]
    right, off = scores(scan, fitted(scan), trials=100, last=20)
    assert right[:, 2:].all(axis=1).mean() >= 0.95  # settled by the third
    assert right[:, 4].mean() >= 0.99
    assert right[:, 9:].all()
    assert off[:, 19].mean() <= most


@pytest.mark.slow
@pytest.mark.parametrize(("test_poses", "least"), [("same", 0.97), ("random", 0.95)])
def test_all_capitals_and_digits_are_told_apart(test_poses, least):
    letters = tuple("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789")
    scan = scan_letters(ScanOptions(letters=letters, test_poses=test_poses), cache=False)[0]
    right, _ = scores(scan, fitted(scan), trials=14, last=6)
    assert right[:, 5].mean() >= least


def test_readings_that_disagree_about_the_place_count_less_than_readings_that_agree(small):
    # Every press is misplaced by a millimetre more than those of training were.
    estimator, rng = RefinedFilter(RefinedOptions(bins=2000)), np.random.default_rng(5)
    estimator.fit(small)
    ratio = {}
    for misplaced in (0.0, 1.0):
        said = []
        for letter in LETTERS:
            readings, poses, _ = draw_trial(small, letter, 16, rng)
            poses = poses + rng.normal(size=poses.shape) * [misplaced, misplaced, 0.0]
            updated(estimator, readings, poses)
            said.append(estimator._weight / estimator.trust(len(readings)))
        ratio[misplaced] = np.mean(said)
    assert ratio[1.0] < 0.8 < ratio[0.0] < 1.5


def test_an_object_that_no_training_reading_is_like_is_named_with_less_certainty(small):
    # E, I and L are known; T is felt, which is explained worse the more is felt of it.
    estimator = fitted(small, bins=2000)
    unlike = make_scan("T", poses=paper_poses(positions=4, angles=12))
    unexplained = {"E": [], "T": []}
    for seed in range(3):
        for letter, scan in (("E", small), ("T", unlike)):
            readings, poses, _ = draw_trial(scan, letter, 12, np.random.default_rng(seed))
            known = updated(estimator, readings, poses).estimate()
            unexplained[letter].append(known.unexplained)
            cells, weights = estimator._belief_in_cells()
            mass = np.array([weights.relative[cells.letter == one].sum() for one in range(3)])
            expected = mass ** (1 / (1 + known.unexplained))
            assert list(known.probabilities.values()) == pytest.approx(expected / expected.sum())
            assert known.label == LETTERS[mass.argmax()]
    assert np.median(unexplained["E"]) == 0
    assert min(unexplained["T"]) > 10
    assert estimator.work["badly_explained"] >= 3
