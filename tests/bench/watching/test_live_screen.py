"""What `bench live` shows on a terminal: what is waited for, and objects whose shape nobody knows."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactsim.bench.watching.live_screen import asks, scene
from tactsim.bench.watching.pad_view import PadReader
from tactsim.bench.watching.recogniser import Belief, Touch
from tactsim.bench.watching.touch_leader import LiveView
from tactsim.estimators import Estimate


@pytest.fixture
def told(device):
    image = np.arange(36.0)
    return SimpleNamespace(
        pad=device.pad,
        outlines={"A": []},
        image=lambda belief: image,
        in_object=lambda belief, sensor_in_robot: sensor_in_robot,
    )


def test_an_object_whose_shape_nobody_knows_is_not_drawn_but_its_touch_is(told):
    touch = Touch(np.arange(36.0), np.zeros(3), 0.0)
    belief = Belief((touch,), Estimate("A", {"A": 1.0}, np.zeros(3)), 0.0)
    drawn = scene(told, belief, np.array([8.0, 0.0, 0.0]), colours=True)
    assert "#" not in drawn.plain
    assert "o" in drawn.plain
    assert any("on rgb" in str(span.style) for span in drawn.spans)


def test_nobody_is_asked_to_hold_a_pad_that_is_lost(source, device, eventually, silence):
    now = LiveView(phase="hold it: reading", progress=0.4)
    with PadReader(source, device, "here") as reader:
        source.feed(np.arange(36.0))
        eventually(lambda: reader.view().state == "live")
        live = asks(reader.view(), now)
        silence(0.3)
        eventually(lambda: reader.view().state == "lost")
        lost = asks(reader.view(), now)
    assert live.plain.startswith("hold it: reading   40 %")
    assert lost.plain == "the pad is lost"
    assert "red" in str(lost.style)
