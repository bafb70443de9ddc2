"""Sequences of presses at rest: each image is that of a press with the load of its time."""

import numpy as np
import pytest
from level_world import level_press, level_scan
from manifold3d import Manifold

from tactsim import models
from tactsim.core.moments import with_moments
from tactsim.press import SensorOptions, scan_letters

pytestmark = pytest.mark.usefixtures("few_angles")

QUIET = SensorOptions(noise=0, resolution=0)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    path = tmp_path_factory.mktemp("shapes") / "ball.stl"
    models.export(models.relief("ball", Manifold.sphere(20, 24)), path)
    return str(path)


def options_of(ball, **changes):
    press = level_press(**({"ramp": 0.05, "frame_rate": 80.0} | changes))
    return level_scan(
        letters=("I",), shapes=(ball,), press=press, sensor=QUIET, load_spread=0.3, test_poses="same"
    )


def test_each_image_is_a_press_at_rest_under_the_load_of_its_time(ball):
    scan, work = scan_letters(options_of(ball), cache=False, sequence=True)
    usual, _ = scan_letters(options_of(ball), cache=False)
    assert np.array_equal(scan.readings, usual.readings)
    assert scan.sequence_times == pytest.approx(np.arange(1, scan.sequence.shape[1] + 1) / 80)
    # s^2 (3 - 2 s) at a quarter, half, and three quarters of the ramp.
    for frame, share in enumerate((0.15625, 0.5, 0.84375, 1.0, 1.0, 1.0)):
        lighter, _ = scan_letters(options_of(ball, force=2.0 * share), cache=False)
        assert scan.sequence[:, frame] == pytest.approx(lighter.readings, rel=1e-6, abs=1e-4)
        touching = scan.readings.any(axis=1)
        whole = scan.sequence_force[:, -1]
        assert scan.sequence_force[:, frame] == pytest.approx(share * whole, rel=1e-6)
        assert (whole > 0).tolist() == touching.tolist()
    assert whole[touching].std() > 0.3  # each press has a load of its own
    assert work["presses"] == work["engine_exact"] + work["engine_relief"] == 4 * np.count_nonzero(touching)
    with_moments(scan, 3)  # the whole load is held long enough to be known as a plateau


def test_a_press_that_tips_over_has_no_images():
    press = level_press(wrist_stiffness=16.0, ramp=0.05, frame_rate=40.0)
    options = level_scan(letters=("O",), press=press, sensor=QUIET, test_poses="same")
    scan, _ = scan_letters(options, cache=False, sequence=True)
    blanks = scan.meta["blanks"]
    assert "tips over" in blanks[0]["reason"]
    assert len(scan.sequence) == len(scan) == 96 - len(blanks)
