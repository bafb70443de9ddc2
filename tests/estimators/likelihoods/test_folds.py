"""Parts of the training readings: by position, alike in size, and no neighbours together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import make_scan, paper_poses

from tactsim.core import Scan, compose
from tactsim.estimators.likelihoods.folds import (
    FOLDS,
    LeftOut,
    as_one,
    by_letter,
    folds,
    load_levels,
    near_another_part,
    positions,
    presses,
    touched_elsewhere,
)


def pressed_at(poses, presses=None):
    """A scan whose presses are made at poses (n, 3); what is felt does not matter."""
    labels, split = np.full(len(poses), "A"), np.full(len(poses), "train")
    return Scan(np.ones((len(poses), 1)), poses, labels, split, np.zeros((1, 2)), presses=presses)


def test_presses_at_one_position_are_in_one_part_and_parts_are_alike():
    poses = paper_poses(4, 12)
    part = folds(pressed_at(poses))
    for x, y in np.unique(poses[:, :2], axis=0):
        assert len(set(part[(poses[:, 0] == x) & (poses[:, 1] == y)])) == 1
    assert np.bincount(part).tolist() == [len(poses) // FOLDS] * FOLDS


def test_presses_are_dealt_out_so_that_every_position_is_in_every_part():
    poses = paper_poses(4, 12)
    shuffled = np.random.default_rng(0).permutation(len(poses))
    scan = pressed_at(poses[shuffled])
    part, which = presses(scan), positions(scan)
    for number in range(16):
        mine = which == number
        assert np.bincount(part[mine]).tolist() == [3] * FOLDS
        turned = part[mine][np.argsort(poses[shuffled][mine, 2])]
        assert (np.diff(turned) % FOLDS == 1).all()  # neighbours in angle are in different parts
    # With one press at each position nothing is left there: they are parts of positions.
    assert np.bincount(presses(pressed_at(poses[::12]))).tolist() == [4] * FOLDS


@pytest.mark.parametrize("divide", [folds, presses])
def test_readings_of_one_press_are_in_one_part_and_parts_are_those_of_whole_presses(divide):
    poses = np.random.default_rng(0).uniform((-8, -8, 0), (8, 8, 6), (21, 3))
    windows = np.array([[x, y, 0.0] for x in (-6.0, 6.0) for y in (-6.0, 6.0)])
    cut = np.concatenate([compose(poses, window) for window in windows])
    shuffled = np.random.default_rng(1).permutation(len(cut))
    number = np.tile(100 + np.arange(21), 4)[shuffled]
    part = divide(pressed_at(cut[shuffled], number))
    whole = divide(pressed_at(poses))
    assert np.array_equal(part, whole[number - 100])
    assert max(len(set(divide(pressed_at(cut))[number.argsort()][k : k + 4])) for k in range(0, 84, 4)) > 1


@pytest.mark.parametrize("turns", [0, 1, -2])
@pytest.mark.parametrize("angle", [0.3, np.pi, 2 * np.pi - 1e-9, 0.0])
def test_presses_whole_turns_apart_lie_just_alike(turns, angle):
    poses = np.array([[1.0, 2.0, angle], [1.0, 2.0, angle + turns * 2 * np.pi]])
    train = Scan(
        np.array([[1.0, 4.0], [3.0, 8.0]]),
        poses,
        ["A"] * 2,
        ["train"] * 2,
        np.array([[0.0, 0.0], [1.0, 0.0]]),
    )
    _, values, weight = as_one(train, train.readings.ravel(), np.ones(4))
    assert values.tolist() == [2.0, 6.0, 2.0, 6.0]
    assert weight.tolist() == [2.0] * 4
    assert load_levels(poses, np.array([[1.0], [2.0]])).tolist() == [2, 4]


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


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 4), st.sampled_from([0.3, 1.0, 4.0]))
def test_points_near_another_part_are_what_all_pairs_say(seed, count, parts, near):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 8, (2, count))
    x[: count // 2] = np.round(x[: count // 2])  # many in one column
    x.sort()
    part = rng.integers(0, parts, count)
    away = np.hypot(x[:, None] - x, y[:, None] - y)
    expected = ((away < near) & (part[:, None] != part)).any(axis=1)
    assert np.array_equal(near_another_part(x, y, part, near), expected)


def test_each_reading_is_predicted_once_from_the_other_parts():
    scan = make_scan("EI", poses=paper_poses(3, 4)).where("train")
    out = LeftOut.of(scan)
    number = np.arange(len(scan))
    seen = []

    def predict(gone):
        seen.append(gone)
        return np.stack([np.tile(sign * number[gone][:, None], scan.readings.shape[1]) for sign in (1, -1)])

    found = out.predicted(predict)
    assert (np.sum(seen, axis=0) == 1).all()
    assert (found == np.array([1, -1])[:, None, None] * number[:, None]).all()
    assert np.array_equal(out.known, touched_elsewhere(scan, by_letter(folds, scan)))
