"""Touches taken and taken back: what is left believes as if the others had never been."""

import time

import numpy as np
import pytest

from tactsim.bench.watching.recogniser import Recogniser, Touch, on_taxels
from tactsim.core import InputError, Scan
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


def test_the_delay_counts_from_the_touch_s_last_reading(recogniser, scan):
    recogniser.begin_anew()
    touch = touches(scan, 1)[0]
    late = Touch(touch.pressures, touch.sensor_in_robot, time.monotonic() - 3.0)
    belief = recogniser.take(late)
    assert belief.delay >= 3.0
    before = len(recogniser.delays)
    assert recogniser.take(touches(scan, 1)[0]).delay == recogniser.delays[before]
    recogniser.begin_anew()
    assert recogniser.delays[before - 1] == belief.delay, (
        "another object does not make it forget a slow touch"
    )


def test_an_estimator_that_cannot_propose_is_refused_before_the_first_touch(scan):
    train = on_taxels(scan, scan.taxel_xy, "x")
    with pytest.raises(InputError, match="explore at random"):
        Recogniser.fitted(create("nearest"), train, 0, train.poses)


@pytest.mark.parametrize("verb", ["reset", "update", "estimate", "propose"])
def test_an_estimator_that_would_end_the_program_is_a_failure(scan, verb):
    """In the thread that recognises nobody would hear of it."""
    train = on_taxels(scan, scan.taxel_xy, "x")
    recogniser = Recogniser.fitted(create("histogram", bins=1000), train, 0)

    def end(*_):
        raise SystemExit(0)

    setattr(recogniser._estimator, verb, end)
    with pytest.raises(RuntimeError, match="the estimator histogram ended the program"):
        recogniser.take(touches(scan, 1)[0])
        recogniser.choose(train.poses)
        recogniser.begin_anew()


def test_training_readings_follow_the_pad_s_taxels(scan):
    order = [5, 0, 17]
    train = on_taxels(scan, scan.taxel_xy[order], "x")
    half = scan.where("train")
    np.testing.assert_array_equal(train.readings, half.readings[:, order])
    np.testing.assert_array_equal(train.taxel_xy, scan.taxel_xy[order])


def test_another_pad_is_refused(scan):
    with pytest.raises(InputError, match=r"x\.npz was taken on another pad: 36 of the pad's 36 taxels"):
        on_taxels(scan, scan.taxel_xy + 0.5, "x.npz")
