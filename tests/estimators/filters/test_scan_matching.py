"""Scan matching: the best bin is that of all bins, its certificate holds, and the bounds are bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import draw_trial, make_scan, paper_poses, scores

from tactsim import estimators
from tactsim.core import InputError, compose, transform
from tactsim.estimators.filters.grid import state_grid
from tactsim.estimators.filters.scan_matching import pyramid

LETTERS = "EIL"


@pytest.fixture(scope="module")
def scan():
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=6))


def made(scan, split, **options):
    estimator = estimators.create("scan-matching", split=split, **options)
    estimator.fit(scan)
    return estimator


def all_bins(split):
    """T_R^O (3, bins) of all bins of a letter."""
    angle, y, x = np.meshgrid(*reversed(state_grid(0, split).centres), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), angle.ravel()])


def brute_force(estimator, split):
    """The scores of all bins (letters, bins), and the bins."""
    states, field = all_bins(split), estimator.field
    return np.array([field.log_p(letter, states) for letter in range(len(field.labels))]), states


@pytest.mark.parametrize(
    ("split", "likelihood"),
    [
        ("40x40x8", "calibrated"),
        ("23x37x5", "paper"),
        ("64x9x3", "force"),
        ("5x3x30", "paper"),
        ("1x1x1", "calibrated"),
    ],
)
def test_the_best_of_each_letter_is_that_of_all_bins(split, likelihood, scan):
    estimator = made(scan, split, likelihood=likelihood)
    for seed, label in enumerate(LETTERS):
        rng = np.random.default_rng(seed)
        estimator.reset(rng)
        for reading, pose in zip(*draw_trial(scan, label, 4, rng)[:2], strict=True):
            estimator.update(reading, pose)
            everything, states = brute_force(estimator, split)
            best = everything.max(axis=1)
            found = np.array(list(estimator.scores.values()))
            near = best > best.max() - 50
            assert (found[near] == best[near]).all()
            assert (found[~near] <= best[~near]).all()
            estimate = estimator.estimate()
            winner = int(best.argmax())
            assert estimate.label == LETTERS[winner]
            of_pose = estimator.field.log_p(winner, estimate.robot_in_object[:, None])
            assert of_pose == pytest.approx(best[winner], abs=1e-9)
            assert (np.abs(states.T - estimate.robot_in_object).max(axis=1) < 1e-12).any()


def test_scores_are_sums_of_logs_looked_up_in_the_map(scan):
    """Without tables and kernels: bilinear in the tables' nodes is near to log p at the taxels' places."""
    estimator = made(scan, "40x40x36", cell=0.1)
    readings, poses, _ = draw_trial(scan, "L", 3, np.random.default_rng(2))
    estimator.reset(np.random.default_rng(0))
    by_hand = 0.0
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
    state = estimator.estimate().robot_in_object
    for reading, pose in zip(readings, poses, strict=True):
        xy = transform(compose(state, pose)[None], scan.taxel_xy)[0]
        logs = estimator.likelihood.log_tables(estimator.estimate().label, xy)
        classes = estimator.likelihood.classes(reading)
        by_hand += logs[classes, np.arange(len(classes))].sum()
    assert estimator.scores[estimator.estimate().label] == pytest.approx(by_hand, abs=0.3)


@pytest.mark.parametrize("far", [0.0, 25.0, 1e4])
def test_skipping_changes_no_answer(far, scan):
    lazy, full = made(scan, "30x30x12"), made(scan, "30x30x12", skip=False)
    rng = np.random.default_rng(3)
    readings, poses, _ = draw_trial(scan, "E", 5, rng)
    for estimator in (lazy, full):
        estimator.reset(rng)
    for reading, pose in zip(readings, poses + [far, 0, 0], strict=True):
        for estimator in (lazy, full):
            estimator.update(reading, pose)
        one, other = lazy.estimate(), full.estimate()
        assert one.label == other.label
        assert one.probabilities == pytest.approx(other.probabilities, abs=1e-15)
        assert max(lazy.scores.values()) == max(full.scores.values())
        if not far:  # off the map whole areas fit alike, and which bin is named is open
            assert (one.robot_in_object == other.robot_in_object).all()
    assert lazy.work["skipped"]["bins"] > 0
    assert full.work["skipped"]["bins"] == full.work["bound_evaluations"] == 0
    assert full.work["likelihood_evaluations"] > lazy.work["likelihood_evaluations"]


def test_the_certificate_holds_for_every_bin_and_says_what_was_left_alone(scan):
    split = "40x40x12"
    estimator = made(scan, split)
    rng = np.random.default_rng(5)
    estimator.reset(rng)
    assert estimator.certificate().lead == np.inf
    left_alone = 0
    for reading, pose in zip(*draw_trial(scan, "E", 6, rng)[:2], strict=True):
        estimator.update(reading, pose)
        certificate = estimator.certificate()
        everything, states = brute_force(estimator, split)
        letter, place = np.unravel_index(everything.argmax(), everything.shape)
        assert certificate.label == LETTERS[letter]
        assert certificate.robot_in_object == pytest.approx(states[:, place])
        assert certificate.lead >= 0
        left_alone += np.isfinite(certificate.lead)
    assert left_alone


def test_a_histogram_of_the_same_bins_proves_the_same_bin(scan):
    words = {"split": "30x30x16", "likelihood": "calibrated"}
    matcher, histogram = made(scan, **words), estimators.create("histogram", **words)
    histogram.fit(scan)
    rng = np.random.default_rng(8)
    readings, poses, _ = draw_trial(scan, "I", 5, rng)
    for estimator in (matcher, histogram):
        estimator.reset(rng)
    for reading, pose in zip(readings, poses, strict=True):
        for estimator in (matcher, histogram):
            estimator.update(reading, pose)
    one, other = matcher.certificate(), histogram.certificate()
    assert one.label == other.label
    # I is symmetric, so two bins are nearly as good as each other, and rounding may choose.
    moved = np.abs(one.robot_in_object - other.robot_in_object)
    assert moved[2] % np.pi == pytest.approx(0, abs=1e-9) or moved == pytest.approx(0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["40x40x8", "23x37x5", "64x9x3", "90x90x2"]))
def test_no_bin_is_above_the_bound_of_its_block(seed, split):
    estimator = _bounded(split)
    rng = np.random.default_rng(seed)
    grid, field = estimator.grid, estimator.field
    estimator.reset(rng)
    for _ in range(3):
        reading = _SCAN.readings[rng.integers(len(_SCAN))]
        field.append(estimator.likelihood.evidence(reading), rng.uniform(-1, 1, 3) * [20, 20, 3])
    levels = pyramid(field.tables, 16)
    for level in levels[1:]:
        block = np.array([[rng.integers(n)] for n in (2, grid.angle, grid.y, grid.x)])
        bound = np.zeros(1)
        estimator._add(bound, level, block, 0)
        step = np.arange(level.side)
        rows, columns = block[2] + step, block[3] + step
        rows, columns = rows[rows < grid.y], columns[columns < grid.x]
        inside = np.array([[block[0, 0], block[1, 0], i, j] for i in rows for j in columns]).T
        values = np.zeros(inside.shape[1])
        estimator._add(values, levels[0], np.ascontiguousarray(inside), 0)
        assert values.max() <= bound[0]


_SCAN = make_scan("EI", poses=paper_poses(3, 4))
_KNOWN = {}


def _bounded(split):
    if split not in _KNOWN:
        _KNOWN[split] = made(_SCAN, split)
    return _KNOWN[split]


def test_letters_and_poses_are_found_to_a_bin(scan):
    known = make_scan(LETTERS, poses=paper_poses(positions=7, angles=12))
    known.meta["objects"] = {
        label: {"symmetry": 2 if label == "I" else 1, "inertia_over_mass": 60.0} for label in LETTERS
    }
    right, off = scores(known, made(known, "50x50x72"), 2, 8)
    assert right[:, -1].mean() > 0.8  # guessing has a third
    assert np.median(off[:, -1]) < 1.0


def test_an_object_that_moves_is_refused_in_one_line():
    with pytest.raises(InputError, match="motion"):
        estimators.create("scan-matching", motion="auto")
