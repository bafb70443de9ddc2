"""Fisher information of a reading on where the object lies: of its pressures, and of its three classes (eq. 3).

The pose is described by a small move of the object in its own frame, (x mm, y mm, turn rad) about its origin. In these
terms the information depends on the press alone, not on where the object lies, and the mean square displacement of the
object's points is x^2 + y^2 + (I/m) turn^2.
"""

from __future__ import annotations

import numpy as np

from tactsim.bench.bound.response import Response, noise_variance
from tactsim.core.poses import FloatArray
from tactsim.press.scan_options import SensorOptions

THRESHOLD, RATIO = 2.0, 0.3  # T, kPa, and the share of the largest taxel in eq. 3
DRAWS = 32  # of what is unknown of a press; 256 change the bound by 0.1 %
_LEAST = 1e-12  # probability of a class


def object_slopes(by_pose: FloatArray, poses: FloatArray) -> FloatArray:
    """Turn slopes by sensor_in_object (n, taxels, 3) into slopes by a small move of the object's frame.

    A move m of the frame makes sensor_in_object exp(m) sensor_in_object: x + m_x - m_t y, y + m_y + m_t x, theta + m_t.
    """
    move = np.tile(np.eye(3), (len(poses), 1, 1))
    move[:, 0, 2], move[:, 1, 2] = -poses[:, 1], poses[:, 0]
    return by_pose @ move


def of_pressures(response: Response, poses: FloatArray, sensor: SensorOptions) -> FloatArray:
    """Compute the information of n pressure images, (n, 3, 3).

    Noise is Gaussian, and what is unknown of a press counts linearly. So this is H' S^-1 H (Kay 1993, section 3.9), S
    being the noise on the diagonal plus an outer product for each unknown. Its own change with the pose is left out.
    """
    slopes = np.concatenate([object_slopes(response.by_pose, poses), response.unknown], axis=2)
    return _without_unknowns(slopes.swapaxes(1, 2) @ slopes / noise_variance(sensor))


def of_classes(
    response: Response,
    poses: FloatArray,
    sensor: SensorOptions,
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> FloatArray:
    """Compute the information of the classes of n readings, (n, 3, 3).

    Given the press and the largest taxel, taxels are independent, and the probability of each class is that of a
    Gaussian between two limits. Its information on the pose and on what is unknown of the press is averaged over
    `draws` draws of the unknowns and of the noise of the largest taxel, common to all poses. Of that, what is left for
    the pose is the hybrid bound of Rockah and Schultheiss (IEEE Trans. ASSP 35(3), 1987): it is a bound, and for
    pressures the same as `of_pressures`.
    """
    noise = np.sqrt(noise_variance(sensor))
    slopes = object_slopes(response.by_pose, poses)
    unknown = rng.standard_normal((draws, response.unknown.shape[2]))
    error = noise * rng.standard_normal((draws, slopes.shape[1]))
    # A reading is rounded before it is compared: above T means at least the step after it.
    step = sensor.resolution
    threshold = (np.floor(THRESHOLD / step) + 0.5) * step if step else THRESHOLD
    result = np.zeros((len(poses), 3, 3))
    touching = np.flatnonzero(slopes.any(axis=(1, 2)))
    # The last unknown is the noise of the largest taxel, which moves the limits of all taxels and no taxel's mean.
    both = np.concatenate([slopes, response.unknown, np.zeros_like(slopes[..., :1])], axis=2)
    for row in touching.tolist():
        mean = response.mean[row] + unknown @ response.unknown[row].T
        information = _given_press(mean, both[row], error, noise, threshold)
        result[row] = _without_unknowns(information[None])[0]
    return result


def _without_unknowns(information: FloatArray) -> FloatArray:
    """Reduce information (n, 3 + k, 3 + k) to that on the pose; each of the k unknowns is normal with variance 1."""
    pose, shared, unknown = information[:, :3, :3], information[:, 3:, :3], information[:, 3:, 3:]
    unknown = unknown + np.eye(unknown.shape[1])
    return pose - shared.swapaxes(1, 2) @ np.linalg.solve(unknown, shared)


def _given_press(
    mean: FloatArray, slopes: FloatArray, error: FloatArray, noise: float, threshold: float
) -> FloatArray:
    """Average the information (m, m) of the classes over draws of the press.

    mean: (draws, taxels) kPa. slopes: (taxels, m) kPa, the last by the largest taxel's noise. error: (draws, taxels)
    kPa, of the taxels among which the largest is found.
    """
    from scipy.special import ndtr  # imported here: information from the cache does without

    rows, largest = np.arange(len(mean)), (mean + error).argmax(axis=1)
    share = RATIO * (mean + error)[rows, largest]
    with_share = share > threshold
    limits = np.stack([np.maximum(share, threshold), np.minimum(share, threshold)])
    at = (limits[..., None] - mean) / noise  # (2, draws, taxels): the higher limit, the lower
    contact, none = ndtr(-at[0]), ndtr(at[1])
    unknown = np.clip(1 - contact - none, 0, None)
    density = np.exp(-(at**2) / 2) / (np.sqrt(2 * np.pi) * noise)
    # How the higher and the lower limit move with the pose, relative to the taxel's mean: (2, draws, taxels, m).
    moved = RATIO * slopes[largest][:, None]
    moved[..., -1] = RATIO * noise
    moves = np.stack(
        [np.where(with_share[:, None, None], moved, 0), np.where(with_share[:, None, None], 0, moved)]
    )
    moves = (moves - slopes) * density[..., None]
    total = np.zeros((slopes.shape[1], slopes.shape[1]))
    for probability, change in ((contact, -moves[0]), (none, moves[1]), (unknown, moves[0] - moves[1])):
        weighted = change / np.maximum(probability, _LEAST)[..., None]
        total += np.tensordot(weighted, change, axes=([0, 1], [0, 1]))
    return total / len(mean)
