"""The options of touches in space say what is wrong with them."""

import pytest
from pydantic import ValidationError

from tactsim.press.space.space_options import SpaceOptions


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"radius": 20.0}, "a flat pad has no radius: give body = cylinder or sphere"),
        ({"body": "sphere"}, "a pad on a sphere needs its radius, mm"),
        ({"spacing": 0.01}, "choose a larger spacing or fewer taxels"),
        ({"sensor": {"dead_taxels": [36]}}, "dead taxel 36 does not exist: the pad's taxels are 0 to 35"),
        ({"force": float("nan")}, "finite"),
    ],
)
def test_what_makes_no_touch_is_refused(given, said):
    with pytest.raises(ValidationError, match=said):
        SpaceOptions(**given)


def test_images_come_at_even_steps_of_the_force():
    assert SpaceOptions(frames=4, force=2.0).frame_forces.tolist() == [0.5, 1.0, 1.5, 2.0]
    assert SpaceOptions(force=3.0).frame_forces.tolist() == [3.0]
