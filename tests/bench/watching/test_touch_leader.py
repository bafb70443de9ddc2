"""Touches that are asked for, taken, redone and skipped."""

import time
from contextlib import contextmanager

import numpy as np
import pytest

from tactsim.bench.pad.simulated_hand import SimulatedHand
from tactsim.bench.watching import PadReader
from tactsim.bench.watching.recogniser import Recogniser, on_taxels
from tactsim.bench.watching.touch_leader import TouchLeader
from tactsim.core import Scan, compose
from tactsim.core.reading import Reading
from tactsim.estimators import create
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.session import Plan
from tactsim.models import letter

POSES = [(0.0, 4.0, 0.0), (0.0, -4.0, 0.0), (0.0, 0.0, 1.6), (60.0, 0.0, 0.0)]
PLACE = np.array([1.0, 0.5, 0.4])


@pytest.fixture(scope="module")
def scan(scan_file):
    return Scan.load(scan_file)


@pytest.fixture(scope="module")
def fitted(scan):
    return Recogniser.fitted(create("histogram", bins=1000), on_taxels(scan, scan.taxel_xy, "x"), 0)


@pytest.fixture
def recogniser(fitted):
    fitted.begin_anew()
    return fitted


@contextmanager
def led(recogniser, device, poses=POSES, frames=5):
    plan = Plan(label="live", poses=poses, frames=frames, window=5, patience=1.0, touch_kpa=10.0)
    hidden = SimulatedHand(letter("I"), np.array(poses), device, 0, PLACE)
    leading = TouchLeader(recogniser, plan, device.pad, "random", 0, hidden)
    with PadReader(hidden, device, "here", on_reading=leading.take) as reader, leading:
        yield leading, reader


def test_a_hidden_object_is_recognised_and_its_touches_lie_where_they_were_asked_for(
    recogniser, device, eventually
):
    with led(recogniser, device) as (leading, reader):
        eventually(lambda: len(leading.beliefs) == len(POSES))
        belief = leading.view().belief
        assert belief.estimate.label == "I"
        asked = {tuple(touch.sensor_in_robot) for touch in belief.touches}
        assert asked == set(POSES)
        empty = next(touch for touch in belief.touches if touch.sensor_in_robot[0] == 60.0)
        assert np.abs(empty.pressures).max() < 10.0
        best = belief.estimate.robot_in_object
        np.testing.assert_allclose(
            belief.sensor_in_object[0], compose(best, belief.touches[0].sensor_in_robot)
        )
        eventually(lambda: "every pose was tried" in leading.view().phase)
        assert leading.error is None
        assert reader.error is None


def test_a_touch_is_redone_and_everything_begun_anew(recogniser, device, eventually):
    with led(recogniser, device, POSES[:2]) as (leading, _):
        eventually(lambda: "every pose was tried" in leading.view().phase)
        last = leading.view().belief.touches[-1].sensor_in_robot
        leading.redo()
        eventually(lambda: len(leading.beliefs) == 3)
        touches = leading.view().belief.touches
        assert len(touches) == 2
        np.testing.assert_array_equal(touches[-1].sensor_in_robot, last)
        eventually(lambda: "every pose was tried" in leading.view().phase)
        leading.begin_anew()
        eventually(lambda: leading.view().belief.estimate is None)
        eventually(lambda: len(leading.view().belief.touches) == 2)


@pytest.mark.parametrize("command", ["redo", "begin_anew"])
def test_a_touch_is_void_as_soon_as_a_person_asks_for_another(recogniser, device, eventually, command):
    leading = TouchLeader(
        recogniser, Plan(label="live", poses=POSES, frames=5, window=5), device.pad, "random", 0
    )
    with leading:
        eventually(lambda: leading.view().asked is not None)
    before = leading.view()  # its thread has ended, so that nothing is done about the command
    getattr(leading, command)()
    press(leading)
    assert leading.view() is before


def press(leading):
    for level, count in ((0.0, 10), (60.0, 20)):
        for _ in range(count):
            leading.take(Reading(np.full(36, level), time.monotonic()))


def test_a_tare_says_what_is_noise(recogniser, device, scan, eventually):
    """A pad whose noise is above the device file's `touch_kpa` is never free until it is tared."""
    rng = np.random.default_rng(0)
    plan = Plan(label="live", poses=POSES, frames=5, window=5)
    leading = TouchLeader(recogniser, plan, device.pad, "random", 0)

    def feed(level, count):
        for _ in range(count):
            leading.take(Reading(level + 3 * rng.standard_normal(36), time.monotonic()))

    with leading:
        eventually(lambda: leading.view().asked is not None)
        feed(0.0, 60)
        assert leading.view().phase == "lift it off the pad"
        leading.tared(calibration_of([3.0] * 36))
        feed(0.0, 60)
        assert leading.view().phase == "press it on the pad"
        feed(60.0, 60)
        eventually(lambda: len(leading.beliefs) == 1)


def calibration_of(noise):
    return Calibration(
        device="x", port="x", taken="2026-01-01T00:00:00Z", frames=40, tare=[0.0] * 36, noise=noise,
        gain=[1.0] * 36,
    )  # fmt: skip
