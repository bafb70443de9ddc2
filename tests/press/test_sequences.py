import numpy as np
import pytest
from level_world import at_few_angles, level_press, level_scan

from tactsim import models
from tactsim.core import InputError
from tactsim.press import SensorOptions, press_letter, scan_letters

pytestmark = pytest.mark.usefixtures("few_angles")

FULL = level_scan(
    letters=("I",),
    press=level_press(dynamics="full", frame_rate=100.0),
    sensor=SensorOptions(noise=0, resolution=0),
    placement_mm=0,
    placement_rad=0,
    test_poses="same",
)


@pytest.fixture(scope="module")
def taken():
    with at_few_angles():
        return scan_letters(FULL, cache=False, sequence=True)


def test_a_scan_holds_the_images_of_each_press(taken):
    scan, work = taken
    assert scan.sequence.shape == (96, len(scan.sequence_times), 36)
    assert scan.sequence_times == pytest.approx(np.arange(1, len(scan.sequence_times) + 1) / 100)
    for row in np.flatnonzero(scan.readings.any(axis=1))[[3, 25, -1]]:
        press = press_letter(models.letter("I"), scan.poses[row], FULL)
        before = len(press.times) - 1
        assert scan.sequence[row, :before] == pytest.approx(press.sequence[:-1], abs=1e-4)
        assert scan.sequence[row, before:] == pytest.approx(
            np.tile(press.ideal, (len(scan.sequence_times) - before, 1)), abs=1e-4
        )
    assert np.array_equal(scan.sequence[:, -1], scan.readings.astype(np.float32))
    assert scan.sequence_times[-1] >= work["settle_time"]["longest"]


def test_the_force_of_each_press_ends_at_the_set_force_or_is_none(taken):
    scan, work = taken
    touching = scan.readings.any(axis=1)
    assert scan.sequence_force[touching, -1] == pytest.approx(2.0, rel=1e-3)
    assert not scan.sequence_force[~touching].any()
    assert (~touching).any()
    assert np.count_nonzero(touching) == 2 * work["presses"]  # the test readings are the same presses


def test_how_presses_settle_is_summed_up(taken):
    _, work = taken
    assert 0.03 < work["settle_time"]["median"] <= work["settle_time"]["longest"] < 1
    assert 0 <= work["overshoot"] < 0.01


def test_images_have_the_sensor_s_imperfections_with_random_numbers_of_their_own(taken):
    sensor = SensorOptions(noise=3.0, resolution=0.5, gain_spread=0.3, drift=5.0, dead_taxels=(7,))
    options = FULL.model_copy(update={"sensor": sensor})
    scan, _ = scan_letters(options, cache=False, sequence=True)
    usual, work = scan_letters(options, cache=False)
    assert np.array_equal(scan.readings, usual.readings)
    assert usual.sequence is None
    assert work["settle_time"]["median"] > 0
    untouched = ~taken[0].readings.any(axis=1)
    images = scan.sequence[untouched]
    assert np.delete(images, 7, axis=2).std() == pytest.approx(3.0, rel=0.02)
    assert not images[:, :, 7].any()
    assert np.abs(images.mean()) < 0.1  # the zero drifts from press to press, not from image to image
    assert np.array_equal(scan.sequence, np.round(scan.sequence / 0.5) * 0.5)
    assert np.corrcoef(images[:, 0, 0], images[:, 1, 0])[0, 1] < 0.3


def test_sequences_that_no_file_would_hold_are_refused(monkeypatch):
    monkeypatch.setattr("tactsim.press.scanning.LARGEST", 25_000)
    with pytest.raises(InputError, match=r"press\.frame_rate"):
        scan_letters(FULL, cache=False, sequence=True)
