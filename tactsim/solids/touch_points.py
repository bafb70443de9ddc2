"""What readings say in points: where a surface was met, where nothing was, and along which way the pad came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.solids.screen_kernels import TouchPoints

_PRESSED, _FREE = 0.35, 0.08  # shares of the reading's largest pressure: from there on, and below
_POINTS, _PLACES = 6, 8  # taxels of either kind that are looked at: enough to tell where a pad can lie
_LOUD = 10.0  # by how much more than noise the sum of a reading must be for a contact
_SAYS = 3.0  # places that a touch is worth at most: how far it is, and how it is tilted
_BEHIND = 0.7  # mm behind the deepest contact, from where on back the pad's way was free


@dataclass(frozen=True, eq=False)
class PointReader:
    """Turns readings into points.

    taxel_points: (taxels, 3) mm. stiffness: kPa/mm. noise: kPa, a taxel's standard deviation.
    """

    taxel_points: FloatArray
    stiffness: float
    noise: float

    def met(self, readings: FloatArray) -> np.ndarray:
        """Tell which readings (m, taxels) show a contact: (m,)."""
        return np.asarray(readings.sum(axis=1) > _LOUD * self.noise * np.sqrt(readings.shape[1]))

    def read(self, readings: FloatArray, sensors_in_robot: FloatArray) -> TouchPoints:
        """Give the points of readings (m, taxels) kPa at poses (m, 7)."""
        count = len(readings)
        point, free = np.zeros((count, _POINTS, 4)), np.zeros((count, _PLACES, 3))
        points, frees = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        begin = np.zeros(count)
        for m in np.flatnonzero(self.met(readings)):
            most = readings[m].max()
            pressed = np.flatnonzero(readings[m] > _PRESSED * most)
            pressed = _some(pressed[np.argsort(-readings[m, pressed], kind="stable")], _POINTS)
            points[m] = len(pressed)
            point[m, : len(pressed), :3] = self.surface(readings[m], pressed)
            point[m, : len(pressed), 3] = _SAYS * readings[m, pressed] / readings[m, pressed].sum()
            empty = _some(np.flatnonzero(readings[m] < _FREE * most), _PLACES)
            frees[m] = len(empty)
            free[m, : len(empty)] = self.taxel_points[empty]
            begin[m] = most / self.stiffness + _BEHIND
        return TouchPoints(sensors_in_robot, point, points, free, frees, begin)

    def surface(self, reading: FloatArray, pressed: np.ndarray) -> FloatArray:
        """Give the places (n, 3) mm, in the sensor's frame, that pressed taxels say lie on a surface."""
        places = self.taxel_points[pressed].copy()
        places[:, 2] -= reading[pressed] / self.stiffness
        return places

    def anchor(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        """Give the place (3,) mm in the robot's frame that is touched the hardest: it lies on a surface."""
        strongest = np.array([int(reading.argmax())])
        return np.asarray(rigid.transform(sensor_in_robot, self.surface(reading, strongest))[0], dtype=float)


def _some(which: np.ndarray, count: int) -> np.ndarray:
    """Take `count` of `which` evenly, or all if there are fewer."""
    return which if len(which) <= count else which[np.arange(count) * len(which) // count]


def joined(first: TouchPoints, second: TouchPoints) -> TouchPoints:
    """Put the points of one touch after another."""
    return TouchPoints(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def since(touches: TouchPoints, first: int) -> TouchPoints:
    """Give the touches from number `first` on."""
    return TouchPoints(*(part[first:] for part in touches))  # type: ignore[arg-type]
