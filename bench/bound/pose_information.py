"""Fisher information of a reading on where the object lies.

The pose is described by a small move of the object in its own frame, (x mm, y mm, turn rad) about its origin. In these
terms the information depends on the press alone, not on where the object lies, and the mean square displacement of the
object's points is x^2 + y^2 + (I/m) turn^2.
"""

from __future__ import annotations

import numpy as np

from tactsim.bench.bound.response import Response, noise_variance
from tactsim.core.poses import FloatArray
from tactsim.press.sensor import SensorOptions


def object_slopes(by_pose: FloatArray, poses: FloatArray) -> FloatArray:
    """Turn slopes by sensor_in_object (n, taxels, 3) into slopes by a small move of the object's frame.

    A move m of the frame makes sensor_in_object exp(m) sensor_in_object: x + m_x - m_t y, y + m_y + m_t x, theta + m_t.
    """
    move = np.tile(np.eye(3), (len(poses), 1, 1))
    move[:, 0, 2], move[:, 1, 2] = -poses[:, 1], poses[:, 0]
    return by_pose @ move


def pose_information(response: Response, poses: FloatArray, sensor: SensorOptions) -> FloatArray:
    """Compute the information of n readings, (n, 3, 3).

    Noise is Gaussian, and what is unknown of a press counts linearly. So this is H' S^-1 H (Kay 1993, section 3.9), S
    being the noise on the diagonal plus an outer product for each unknown. Its own change with the pose is left out.
    """
    slopes = np.concatenate([object_slopes(response.by_pose, poses), response.unknown], axis=2)
    every = slopes.swapaxes(1, 2) @ slopes / noise_variance(sensor)
    # Of pose and unknowns together, each of the k unknowns being normal with variance 1, what is left on the pose.
    pose, shared, unknown = every[:, :3, :3], every[:, 3:, :3], every[:, 3:, 3:]
    return pose - shared.swapaxes(1, 2) @ np.linalg.solve(unknown + np.eye(unknown.shape[1]), shared)
