"""Presses with a load of their own: every engine, the law they are drawn from, the cache and the skips."""

import numpy as np
import pytest
from level_world import level_scan

from tactsim import models
from tactsim.press import ScanOptions, scan_letters
from tactsim.press.engine import ideal_readings
from tactsim.press.touches import Touches, draw_loads

LETTER = models.letter("E")
POSES = np.array([[1.0, 2.0, 0.3], [-3.0, 4.0, 1.2], [6.0, -2.0, 2.0], [40.0, 0.0, 0.0]])
TILTS = np.array([[0.004, -0.003], [0.002, 0.006], [-0.004, 0.001], [0.0, 0.003]])
LOAD = np.array([0.4, 1.0, 1.7, 2.0])


@pytest.mark.parametrize(
    "press",
    [
        {"engine": "bed", "wrist_stiffness": "rigid"},
        {"engine": "collide"},
        {"engine": "relief"},
        {"stiffness": 1.0},  # so soft that the layer is as stiff as the load asks for
        {"dynamics": "full"},
    ],
    ids=str,
)
def test_a_press_with_its_own_load_is_one_with_that_force(press):
    together, _ = ideal_readings(Touches(LETTER, POSES, TILTS, load=LOAD), ScanOptions(press=press))
    for row, load in enumerate(LOAD):
        touches = Touches(LETTER, POSES[row : row + 1], TILTS[row : row + 1])
        alone, _ = ideal_readings(touches, ScanOptions(press={**press, "force": 2.0 * load}))
        assert together[row] == pytest.approx(alone[0], abs=1e-12 * max(1.0, alone.max()))
    assert together[2].max() > 2 * together[0].max() > 0


def test_readings_of_a_level_face_grow_with_the_load_and_of_a_tilted_one_change_their_pattern():
    options = ScanOptions(press={"wrist_stiffness": "rigid"})
    light, heavy = (
        ideal_readings(Touches(LETTER, POSES[:1], np.zeros((1, 2)), load=np.array([load])), options)[0][0]
        for load in (0.3, 1.0)
    )
    assert light == pytest.approx(0.3 * heavy, rel=1e-12)
    light, heavy = (
        ideal_readings(Touches(LETTER, POSES[:1], 5 * TILTS[:1], load=np.array([load])), options)[0][0]
        for load in (0.3, 1.0)
    )
    assert np.abs(light / light.sum() - heavy / heavy.sum()).max() > 0.01


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_loads_are_above_0_with_mean_1_and_the_stated_deviation(spread):
    loads = draw_loads(400_000, spread, np.random.default_rng(0))
    assert loads.min() > 0
    assert loads.mean() == pytest.approx(1, abs=5 * spread / np.sqrt(len(loads)))
    assert loads.std() == pytest.approx(spread, rel=0.03)


def level(**options):
    return level_scan(letters=("E",), sensor={"noise": 0.0, "resolution": 0.0}, **options)


def test_a_test_load_changes_the_test_presses_alone():
    usual, _ = scan_letters(level())
    lighter, _ = scan_letters(level(test_load=0.5))
    test = usual.split == "test"
    assert np.array_equal(lighter.readings[~test], usual.readings[~test])
    assert lighter.readings[test] == pytest.approx(0.5 * usual.readings[test], rel=1e-12)


def test_the_cache_knows_loads_from_each_other(few_angles):
    options = {"letters": ("E",), "placement_tilt": 0.01}
    scan_letters(ScanOptions(**options))
    _, work = scan_letters(ScanOptions(**options, test_load=0.5))
    assert work["skipped"]["cached"] == 48  # the training presses, whose load is the same
    cached, work = scan_letters(ScanOptions(**options, test_load=0.5))
    assert work["presses"] == 0
    fresh, _ = scan_letters(ScanOptions(**options, test_load=0.5), cache=False)
    assert np.array_equal(cached.readings, fresh.readings)
    _, work = scan_letters(ScanOptions(**options, load_spread=0.1))
    assert work["skipped"]["cached"] == 0
