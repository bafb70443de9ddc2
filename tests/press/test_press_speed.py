"""The press's speed against a plain scene: deselected by default, as all that times."""

import numpy as np
import pytest
from bench_press import COVERED, time_presses, time_scan
from plain_press import compile_plain, press_plain

from tactsim import models
from tactsim.core import Pad
from tactsim.press.bed import lay_bed
from tactsim.press.levels import levels
from tactsim.press.scan_poses import grid_poses


def test_the_plain_scene_ends_where_the_press_does():
    """Else it would be no plain scene of the same bed: its forces are the shares of the covered areas."""
    letter, poses = models.letter("E"), grid_poses()[[16, 90]]
    bed = lay_bed(levels(letter, COVERED), poses, *Pad().grid_lines(2))
    for springs, pose in zip(bed.springs, poses, strict=True):
        forces, _ = press_plain(compile_plain(letter, pose, springs), len(springs.share), 2.0)
        area = bed.area[springs.rows]
        assert forces == pytest.approx(2.0 * area / area.sum(), abs=2e-3 * np.max(2.0 * area / area.sum()))


@pytest.mark.benchmark
def test_a_press_costs_a_three_hundredth_of_a_plain_one():
    seconds = time_presses(rounds=3)
    assert seconds["plain scene, whole"] >= 300 * seconds["press, springs to forces"]


@pytest.mark.benchmark
def test_two_thousand_presses_take_half_a_second():
    assert time_scan() <= 0.6
