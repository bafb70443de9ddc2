"""What is said of readings: how often eq. 3 is right, counted where the truth is known; near copies; a single load."""

from dataclasses import replace

import numpy as np
import pytest

from tactsim.bench.runs.scan_quality import eq3_agreement, near_copies, notes_on
from tactsim.core import Scan
from tactsim.estimators import Options, create


@pytest.fixture
def one_press():
    """Press I at the origin: taxels on it read 10 and 4 kPa, taxels off it 3 and 0."""
    taxel_xy = np.array([[0.0, 0.0], [0.0, 3.0], [30.0, 0.0], [30.0, 3.0]])
    return Scan(np.array([[10.0, 4.0, 3.0, 0.0]]), np.zeros((1, 3)), ["I"], ["train"], taxel_xy)


# Threshold and ratio, and the share that is right by hand.
CASES = {
    "eq. 3's own, 3 kPa is unknown": ({}, 1.0),
    "a lower ratio takes 3 kPa for contact": ({"ratio": 0.2}, 0.75),
    "a higher threshold and ratio take 4 kPa for none": ({"threshold": 5.0, "ratio": 0.5}, 0.75),
}


@pytest.mark.parametrize("case", CASES)
def test_eq3_is_judged_with_the_estimators_own_threshold_and_ratio(one_press, case):
    options, share = CASES[case]
    assert eq3_agreement(one_press, create("histogram", bins=100, **options).options) == share
    assert eq3_agreement(one_press, Options()) == 1.0  # with its own, where the estimator has none
    assert eq3_agreement(replace(one_press, labels=np.array(["knob"])), Options()) is None  # it is no letter


def repeated(noise, moved=0.0, loads=None):
    """Ten presses of two objects, each made once to train and once to test."""
    rng = np.random.default_rng(0)
    readings, poses = 30 * rng.random((10, 16)), rng.normal(size=(10, 3))
    return Scan(
        np.concatenate([readings, readings + noise * rng.standard_normal((10, 16))]),
        np.concatenate([poses, poses + moved]), np.array(["A", "E"] * 10), np.repeat(["train", "test"], 10),
        rng.normal(size=(16, 2)), loads=loads,
    )  # fmt: skip


def test_presses_repeated_at_one_pose_are_near_copies():
    share, correlation = near_copies(repeated(0.1))
    assert share == 1
    assert correlation > 0.999
    (note,) = notes_on(repeated(0.1))
    assert note.startswith(
        "100% of the test presses are near copies of training presses (same pose, correlation 0.9"
    )


def test_whole_turns_between_two_presses_do_not_count():
    scan = repeated(0.1)
    turned = replace(scan, poses=scan.poses + np.where(np.arange(20)[:, None] < 10, [0, 0, 2 * np.pi], 0.0))
    assert near_copies(turned) == pytest.approx(near_copies(scan))


@pytest.mark.parametrize("scan", [repeated(3.0), repeated(0.1, moved=0.5)])
def test_noisy_presses_and_presses_elsewhere_are_none(scan):
    assert near_copies(scan)[0] == 0
    assert notes_on(scan) == []


def test_a_press_of_another_object_or_of_nothing_is_no_copy():
    scan = repeated(0.0)
    others = replace(scan, labels=np.array(["A", "E"] * 5 + ["E", "A"] * 5))
    assert near_copies(others) == (0, 0)
    assert near_copies(replace(scan, readings=np.zeros((20, 16)))) == (0, 0)
    assert near_copies(scan.where("test"))[0] == 0


def test_a_training_set_of_one_load_is_said_to_be_one():
    one = repeated(3.0, loads=[2.0] * 9 + [np.nan] + [1.0] * 10)
    (note,) = notes_on(one)
    assert note.startswith("all training presses are of one load, 2 N")
    assert notes_on(replace(one, loads=np.linspace(1, 2, 20))) == []
    assert notes_on(replace(one, loads=np.full(20, np.nan))) == []
