"""Hands: pads that close at once, stop for each other, and files that describe them."""

import re
from pathlib import Path

import meshes
import numpy as np
import pytest

import tactsim
from tactsim import models
from tactsim.core import InputError, rigid
from tactsim.solids import Hand, HandPress, SpaceOptions, SpacePress

GRIPPER = """
name = "gripper"
[[pads]]
pose = [-50, 0, 0, 0.7071067811865476, 0, 0.7071067811865476, 0]
stroke = 100
[[pads]]
pose = [50, 0, 0, 0.7071067811865476, 0, -0.7071067811865476, 0]
stroke = 100
"""
HERE = np.array([0.0, 0, 0, 1, 0, 0, 0])


def hand(tmp_path: Path, text: str = GRIPPER) -> Hand:
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return Hand.load(path)


def test_a_gripper_meets_an_object_from_both_sides(tmp_path):
    """Each pad reads what it would read alone, also where the object is not in the middle."""
    solid, options = meshes.ball(), SpaceOptions()
    press = HandPress([solid], hand(tmp_path), options)
    start = np.array([-12.0, 3, 2, 1, 0, 0, 0])
    found = press.touch("ball", start)
    assert found.met.all()
    assert found.true[:, 0] == pytest.approx([-14.05, 14.05], abs=0.3)
    pads = rigid.compose(start, np.array([pad.pose for pad in press.hand.pads]))
    alone = SpacePress([solid], options).touch("ball", pads)
    assert found.readings == pytest.approx(alone.readings)


def test_a_pad_that_misses_stops_before_one_that_rests(tmp_path):
    """Two pads on one line: the second looks the same way and starts behind the first, which the object stops."""
    text = """
    [[pads]]
    pose = [0, 0, -60, 1, 0, 0, 0]
    stroke = 80
    [[pads]]
    pose = [0, 12, -80, 1, 0, 0, 0]
    stroke = 200
    """
    # A thin rod along x below the first pad alone; the pads overlap by a little as seen along z.
    solid = meshes.mesh("rod", meshes.Manifold.cube((60, 1, 10), True).translate((0, -4, 0)))
    overlapping = hand(tmp_path, text.replace("12", "11"))
    found = HandPress([solid], overlapping, SpaceOptions()).touch("rod", HERE)
    assert found.met.tolist() == [True, False]
    # The second is stopped by the back of the first, a layer's thickness behind its face.
    assert found.true[1, 2] == pytest.approx(found.true[0, 2] - 3, abs=0.8)
    beside = HandPress([solid], hand(tmp_path, text), SpaceOptions()).touch("rod", HERE)
    assert beside.travel[1] == 200


def test_an_error_of_the_hand_moves_all_its_pads(tmp_path):
    press = HandPress([meshes.ball()], hand(tmp_path), SpaceOptions(placement_mm=1.0, placement_rad=0.0))
    found = press.touch("ball", HERE, np.random.default_rng(3))
    off = found.true[:, :3] - found.stated[:, :3]
    assert off[0] == pytest.approx(off[1])
    assert np.abs(off[0]).min() > 1e-3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("-50, 0, 0", "52, 0, 0"), "pads 1 and 2 overlap where their strokes begin; move them apart"),
        (("0.7071067811865476, 0, -0.7", "0.8, 0, -0.7"), "a rotation's has length 1"),
        (('name = "gripper"', 'name = "gripper"\nbody = "sphere"'), "a pad on a sphere needs its radius, mm"),
        (('name = "gripper"', "nam = 1"), "nam"),
    ],
)
def test_a_hand_that_is_none_is_refused_in_a_line(tmp_path, change, said):
    with pytest.raises(InputError) as caught:
        HandPress([meshes.ball()], hand(tmp_path, GRIPPER.replace(*change)), SpaceOptions())
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_curved_pads_feel_as_curved(tmp_path):
    curved = hand(tmp_path, GRIPPER.replace("[[pads]]", 'body = "sphere"\nradius = 15\n[[pads]]', 1))
    press = HandPress([meshes.box(20, 40, 40)], curved, SpaceOptions())
    assert press.options.radius == 15
    found = press.touch("box", HERE)
    image = found.readings[0].reshape(6, 6)
    assert image[2:4, 2:4].min() > 4 * image[[0, -1]].max()


def test_the_hand_of_the_page_closes_on_what_lies_in_its_middle(tmp_path):
    page = Path(tactsim.__file__).parents[1] / "docs" / "objects-in-space.md"
    described = hand(tmp_path, re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)[0])
    poses = np.array([pad.pose for pad in described.pads])
    looks = rigid.turned(poses[:, 3:], np.array([0.0, 0, 1]))
    assert looks == pytest.approx(
        -poses[:, :3] / np.linalg.norm(poses[:, :3], axis=1, keepdims=True), abs=1e-3
    )
    press = HandPress([models.solid("egg")], described, SpaceOptions())
    assert press.touch("egg", HERE).met.all()
