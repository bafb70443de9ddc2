import math

import numpy as np
import pytest
import reference
from synthetic import draw_trial, fitted_anew, follow, make_scan, paper_poses, scores, square_pad

from tactsim import estimators

COARSE = paper_poses(positions=3, angles=4)


def joint_table(fitted, readings, poses, log_likelihood):
    """Log-belief of every bin (letters, angles, rows, columns) by brute force (eq. 13)."""
    x, y, angle = fitted.grid.centres
    table = np.zeros((len(fitted.labels), len(angle), len(y), len(x)))
    for letter, k, row, column in np.ndindex(*table.shape):
        state = (x[column], y[row], angle[k])
        table[letter, k, row, column] = sum(
            log_likelihood(letter, state, reading, pose)
            for reading, pose in zip(readings, poses, strict=True)
        )
    return table


def summary(fitted, table):
    """Eq. 14 to 16 of a joint table, with the mode within the best letter."""
    p = np.exp(table - table.max())
    p /= p.sum()
    best = int(p.sum(axis=(1, 2, 3)).argmax())
    k, row, column = np.unravel_index(p[best].argmax(), p[best].shape)
    x, y, angle = fitted.grid.centres
    letters = dict(zip(fitted.labels, p.sum(axis=(1, 2, 3)).tolist(), strict=True))
    return fitted.labels[best], letters, [x[column], y[row], angle[k]]


@pytest.mark.parametrize(
    ("split", "skip", "pad"), [("5x4x3", True, (6, 6)), ("3x9x2", False, (3, 5)), ("1x1x1", True, (1, 1))]
)
def test_belief_is_the_joint_table_by_brute_force(split, skip, pad):
    scan = make_scan("EI", square_pad(*pad), COARSE)
    filter = fitted_anew("histogram", scan, split=split, skip=skip)
    rng = np.random.default_rng(3)
    readings, poses, _ = draw_trial(scan, "E", 3, rng)
    filter.reset(rng)
    for count in range(1, 4):
        filter.update(readings[count - 1], poses[count - 1])
        table = joint_table(
            filter, readings[:count], poses[:count],
            lambda letter, *rest: reference.tabulated_log_likelihood(
                filter.field.tables, letter, *rest, scan.taxel_xy
            ),
        )  # fmt: skip
        label, letters, mode = summary(filter, table)
        got = filter.estimate()
        assert got.label == label
        assert got.probabilities == pytest.approx(letters, abs=1e-5)
        assert got.robot_in_object == pytest.approx(mode)


def test_finer_tables_approach_equation_7_with_interpolated_log_odds():
    # Tabulating log p is exact at the nodes; between them it must converge to the paper's order:
    # interpolate the log-odds, then take the logarithm.
    scan = make_scan("EI", poses=COARSE)
    rng = np.random.default_rng(0)
    readings, poses, _ = draw_trial(scan, "E", 4, rng)
    errors = []
    for split in ("25x25x1", "100x100x1"):  # table steps of 0.4 and 0.2 mm, both dividing the map cell
        filter = fitted_anew("histogram", scan, split=split, cell=0.8)
        x, y, angle = filter.grid.centres
        gaps = []
        for reading, pose in zip(readings, poses, strict=True):
            for column, row in rng.integers(len(x), size=(40, 2)):
                state = (x[column], y[row], angle[0])
                literal = reference.log_likelihood(filter.maps["E"], state, reading, pose, scan.taxel_xy)
                tabulated = reference.tabulated_log_likelihood(
                    filter.field.tables, 0, state, reading, pose, scan.taxel_xy
                )
                gaps.append(literal - tabulated)
        errors.append(math.sqrt(np.mean(np.square(gaps))))
    assert errors[1] < errors[0] / 2.5, errors
    assert errors[1] < 0.5, errors


@pytest.mark.parametrize(
    ("bins", "accuracy", "error"),
    [
        pytest.param(10_000, {5: 0.92, 9: 0.97, 30: 1.0}, {30: 1.2}, marks=pytest.mark.slow),
        pytest.param(1000, {10: 0.95, 25: 0.99}, {25: 2.2}, marks=pytest.mark.long),
    ],
)
def test_500_trials_reach_what_an_independent_implementation_reached(vowels, bins, accuracy, error):
    filter = fitted_anew("histogram", vowels, bins=bins)
    right, off = scores(vowels, filter, trials=100, last=max(*accuracy, *error))
    for count, share in accuracy.items():
        assert right[:, count - 1].mean() >= share
    for count, most in error.items():
        assert off[right[:, count - 1], count - 1].mean() <= most


CASES = [
    ("histogram", {"bins": 5000}),
    ("histogram", {"split": "9x40x9", "likelihood": "calibrated"}),
    ("histogram", {"bins": 1000, "gamma": 1e-100}),  # a belief that falls by thousands
    ("refined", {"bins": 2000}),
    ("refined", {"bins": 2000, "cells": 20, "halvings": 5}),
    ("refined", {"split": "5x7x9", "likelihood": "paper"}),
    ("particle", {"particles": 2000}),
    ("augmented-mcl", {"particles": 2000}),
]
# What rounding moves: mm and rad of a pose, and a probability.
ROUNDING = {"histogram": (0, 1e-7), "refined": (1e-9, 1e-9), "particle": (0, 0), "augmented-mcl": (0, 0)}


@pytest.mark.parametrize(("name", "options"), CASES, ids=str)
def test_skipping_changes_no_answer(scan, name, options):
    lazy, full = (estimators.create(name, skip=skip, **options) for skip in (True, False))
    moved, changed = ROUNDING[name]
    for estimator in (lazy, full):
        estimator.fit(scan)
    for seed in range(2):
        # The last touches contradict the first, but where a letter that was hopeless has kept its old particles.
        letters = ("EI", "IL")[seed]
        drawn = [
            draw_trial(scan, label, 12 // len(letters), np.random.default_rng(seed)) for label in letters
        ]
        readings, poses = (np.concatenate([trial[k] for trial in drawn]) for k in (0, 1))
        both = (follow(estimator, readings, poses, seed) for estimator in (lazy, full))
        for ours, whole in zip(*both, strict=True):
            assert ours.label == whole.label
            assert ours.robot_in_object == pytest.approx(whole.robot_in_object, rel=0, abs=moved)
            assert ours.probabilities == pytest.approx(whole.probabilities, rel=0, abs=changed)
        if hasattr(lazy, "certificate"):
            proof = lazy.certificate()
            assert proof.lead >= 0
            assert proof.robot_in_object.tolist() == full.certificate().robot_in_object.tolist()
    skipped = lazy.work["skipped"]
    assert sum(skipped.values()) > 0
    assert not any(full.work["skipped"].values())
    if name in ("histogram", "refined"):
        made = lazy.work["likelihood_evaluations"]
        assert made + sum(skipped.values()) == full.work["likelihood_evaluations"]
