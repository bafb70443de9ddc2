"""Scan matching: the best bin is that of all bins, its certificate holds, and the bounds are bounds."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import draw_trial, fitted_anew, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.filters.grid import state_grid
from tactsim.estimators.filters.scan_matching import pyramid

LETTERS = "EIL"


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
        ("64x9x3", "force"),
        ("1x1x1", "paper"),
    ],
)
def test_the_best_of_each_letter_is_that_of_all_bins(split, likelihood, scan):
    estimator = fitted_anew("scan-matching", scan, split=split, likelihood=likelihood)
    for seed, label in enumerate(LETTERS):
        rng = np.random.default_rng(seed)
        estimator.reset(rng)
        for reading, pose in zip(*draw_trial(scan, label, 4, rng)[:2], strict=True):
            estimator.update(reading, pose)
            everything, states = brute_force(estimator, split)
            best = everything.max(axis=1)
            found = estimator._scores.copy()
            near = best > best.max() - 50
            assert (found[near] == best[near]).all()
            assert (found[~near] <= best[~near]).all()
            estimate = estimator.estimate()
            winner = int(best.argmax())
            assert estimate.label == LETTERS[winner]
            of_pose = estimator.field.log_p(winner, estimate.robot_in_object[:, None])
            assert of_pose == pytest.approx(best[winner], abs=1e-9)
            assert (np.abs(states.T - estimate.robot_in_object).max(axis=1) < 1e-12).any()


def test_the_certificate_holds_for_every_bin_and_says_what_was_left_alone(scan):
    split = "40x40x12"
    estimator = fitted_anew("scan-matching", scan, split=split)
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


@cache
def _bounded(split):
    return fitted_anew("scan-matching", _SCAN, split=split)


def test_an_object_that_moves_is_refused_in_one_line():
    with pytest.raises(InputError, match="motion"):
        estimators.create("scan-matching", motion="auto")
