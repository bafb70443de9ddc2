from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tactsim import models
from tactsim.core import InputError
from tactsim.press import PressOptions, ScanOptions, press_letter, scan_letters
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_poses import grid_poses
from tactsim.press.scene import UnsettledError
from tactsim.press.touches import Touches


def both(name, pose, **press):
    letter = models.letter(name)
    still = press_letter(letter, pose, ScanOptions(press=PressOptions(**press)))
    moving = press_letter(letter, pose, ScanOptions(press=PressOptions(dynamics="full", **press)))
    return still, moving


@pytest.mark.parametrize("name", ["E", "I", "W"])
def test_it_ends_where_the_equilibrium_is(name):
    for pose in grid_poses()[5::24]:
        still, moving = both(name, pose)
        assert moving.ideal == pytest.approx(still.ideal, abs=5e-3 * still.ideal.max())


@pytest.mark.parametrize(
    "press",
    [
        {"force": 0.01},
        {"force": 100.0},
        {"tilt_x": 0.01, "tilt_y": -0.005},
        {"tilt_x": 0.01, "wrist_stiffness": 2000.0},
        {"relaxation": 0.0},
        {"ramp": 0.0, "approach_speed": 50.0},
        {"clearance": 0.0},
        {"moving_mass": 5.0},
        {"force": 1000.0, "thickness": 0.2},
    ],
)
def test_it_does_whatever_the_press_is_like(press):
    still, moving = both("E", [-3.4, 3.4, 0.5], **press)
    assert moving.ideal == pytest.approx(still.ideal, abs=5e-3 * still.ideal.max())


def test_a_rounded_letter_settles_too():
    letter, pose = models.letter("E", rounding=0.3), [0.0, 3.4, 0.5]
    still = press_letter(letter, pose)
    moving = press_letter(letter, pose, ScanOptions(press=PressOptions(dynamics="full")))
    assert moving.ideal == pytest.approx(still.ideal, abs=5e-3 * still.ideal.max())


def test_the_image_sequence_runs_from_nothing_to_the_reading():
    _, press = both("A", [0.0, 0.0, 0.3], frame_rate=500.0)
    assert press.sequence.shape == (len(press.times), 36)
    assert not press.sequence[0].any()
    assert np.array_equal(press.sequence[-1], press.ideal)
    assert np.diff(press.times[:-1]) == pytest.approx(0.002)
    total = press.sequence.sum(axis=1)
    touched = np.argmax(total > 0)
    assert 0 < touched < len(total) - 10
    # 0.2 mm at 10 mm/s, then a ramp of 50 ms
    assert press.times[touched] == pytest.approx(0.02, abs=0.01)
    assert press.times[np.argmax(total > 0.9 * total[-1])] == pytest.approx(0.065, abs=0.02)


@pytest.mark.parametrize(("rate", "apart"), [(10_000.0, 0.0005), (1000.0, 0.001)])
def test_images_come_as_often_as_asked_for_but_once_a_step_at_most(rate, apart):
    _, press = both("I", [0.0, 0.0, 0.3], frame_rate=rate)
    assert np.diff(press.times[:-1]) == pytest.approx(apart)


def test_a_press_that_does_not_settle_is_reported():
    options = ScanOptions(letters=("E",), press=PressOptions(dynamics="full", time_limit=0.05))
    with pytest.raises(UnsettledError, match=r"'E'.*time_limit"):
        press_letter(models.letter("E"), [0.0, 0.0, 0.0], options)
    with pytest.raises(InputError, match=r"192 of 192 presses of 'E' do not come to rest.*time_limit"):
        scan_letters(options, cache=False)


def test_a_letter_beside_the_pad_has_no_sequence():
    _, press = both("I", [40.0, 0.0, 0.0])
    assert press.sequence is None
    assert not press.reading.any()


def test_a_scan_can_be_taken_with_full_dynamics():
    options = ScanOptions(
        letters=("I",), press=PressOptions(dynamics="full"), placement_mm=0, placement_rad=0
    )
    scan, work = scan_letters(options, cache=False)
    usual, _ = scan_letters(options.model_copy(update={"press": PressOptions()}), cache=False)
    assert work["presses"] > 100
    assert np.abs(scan.readings - usual.readings).max() <= 0.7 + 5e-3 * usual.readings.max()


def test_a_scan_takes_the_last_image_of_each_press():
    letter, options = models.letter("I"), ScanOptions(press=PressOptions(dynamics="full"))
    poses = np.array([[0.0, 0.0, 0.3], [-3.4, 3.4, 0.0]])
    readings, _ = ideal_readings(Touches.of(letter, poses), options)
    for reading, pose in zip(readings, poses, strict=True):
        assert reading == pytest.approx(press_letter(letter, pose, options).ideal, rel=1e-12)


def test_a_sliver_stops_where_the_layer_ends():
    """0.01 mm of I touch: springs without an end would let it sink by 30 mm, and settle for seconds."""
    half = np.concatenate(models.letter("I").contours).max(axis=0)
    pose = [half[0] + 7.7 - 0.01, 0.0, 0.0]
    still, moving = both("I", pose)
    assert moving.ideal == pytest.approx(still.ideal, abs=5e-3 * still.ideal.max())
    assert moving.times[-1] < 1.0


def test_a_worker_s_unsettled_press_is_reported_too(monkeypatch):
    monkeypatch.setattr("tactsim.press.scanning.WORTH_A_WORKER", 1e-3)
    options = ScanOptions(letters=("E",), press=PressOptions(dynamics="full", time_limit=0.05))
    with pytest.raises(InputError, match=r"'E'.*time_limit"):
        scan_letters(options, jobs=2, cache=False)


def test_a_press_that_failed_leaves_nothing_behind():
    """The same scene serves the next press: it must be as if compiled anew, bit for bit."""
    letter, pose = models.letter("E"), [0.0, 3.4, 0.2]
    tilted = {"dynamics": "full", "tilt_x": 0.01, "wrist_stiffness": 3000.0}
    with pytest.raises(UnsettledError):
        press_letter(letter, pose, ScanOptions(press=PressOptions(time_limit=0.04, **tilted)))
    used = press_letter(letter, pose, ScanOptions(press=PressOptions(**tilted)))
    with ThreadPoolExecutor(1) as other:  # another thread has scenes of its own
        fresh = other.submit(press_letter, letter, pose, ScanOptions(press=PressOptions(**tilted))).result()
    assert np.array_equal(used.sequence, fresh.sequence)
