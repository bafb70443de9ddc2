"""Work that is left out must not change an answer, and is counted."""

import numpy as np
import pytest
from level_world import level_press, level_scan
from pydantic import ValidationError

from tactsim import models
from tactsim.press import PressOptions, SensorOptions, bed, scan_letters
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_poses import grid_poses
from tactsim.press.touches import Touches

FAR = np.array([[40.0, 0.0, 0.0], [0.0, -30.0, 1.0]])
POSES = np.concatenate([grid_poses()[::9], FAR])


def ideal(name, engine):
    options = level_scan(press=level_press(engine=engine))
    return ideal_readings(Touches.of(models.letter(name), POSES), options)


@pytest.mark.parametrize("name", ["A", "O"])
def test_a_level_flat_face_needs_no_solver(name):
    usual, work = ideal(name, "auto")
    solved, more = ideal(name, "bed")
    assert solved == pytest.approx(usual, abs=1e-8 * usual.max())
    assert not usual[-len(FAR) :].any()
    assert (work["no_contact"], work["presses"]) == (len(FAR), len(POSES) - len(FAR))
    assert (work["solver"], work["engine_exact"], work["engine_bed"]) == (work["presses"], work["presses"], 0)
    assert (more["solver"], more["engine_exact"], more["engine_bed"]) == (0, 0, work["presses"])


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
    options = level_scan(**exact, sensor=SensorOptions(noise=0.0))
    scan, work = scan_letters(options, cache=False)
    assert (work["presses"] + work["skipped"]["no_contact"], work["skipped"]["known"]) == (192, 192)
    train, test = scan.where("train").readings, scan.where("test").readings
    assert np.array_equal(train, test)
    pressed, _ = ideal_readings(Touches.of(models.letter("U"), grid_poses()), options)
    assert test == pytest.approx(pressed, abs=0.35 + 1e-9)  # half a step


def test_switches_of_old_files_are_taken_if_they_were_on():
    old = {"no_contact": True, "cells": True, "parts": True, "stages": True, "solver": True, "known": True}
    assert PressOptions.model_validate({"force": 3.0, "skip": old}) == PressOptions(force=3.0)
    with pytest.raises(ValidationError, match="skip"):
        PressOptions.model_validate({"skip": old | {"parts": False}})


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
