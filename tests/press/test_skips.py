"""Work that is left out must not change an answer; each switch and counter is shown to matter."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from level_world import level_press, level_scan

from tactsim import models
from tactsim.press import bed, scan_letters
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import grid_poses
from tactsim.press.touches import Touches

FAR = np.array([[40.0, 0.0, 0.0], [0.0, -30.0, 1.0]])
POSES = np.concatenate([grid_poses()[::9], FAR])


@cache
def ideal(name, engine="bed", **skips):
    options = level_scan(press=level_press(engine=engine, skip=Skips(**skips)))
    return ideal_readings(Touches.of(models.letter(name), POSES), options)


@pytest.mark.parametrize("name", ["A", "O"])
def test_a_level_flat_face_needs_no_solver(name):
    usual, work = ideal(name, "auto")
    solved, more = ideal(name)
    assert solved == pytest.approx(usual, abs=1e-8 * usual.max())
    assert (work["no_contact"], work["presses"]) == (len(FAR), len(POSES) - len(FAR))
    assert (work["engine_exact"], work["engine_bed"]) == (work["presses"], 0)
    assert (more["engine_exact"], more["engine_bed"]) == (0, work["presses"])


def test_a_press_beside_the_pad_reads_nothing_with_and_without_physics():
    usual, work = ideal("A")
    without, more = ideal("A", no_contact=False)
    assert np.array_equal(usual, without)
    assert (work["no_contact"], more["no_contact"]) == (len(FAR), 0)


@pytest.mark.parametrize("engine", ["bed", "collide"])
def test_stages_of_mujoco_that_are_left_out_change_no_bit(engine, monkeypatch):
    touches = Touches(models.letter("O"), POSES, np.full((len(POSES), 2), 0.01))
    options = level_scan(press=level_press(engine=engine, wrist_stiffness=300.0))
    usual, _ = ideal_readings(touches, options)
    monkeypatch.setattr(f"tactsim.press.{'scene' if engine == 'bed' else engine}.UNREAD_STAGES", ())
    with ThreadPoolExecutor(1) as other:  # another thread compiles scenes of its own
        whole, _ = other.submit(ideal_readings, touches, options).result()
    assert np.array_equal(usual, whole)


def test_poses_in_blocks_do_not_change_a_bit(monkeypatch):
    options = level_scan(press=level_press(engine="bed", wrist_stiffness=300.0))
    touches = Touches(
        models.letter("A"), POSES, np.random.default_rng(0).normal(scale=0.01, size=(len(POSES), 2))
    )
    once, _ = ideal_readings(touches, options)
    for poses in (1, 7):
        cells = np.prod([len(lines) - 1 for lines in options.cell_lines])
        monkeypatch.setattr(bed, "_BLOCK", poses * cells)
        in_blocks, _ = ideal_readings(touches, options)
        assert np.array_equal(once, in_blocks)
    assert once.any()


def test_a_known_pose_is_not_pressed_again():
    exact = {"letters": ("U",), "test_poses": "same", "placement_mm": 0.0, "placement_rad": 0.0}
    scan, work = scan_letters(level_scan(**exact), cache=False)
    other, more = scan_letters(level_scan(**exact, press=level_press(skip=Skips(known=False))), cache=False)
    assert (work["presses"], work["skipped"]["known"]) == (192, 192)
    assert (more["presses"], more["skipped"]["known"]) == (384, 0)
    assert np.array_equal(scan.readings, other.readings)


def test_all_switches_leave_a_scan_as_it_is():
    usual, _ = scan_letters(level_scan(letters=("E",)), cache=False)
    off = level_press(skip=Skips(no_contact=False, known=False), engine="bed")
    other, work = scan_letters(level_scan(letters=("E",), press=off), cache=False)
    assert np.array_equal(usual.readings, other.readings)  # the resolution swallows the rounding
    assert work["presses"] == 384
    assert not any(work["skipped"].values())


@pytest.mark.long
def test_any_number_of_processes_gives_the_same_bits(monkeypatch):
    monkeypatch.setattr("tactsim.press.scanning.WORTH_A_WORKER", 1e-3)
    options = level_scan(letters=("I", "O"), test_poses="random")
    done = []
    alone, work = scan_letters(options, cache=False)
    many, same = scan_letters(options, jobs=2, cache=False, progress=lambda n, total: done.append((n, total)))
    assert np.array_equal(alone.readings, many.readings)
    assert np.array_equal(alone.poses, many.poses)
    assert alone.meta == many.meta
    assert work == same
    assert done[-1] == (768, 768)
    assert [n for n, _ in done] == sorted(n for n, _ in done)
