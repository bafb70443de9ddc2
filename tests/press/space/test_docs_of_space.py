"""The hand of the page on objects in space is one."""

import re
from pathlib import Path

import numpy as np
import pytest

import tactsim
from tactsim.core.rigid import turned
from tactsim.models import solid
from tactsim.press.space import Hand, HandPress, SpaceOptions

PAGE = (Path(tactsim.__file__).parents[1] / "docs" / "objects-in-space.md").read_text(encoding="utf-8")


def test_the_hand_of_the_page_closes_on_what_lies_in_its_middle(tmp_path):
    (tmp_path / "hand.toml").write_text(re.findall(r"```toml\n(.*?)```", PAGE, re.S)[0])
    hand = Hand.load(tmp_path / "hand.toml")
    poses = np.array([pad.pose for pad in hand.pads])
    looks = turned(poses[:, 3:], np.array([0.0, 0, 1]))
    assert looks == pytest.approx(
        -poses[:, :3] / np.linalg.norm(poses[:, :3], axis=1, keepdims=True), abs=1e-3
    )
    press = HandPress([solid("egg")], hand, SpaceOptions())
    assert press.touch("egg", np.array([0.0, 0, 0, 1, 0, 0, 0])).met.all()
