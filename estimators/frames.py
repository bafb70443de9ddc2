"""The frames that an estimator works in where those of its user have origins far from the object.

The object's frame: training poses in a robot's base frame lie hundreds of mm from its origin. Their centre, which is
known when an estimator is fitted, becomes the origin, or that of each object's own (`core.origins`).

The robot's frame: x and y of T_R^O are searched within a few mm of 0, which says that the robot's origin is near the
object. A first touch from which no such state would reach the object says that it is not. Where the object lies then is
not known, but for the touch itself: the pad is on the object. So the sensor at the first touch becomes the robot's
frame, place and angle. What is estimated is where the pad was on the object, which is the same wherever the base
stands and however it is turned.

Near origins stay as they are, to the bit. What is given back is in the user's frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tactsim.core import Scan, compose, invert
from tactsim.core.origins import object_origins, positions_from, seen_from
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PlaneBelief
from tactsim.estimators.likelihoods.occupancy import OccupancyMap

_DIGITS = 9  # decimals of mm and rad of a pose seen from a far touch: the others are rounding
# Test poses off the grid reach farther out than what is trained on: 12 mm beside 10.2.
_FARTHER = 1.2
# mm; a first touch may miss an object that is near by so much and say nothing.
_BESIDE = 100.0


@dataclass(frozen=True, eq=False)
class Frames:
    """The origins that an estimator works with, beside those of its user.

    object_origins: of each object (2,) mm, in the user's frame of it; none where all are 0. near: mm; a first touch
    that is farther from the user's origin moves that of the robot. first_touch: the pose (3,) of such a touch in the
    user's robot frame; None for a near one, and before the first.
    """

    object_origins: Mapping[str, FloatArray]
    near: float
    first_touch: FloatArray | None = None

    @classmethod
    def fitted(cls, scan: Scan, reach: float) -> Frames:
        """Find the object in a scan. reach: mm, within which x and y of T_R^O are searched.

        Origins that are within `reach` of the user's stay there: T_R^O may be as large.
        """
        origins = object_origins(scan)
        if all(np.abs(origin).max() <= reach for origin in origins.values()):
            origins = {}
        trained = seen_from(scan, origins).poses[scan.split == "train", :2]
        pad = float(np.hypot(*scan.taxel_xy.T).max())
        radius = float(np.hypot(*trained.T).max(initial=0.0))
        # From the robot's origin to the object's, to the outermost touch there, and half a pad for either touch.
        return cls(origins, max(_BESIDE, np.sqrt(2) * reach + _FARTHER * radius + 2 * pad))

    def scan(self, scan: Scan) -> Scan:
        """Bring a scan into the frame of the object."""
        return seen_from(scan, self.object_origins)

    def begun(self, first: FloatArray) -> Frames:
        """Give the frames of a sequence whose first touch is at the pose `first` (3,) in the user's robot frame."""
        return replace(self, first_touch=first.copy() if np.hypot(*first[:2]) > self.near else None)

    def poses(self, sensor_in_robot: FloatArray) -> FloatArray:
        """Bring poses (..., 3) of touches into the frame of the robot."""
        if self.first_touch is None:
            return sensor_in_robot
        turned = compose(
            [0.0, 0.0, -self.first_touch[2]], positions_from(sensor_in_robot, self.first_touch[:2])
        )
        return np.round(turned, _DIGITS)

    def estimate_back(self, known: Estimate) -> Estimate:
        """Bring the poses of an estimate back into the user's frames."""
        touch, origin = self.first_touch, self.object_origins.get(known.label)
        if touch is not None:
            known = known.moved(lambda robot_in_object: compose(robot_in_object, invert(touch)))
        if origin is not None and origin.any():
            known = known.moved(lambda robot_in_object: robot_in_object + [*origin, 0.0])
        return known

    def plane_back(self, belief: PlaneBelief) -> PlaneBelief:
        """Bring a belief over the plane back; with a far robot it shows where on the object the first touch was.

        Where each object has an origin of its own, its belief stays as seen from there.
        """
        origins = list(self.object_origins.values())
        if not origins or not np.array_equal(np.min(origins, axis=0), np.max(origins, axis=0)):
            return belief
        return replace(belief, x=belief.x + origins[0][0], y=belief.y + origins[0][1])

    def maps_back(
        self, maps: Mapping[str, OccupancyMap], object_of: Mapping[str, str]
    ) -> Mapping[str, OccupancyMap]:
        """Bring maps, mm, back into the user's frame. object_of: of each view."""
        if not self.object_origins:
            return maps
        return {
            label: replace(chart, origin=chart.origin + self.object_origins[object_of.get(label, label)])
            for label, chart in maps.items()
        }


def reach_on_object(scan: Scan) -> float:
    """Say within which distance, mm, of 0 a first touch lies on the object along x and y. scan: in its frame."""
    xy = scan.poses[scan.split == "train", :2]
    return _FARTHER * float(np.abs(xy).max(initial=0.0))
