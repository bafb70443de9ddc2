"""The example package for ROS 2: messages with the fields of sensor_msgs/Image become readings."""

import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tactsim
from tactsim.core import Pad, poses, rigid
from tactsim.core.source import SourceError
from tactsim.estimators import Estimate
from tactsim.estimators.estimator import PoseSamples
from tactsim.hardware.device import Device

EXAMPLE = Path(tactsim.__file__).parents[1] / "examples" / "ros2"
sys.path.insert(0, str(EXAMPLE))
from tactsim_ros2 import open_source, pose_with_covariance, reading_of  # noqa: E402

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


@pytest.mark.parametrize("flat", [True, False])
def test_a_pose_has_the_mean_and_the_covariance_of_the_object_in_the_robots_frame(flat):
    rng, group = np.random.default_rng(2), poses if flat else rigid
    lies = (
        np.array([120.0, -40.0, 2.0])
        if flat
        else np.concatenate([[120.0, -40, 9], rigid.random_rotations(1, rng)[0]])
    )
    spread = [2.0, 0.5, 0.02] if flat else [2.0, 0.5, 1.0, 0.02, 0.01, 0.03]
    # The object is moved along its own axes: samples of where it lies.
    placed = group.compose(lies, group.exp(rng.normal(size=(5000, len(spread))) * spread))
    estimate = Estimate("A", {"A": 1.0}, group.invert(lies), PoseSamples(group.invert(placed), np.ones(5000)))
    fields = pose_with_covariance(estimate)
    found = np.array(fields["covariance"]).reshape(6, 6)
    expected = np.cov(placed[:, :2].T) * 1e-6 if flat else np.cov(placed[:, :3].T) * 1e-6
    size = len(expected)
    assert found[:size, :size] == pytest.approx(expected, abs=0.03 * expected.max())
    turn = placed[:, 2] - lies[2] if flat else rigid.to_vector(
        rigid.multiply(placed[:, 3:], rigid.conjugate(lies[3:]))
    )  # fmt: skip
    last = slice(5, 6) if flat else slice(3, 6)
    assert found[last, last] == pytest.approx(np.atleast_2d(np.cov(turn.T)), abs=2e-5)
    assert list(fields["pose"]["position"].values())[:2] == pytest.approx([0.12, -0.04], abs=1e-4)
    if flat:
        assert found[2:5].any() == found[:, 2:5].any() == False  # noqa: E712
        half = fields["pose"]["orientation"]
        assert 2 * np.arctan2(half["z"], half["w"]) == pytest.approx(2.0, abs=0.01)
    with pytest.raises(ValueError, match="no covariance"):
        pose_with_covariance(Estimate("A", {"A": 1.0}, lies))
