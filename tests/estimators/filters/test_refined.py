"""The coarse-to-fine filter against brute force, against itself without skipping, and on hidden letters."""

from dataclasses import replace

import numpy as np
import pytest
import reference
from synthetic import draw_trial, fitted_anew, make_scan, paper_poses, scores

from tactsim.core import Scan
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.refined import RefinedFilter, RefinedOptions
from tactsim.press import ScanOptions, scan_letters

COARSE = paper_poses(positions=3, angles=4)
LETTERS = "EIL"


@pytest.fixture(scope="module")
def small() -> Scan:
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


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


@pytest.mark.long
def test_bins_are_as_wide_where_a_far_robot_may_be_anywhere_on_a_large_object(small):
    large = replace(small, poses=small.poses * [8, 8, 1])
    estimator = fitted_anew("refined", large, bins=200)
    near = estimator.grid
    updated(estimator, large.readings[:1], large.poses[:1])
    assert estimator.grid == near
    updated(estimator, large.readings[:1], large.poses[:1] + [1000, 0, 0])
    assert estimator.grid.reach > 3 * near.reach
    assert estimator.grid.spacing[0] == pytest.approx(near.spacing[0], rel=0.1)
    assert fitted_anew("refined", large, split="5x5x4").grid.bins == 100
    updated(estimator, large.readings[:1], large.poses[:1])
    assert estimator.grid == near


@pytest.mark.parametrize("halvings", [1, 2])
def test_with_every_cell_halved_the_belief_is_the_dense_grid_by_brute_force(halvings):
    scan = make_scan("EI", poses=COARSE)
    estimator = fitted_anew("refined", scan, split="2x3x2", halvings=halvings, cells=1000, likelihood="paper")
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


@pytest.mark.slow
@pytest.mark.parametrize(("test_poses", "most"), [("same", 0.20), ("random", 0.30)])
def test_500_trials_settle_early_and_are_placed_exactly(test_poses, most):
    scan = scan_letters(ScanOptions(test_poses=test_poses), cache=False)[0]
    right, off = scores(scan, fitted_anew("refined", scan), trials=100, last=20)
    assert right[:, 2:].all(axis=1).mean() >= 0.95  # settled by the third
    assert right[:, 4].mean() >= 0.99
    assert right[:, 9:].all()
    assert off[:, 19].mean() <= most


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


def test_a_letter_whose_best_bin_was_halved_in_vain_is_not_named(small):
    """The middle of a bin may say much where its halves hold nothing: then no cell would say where the letter is."""
    estimator = fitted_anew("stacked", small, bins=2000, motion="off")
    unlike = make_scan("T", poses=paper_poses(positions=4, angles=12))
    readings, poses, _ = draw_trial(unlike, "T", 12, np.random.default_rng(2))
    updated(estimator, readings, poses)
    held = estimator._belief_in_cells()[0].letter
    empty = next(one for one in range(3) if one not in held)
    estimator._best[empty] = estimator._best.max() + 100
    known = estimator.estimate()
    assert known.unexplained > 0
    assert known.label != LETTERS[empty]
    # Nor is it where all are views of one object, and most presses were of that one.
    estimator.minds_misfit, estimator.same_object[:] = False, True
    estimator._view_share = np.where(np.arange(3) == empty, 0.9, 0.05)
    assert estimator.estimate().label != LETTERS[empty]


@pytest.mark.parametrize(("felt", "wider"), [("I", False), ("T", True)])
def test_the_default_widens_the_place_and_not_the_label_of_what_it_cannot_explain(small, felt, wider):
    estimator, scan = fitted_anew("stacked", small, bins=2000, motion="off"), small
    if wider:
        scan = make_scan("T", poses=paper_poses(positions=4, angles=12))
    readings, poses, _ = draw_trial(scan, felt, 12, np.random.default_rng(2))
    known = updated(estimator, readings, poses).estimate()
    assert (known.unexplained > 0) == wider
    estimator.minds_misfit = False
    narrow = estimator.estimate()
    assert (known.label, known.probabilities) == (narrow.label, narrow.probabilities)
    spread = [np.trace(one.covariance[:2, :2]) for one in (known, narrow)]
    assert spread[0] > 1.5 * spread[1] if wider else spread[0] == spread[1]


def test_an_object_that_no_training_reading_is_like_is_named_with_less_certainty(small):
    # E, I and L are known; T is felt, which is explained worse the more is felt of it.
    estimator, whole = (
        fitted_anew("refined", small, bins=2000),
        fitted_anew("refined", small, bins=2000, skip=False),
    )
    unlike = make_scan("T", poses=paper_poses(positions=4, angles=12))
    unexplained, negligible = {"E": [], "T": []}, 0
    for seed in range(3):
        for letter, scan in (("E", small), ("T", unlike)):
            readings, poses, _ = draw_trial(scan, letter, 12, np.random.default_rng(seed))
            known = updated(estimator, readings, poses).estimate()
            unexplained[letter].append(known.unexplained)
            cells, weights = estimator._belief_in_cells()
            mass = np.array([weights.relative[cells.letter == one].sum() for one in range(3)])
            assert known.label == LETTERS[mass.argmax()]
            assert updated(whole, readings, poses).estimate().probabilities == known.probabilities
            if known.unexplained:  # letters whose cells are negligible count by their best bin
                negligible += (mass == 0).sum()
                end, _, log_p = estimator._leaves
                volume = np.log(8) * np.repeat(np.arange(len(end)), np.diff([0, *end]))
                best = estimator._weight * whole._coarse._coarse.log_p.reshape(-1, 3).max(axis=0)
                best = np.minimum(best - (estimator._weight * log_p - volume).max(), -30)
                mass[mass == 0] = np.exp(best)[mass == 0]
            expected = np.maximum(mass ** (1 / (1 + known.unexplained)), np.exp(-30))
            assert min(known.probabilities.values()) > 0  # improbable, not impossible
            assert list(known.probabilities.values()) == pytest.approx(expected / expected.sum())
    assert np.median(unexplained["E"]) == 0
    assert min(unexplained["T"]) > 10
    assert negligible >= 2
    assert estimator.work["badly_explained"] >= 3
