"""The plain scene is one of the same bed, and how much faster a press is: deselected by default, as all that times."""

import numpy as np
import pytest
from bench_press import COVERED, exact, plain_default, time_rows, time_scan
from level_world import level_press
from plain_press import DEFAULT, TUNED, compile_plain, press_plain

from tactsim import models
from tactsim.core import Pad
from tactsim.press.bed import lay_bed, levels
from tactsim.press.scan_poses import grid_poses


@pytest.mark.parametrize(("constant", "share"), [(DEFAULT, 2e-3), (TUNED, 5e-3)])
def test_the_plain_scene_ends_where_the_press_does(constant, share):
    """Else it would be no plain scene of the same bed: its forces are the shares of the covered areas."""
    letter, poses = models.letter("E"), grid_poses()[[16, 90]]
    bed = lay_bed(levels(letter, level_press(skip=COVERED)), poses, *Pad().grid_lines(2))
    for springs, pose in zip(bed.springs, poses, strict=True):
        forces, _ = press_plain(compile_plain(letter, pose, springs, constant), len(springs.share), 2.0)
        area = bed.area[springs.rows]
        assert forces == pytest.approx(2.0 * area / area.sum(), abs=share * np.max(2.0 * area / area.sum()))


@pytest.mark.benchmark
def test_a_press_costs_a_three_hundredth_of_a_plain_one():
    seconds = time_rows([exact(), plain_default()], rounds=3)
    assert seconds["plain scene, default"] >= 300 * seconds["exact"]


@pytest.mark.benchmark
def test_two_thousand_presses_take_half_a_second():
    assert time_scan() <= 0.6
