"""A plain scene of the same bed, in MuJoCo as it comes, ends where the press does."""

import numpy as np
import pytest
from level_world import level_press
from plain_press import DEFAULT, TUNED, compile_plain, press_plain

from tactsim import models
from tactsim.core import Pad
from tactsim.press.bed import lay_bed, levels
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import grid_poses


@pytest.mark.parametrize(("constant", "share"), [(DEFAULT, 2e-3), (TUNED, 5e-3)])
def test_the_plain_scene_ends_where_the_press_does(constant, share):
    """Else it would be no plain scene of the same bed: its forces are the shares of the covered areas."""
    letter, poses = models.letter("E"), grid_poses()[[16, 90]]
    bed = lay_bed(levels(letter, level_press(skip=Skips(parts=False))), poses, *Pad().grid_lines(2))
    for springs, pose in zip(bed.springs, poses, strict=True):
        forces, _ = press_plain(compile_plain(letter, pose, springs, constant), len(springs.share), 2.0)
        area = bed.area[springs.rows]
        assert forces == pytest.approx(2.0 * area / area.sum(), abs=share * np.max(2.0 * area / area.sum()))
