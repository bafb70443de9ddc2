import math

import numpy as np
import pytest
import reference
from synthetic import draw_trial, make_scan, paper_poses, square_pad

import estimators
from tactsim import invert

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


@pytest.mark.parametrize("skip", [True, False])
@pytest.mark.parametrize("split", ["5x4x3", "1x1x1", "3x9x2"])
@pytest.mark.parametrize("pad", [(6, 6), (1, 1), (3, 5)])
def test_belief_is_the_joint_table_by_brute_force(split, skip, pad):
    scan = make_scan("EI", square_pad(*pad), COARSE)
    filter = estimators.create("histogram", split=split, skip=skip)
    filter.fit(scan)
    rng = np.random.default_rng(3)
    readings, poses, _ = draw_trial(scan, "E", 3, rng)
    filter.reset(rng)
    for count in range(1, 4):
        filter.update(readings[count - 1], poses[count - 1])
        table = joint_table(
            filter, readings[:count], poses[:count],
            lambda letter, *rest: reference.tabulated_log_likelihood(
                filter.tables, letter, *rest, scan.taxel_xy
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
        filter = estimators.create("histogram", split=split, cell=0.8)
        filter.fit(scan)
        x, y, angle = filter.grid.centres
        gaps = []
        for reading, pose in zip(readings, poses, strict=True):
            for column, row in rng.integers(len(x), size=(40, 2)):
                state = (x[column], y[row], angle[0])
                literal = reference.log_likelihood(filter.maps["E"], state, reading, pose, scan.taxel_xy)
                tabulated = reference.tabulated_log_likelihood(
                    filter.tables, 0, state, reading, pose, scan.taxel_xy
                )
                gaps.append(literal - tabulated)
        errors.append(math.sqrt(np.mean(np.square(gaps))))
    assert errors[1] < errors[0] / 2.5, errors
    assert errors[1] < 0.5, errors


def test_skipping_changes_no_answer(scan):
    lazy, full = (estimators.create("histogram", bins=2000, skip=skip) for skip in (True, False))
    lazy.fit(scan)
    full.fit(scan)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        readings, poses, _ = draw_trial(scan, scan.letters[seed % 4], 25, rng)
        lazy.reset(rng)
        full.reset(rng)
        for reading, pose in zip(readings, poses, strict=True):
            lazy.update(reading, pose)
            full.update(reading, pose)
            ours, whole = lazy.estimate(), full.estimate()
            assert ours.label == whole.label
            assert ours.robot_in_object.tolist() == whole.robot_in_object.tolist()
            assert ours.probabilities == pytest.approx(whole.probabilities, abs=1e-7)
    assert full.work["skipped"]["bins"] == 0
    assert lazy.work["skipped"]["bins"] > lazy.work["likelihood_evaluations"]
    made_and_skipped = lazy.work["likelihood_evaluations"] + lazy.work["skipped"]["bins"]
    assert made_and_skipped == full.work["likelihood_evaluations"]


def test_every_trial_finds_the_shape_and_its_place(scan):
    filter = estimators.create("histogram", bins=10_000)
    filter.fit(scan)
    errors = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        label = scan.letters[seed % 4]
        readings, poses, truth = draw_trial(scan, label, 20, rng)
        filter.reset(rng)
        for reading, pose in zip(readings, poses, strict=True):
            filter.update(reading, pose)
        got = filter.estimate()
        assert got.label == label
        off = invert(got.robot_in_object) - invert(truth)  # of the object's middle, in the robot frame
        errors.append(np.hypot(off[0], off[1]))
    # A bin is 0.8 mm wide and turned by up to 11 degrees.
    assert np.mean(errors) < 0.9
    assert max(errors) < 2.5


def test_a_sequence_may_be_as_long_as_it_likes(scan):
    filter = estimators.create("histogram", bins=100)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    test = scan.where("test", "E")
    for k in range(600):  # past several times that the history's arrays grow
        filter.update(test.readings[k % len(test)], test.poses[k % len(test)])
    got = filter.estimate()
    assert got.label == "E"
    assert sum(got.probabilities.values()) == pytest.approx(1)
