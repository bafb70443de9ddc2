"""Touches taken and taken back: what is left believes as if the others had never been."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tactsim.bench.watching.recogniser import Recogniser, Touch, on_taxels
from tactsim.core import Scan
from tactsim.estimators import create


@pytest.fixture(scope="module")
def scan(scan_file):
    return Scan.load(scan_file)


@pytest.fixture(scope="module")
def recogniser(scan):
    candidates = scan.where("train").poses
    return Recogniser.fitted(
        create("histogram", bins=1000), on_taxels(scan, scan.taxel_xy, "x"), 0, candidates
    )


def touches(scan, count):
    test = scan.where("test", "I")
    return [Touch(test.readings[k], test.poses[k], time.monotonic()) for k in range(count)]


def probabilities(belief):
    return list(belief.estimate.probabilities.values())


def test_a_touch_that_is_taken_back_never_was(recogniser, scan):
    first, second, third = touches(scan, 3)
    recogniser.begin_anew()
    recogniser.take(first)
    wanted = recogniser.take(third)
    recogniser.begin_anew()
    for touch in (first, second, third):
        recogniser.take(touch)
    left = recogniser.take_back(1)
    assert [touch.pressures.tolist() for touch in left.touches] == [
        touch.pressures.tolist() for touch in (first, third)
    ]
    assert probabilities(left) == pytest.approx(probabilities(wanted))
    np.testing.assert_allclose(left.sensor_in_object, wanted.sensor_in_object)
    assert left.delay is None
    assert recogniser.take_back(0).estimate is not None
    assert recogniser.take_back(0).estimate is None


def test_training_readings_follow_the_pad_s_taxels(scan):
    order, number = [5, 0, 17], np.arange(len(scan))
    scan = replace(scan, presses=number // 2, moments=(1 + number % 2) / 2, views=number % 3)
    train = on_taxels(scan, scan.taxel_xy[order], "x")
    half = scan.where("train")
    for kept in ("poses", "labels", "presses", "moments", "views"):
        np.testing.assert_array_equal(getattr(train, kept), getattr(half, kept))
    np.testing.assert_array_equal(train.readings, half.readings[:, order])
    np.testing.assert_array_equal(train.taxel_xy, scan.taxel_xy[order])
