"""A ROS 2 topic of tactile images as a source of readings, ros2:/topic, and an estimate as a pose with covariance.

The messages are sensor_msgs/msg/Image with the encoding 32FC1: a number for each taxel, kPa, the top row first. What
publishes other messages needs another `reading_of`.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from tactsim.core import poses, rigid
from tactsim.core.counters import Counters
from tactsim.core.pad import Pad
from tactsim.core.reading import Reading
from tactsim.core.source import HasPad, Log, NoReading, Source, SourceError
from tactsim.estimators import Estimate

_PATIENCE = 5.0  # s for a reading if the caller says nothing
_WAITING = 1000  # readings that wait for a slow reader; what comes then is dropped


def reading_of(message: Any, pad: Pad, now: float, index: int) -> Reading:
    """Make a reading of a sensor_msgs/msg/Image that came at `now`, s. Raises SourceError if it is none of the pad."""
    shape = message.height, message.width
    if message.encoding != "32FC1":
        raise SourceError(f"the images are {message.encoding!r}; publish pressures in kPa as '32FC1'")
    if shape != (pad.rows, pad.columns):
        raise SourceError(
            f"the images have {shape[0]}x{shape[1]} taxels, the device file {pad.rows}x{pad.columns}"
        )
    kind = np.dtype(">f4" if message.is_bigendian else "<f4")
    lines = np.frombuffer(bytes(message.data), np.uint8)
    if message.step < kind.itemsize * message.width or len(lines) != message.step * message.height:
        raise SourceError(
            f"an image of {shape[0]}x{shape[1]} taxels has {len(lines)} bytes, {message.step} a row"
        )
    rows = np.ascontiguousarray(
        lines.reshape(message.height, message.step)[:, : kind.itemsize * message.width]
    )
    stamp = message.header.stamp
    # The image begins at the top, the pad at the bottom
    return Reading(rows.view(kind)[::-1].astype(float).ravel(), now, stamp.sec + 1e-9 * stamp.nanosec, index)


class Ros2Source(Source):
    """The images of one topic. A thread of its own listens, so that each reading has the time at which it came."""

    def __init__(self, topic: str, device: HasPad) -> None:
        """Subscribe. Raises SourceError where there is no ROS 2."""
        try:
            import rclpy
            from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
            from rclpy.qos import qos_profile_sensor_data
            from sensor_msgs.msg import Image
        except ImportError as error:
            raise SourceError(
                f"ros2:{topic} needs ROS 2 ({error}); source its setup.bash, and use its Python"
            ) from None
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()
        self._topic, self._closed, self._lost = topic, False, False
        self._arrived: queue.Queue[Reading | SourceError] = queue.Queue(_WAITING)
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("tactsim", context=self._context)
        self._node.create_subscription(Image, topic, self._take, qos_profile_sensor_data)
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)

        def spin() -> None:
            with suppress(ExternalShutdownException):
                executor.spin()

        self._thread = threading.Thread(target=spin, daemon=True)
        self._thread.start()

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`."""
        if self._closed:
            raise SourceError(f"{self._topic} was closed")
        patience = _PATIENCE if timeout is None else timeout
        try:
            arrived = self._arrived.get(timeout=patience)
        except queue.Empty:
            raise NoReading(
                f"no image on {self._topic} in {patience:g} s; does `ros2 topic hz` see one?"
            ) from None
        if isinstance(arrived, SourceError):
            raise arrived
        self.counters.readings += 1
        return arrived

    def close(self) -> None:
        """Unsubscribe."""
        if not self._closed:
            self._closed = True
            self._context.try_shutdown()
            self._thread.join()
            self._node.destroy_node()

    def _take(self, message: Any) -> None:
        self.counters.frames += 1
        arrived: Reading | SourceError
        try:
            arrived = reading_of(message, self.pad, time.monotonic(), self.counters.frames)
        except SourceError as error:
            arrived = error
        if isinstance(arrived, Reading) and self._lost:
            arrived = replace(arrived, after_loss=True)
        try:
            self._arrived.put_nowait(arrived)
            self._lost = False
        except queue.Full:
            self.counters.missed += 1
            self._lost = True


def pose_with_covariance(estimate: Estimate) -> dict[str, Any]:
    """Give the fields of a geometry_msgs/msg/PoseWithCovariance, m and rad: the object in the robot's frame.

    `rosidl_runtime_py.set_message_fields(message, fields)` fills the message. Position and turn are along the axes of
    the robot's frame, as ROS has it (REP 103); what a flat object cannot do has no covariance. Raises ValueError if the
    estimate does not say how sure it is.
    """
    mean, covariance = estimate.mean, estimate.covariance
    if mean is None or covariance is None:
        raise ValueError("the estimate has no samples, and so no covariance")
    flat = len(mean) == 3
    if flat:
        x, y, theta = poses.invert(mean)
        pose = np.array([x, y, 0.0, np.cos(theta / 2), 0.0, 0.0, np.sin(theta / 2)])
    else:
        pose = rigid.invert(mean)
    moved = np.zeros((6, 6))
    which = [0, 1, 5] if flat else list(range(6))
    moved[np.ix_(which, which)] = covariance
    turn = rigid.matrix(pose[3:])  # deviations are along the object's axes
    along = np.kron(np.eye(2), turn) * np.repeat([1e-3, 1.0], 3)[:, None]
    (x, y, z), (w, i, j, k) = (1e-3 * pose[:3]).tolist(), pose[3:].tolist()
    return {
        "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}},
        "covariance": (along @ moved @ along.T).ravel().tolist(),
    }


def open_source(places: Sequence[str], device: HasPad, log: Log | None) -> Source:
    """Read a ROS 2 topic of tactile images: ros2:/topic."""
    if len(places) != 1 or not places[0]:
        raise SourceError(f"one pad is one topic, such as ros2:/tactile; got {' '.join(places) or 'none'}")
    return Ros2Source(places[0], device)
