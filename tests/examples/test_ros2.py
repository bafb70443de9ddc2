"""The example package for ROS 2: messages with the fields of sensor_msgs/Image become readings."""

import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tactsim
from tactsim.core import Pad
from tactsim.core.source import SourceError
from tactsim.hardware.device import Device

EXAMPLE = Path(tactsim.__file__).parents[1] / "examples" / "ros2"
sys.path.insert(0, str(EXAMPLE))
from tactsim_ros2 import open_source, reading_of  # noqa: E402

PAD = Pad(rows=2, columns=3, seam=None)
KPA = np.array([[1.5, 2.5, 3.5], [4.5, 5.5, -0.25]])  # as an image: the top row first


def image(values=KPA, big=False, padding=0, **changes):
    """Make a message: the fields that the generated class has."""
    rows = values.astype(">f4" if big else "<f4")
    fields = {
        "header": SimpleNamespace(stamp=SimpleNamespace(sec=100, nanosec=250_000_000), frame_id="pad"),
        "height": values.shape[0], "width": values.shape[1], "encoding": "32FC1", "is_bigendian": int(big),
        "step": 4 * values.shape[1] + padding,
        "data": np.pad(rows.view(np.uint8), ((0, 0), (0, padding))).ravel(),
    }  # fmt: skip
    return SimpleNamespace(**(fields | changes))


@pytest.mark.parametrize(("big", "padding"), [(False, 0), (True, 4)])
def test_an_image_is_a_reading_from_the_bottom_row_up(big, padding):
    reading = reading_of(image(big=big, padding=padding), PAD, now=7.0, index=3)
    assert reading.pressures.tolist() == [4.5, 5.5, -0.25, 1.5, 2.5, 3.5]
    assert (reading.host_time, reading.device_time, reading.index) == (7.0, 100.25, 3)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"encoding": "mono8"}, "publish pressures in kPa as '32FC1'"),
        ({"values": KPA[:, :2]}, "have 2x2 taxels, the device file 2x3"),
        ({"step": 8}, "has 24 bytes, 8 a row"),
    ],
)
def test_an_image_that_is_none_of_the_pad_is_named_in_one_line(changes, says):
    with pytest.raises(SourceError, match=says):
        reading_of(image(**changes), PAD, 0.0, 1)


def test_the_package_names_its_source_and_says_that_it_needs_ros():
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())
    assert project["project"]["entry-points"]["tactsim.sources"] == {"ros2": "tactsim_ros2:open_source"}
    device = Device(name="mine", pad=PAD)
    with pytest.raises(SourceError, match="one pad is one topic"):
        open_source(["/a", "/b"], device, None)
    with pytest.raises(SourceError, match="needs ROS 2"):
        open_source(["/tactile"], device, None)
