"""Parts of the training readings: by position, alike in size, and no neighbours together."""

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim.estimators.likelihoods.folds import (
    FOLDS,
    by_letter,
    folds,
    positions,
    presses,
    touched_elsewhere,
)


def test_presses_at_one_position_are_in_one_part_and_parts_are_alike():
    poses = paper_poses(4, 12)
    part = folds(poses)
    for x, y in np.unique(poses[:, :2], axis=0):
        assert len(set(part[(poses[:, 0] == x) & (poses[:, 1] == y)])) == 1
    assert np.bincount(part).tolist() == [len(poses) // FOLDS] * FOLDS


def test_neighbours_are_in_different_parts():
    poses = paper_poses(4, 1)
    part, step = folds(poses), np.diff(np.unique(poses[:, 0])).min()
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    near = (apart > 0) & (apart < 1.1 * step)
    assert not (near & (part[:, None] == part)).any()


def test_presses_are_dealt_out_so_that_every_position_is_in_every_part():
    poses = paper_poses(4, 12)
    shuffled = np.random.default_rng(0).permutation(len(poses))
    part, which = presses(poses[shuffled]), positions(poses[shuffled])
    for number in range(16):
        mine = which == number
        assert np.bincount(part[mine]).tolist() == [3] * FOLDS
        turned = part[mine][np.argsort(poses[shuffled][mine, 2])]
        assert (np.diff(turned) % FOLDS == 1).all()  # neighbours in angle are in different parts
    # With one press at each position nothing is left there: they are parts of positions.
    assert np.bincount(presses(poses[::12])).tolist() == [4] * FOLDS


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_few_positions_make_fewer_parts_and_one_position_is_divided_by_presses(count):
    poses = np.repeat(np.column_stack([5.0 * np.arange(count), np.zeros((count, 2))]), 6, axis=0)
    assert positions(poses).max() + 1 == count
    assert len(set(folds(poses))) == (FOLDS if count == 1 else min(count, FOLDS))


def test_a_taxel_beyond_what_others_felt_is_not_touched_elsewhere():
    scan = make_scan("EI", poses=paper_poses(3, 4)).where("train")
    part = by_letter(folds, scan)
    known = touched_elsewhere(scan, part)
    for k in range(0, len(scan), 17):
        rest = (scan.labels == scan.labels[k]) & (part != part[k])
        cos, sin = np.cos(scan.poses[:, 2]), np.sin(scan.poses[:, 2])
        x = scan.poses[:, :1] + cos[:, None] * scan.taxel_xy[:, 0] - sin[:, None] * scan.taxel_xy[:, 1]
        y = scan.poses[:, 1:2] + sin[:, None] * scan.taxel_xy[:, 0] + cos[:, None] * scan.taxel_xy[:, 1]
        away = np.hypot(x[k][:, None] - x[rest].ravel(), y[k][:, None] - y[rest].ravel()).min(axis=1)
        assert np.array_equal(known[k], away < 1.0)
    assert known.any()
    assert not known.all()
