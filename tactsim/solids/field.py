"""The log-likelihood of touches in space as a field over objects and their poses in SE(3)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Options
from tactsim.solids.climbing_kernels import climb
from tactsim.solids.feeling_kernels import add_log_p, foresee_touches
from tactsim.solids.learning import (
    Chart,
    Rays,
    Surface,
    Touches,
    corners_of,
    learn_surface,
    learn_touching,
    rays_over,
)
from tactsim.solids.pad_feel import Touching
from tactsim.solids.solid_scan import SpaceScan


class SpaceMapOptions(Options):
    """How surfaces in space are learned, and how finely touches are compared with them."""

    cell: float = Field(1.0, ge=0.2, le=5, description="side of a voxel, mm")
    rays: int = Field(1, ge=1, le=4, description="rays along each side of a taxel that look for the surface")
    spread: float = Field(1.0, ge=0, le=10, description="standard deviation of the pad's point spread, mm")


class SpaceField:
    """log p(touches | object, object_in_robot) for the touches of a sequence so far, given the object independent.

    labels: the objects. maps: the signed distances to each one's surface. rays: through the pad. touching: how the pad
    feels.
    """

    def __init__(self, charts: Mapping[str, Chart], rays: Rays, touching: Touching, load: float) -> None:
        """Take what was learned of objects, by label. load: N that a touch carries."""
        self.maps = {label: chart.voxels for label, chart in charts.items()}
        self.labels = tuple(charts)
        self.rays, self.touching, self._load = rays, touching, load
        self._corners = corners_of(touching)
        self._surfaces = [chart.surface for chart in charts.values()]
        self.reset()

    @classmethod
    def learn(cls, scan: SpaceScan, options: SpaceMapOptions) -> SpaceField:
        """Learn the surface of every object of a scan's training touches, and how far to trust it.

        Raises InputError if the scan has no training touches, or those of an object met nothing.
        """
        train = scan.where("train")
        if not len(train):
            raise InputError("the scan has no touches with split 'train' to learn maps from")
        stroke = float(scan.meta.get("stroke", 0.0))
        bounds = scan.meta.get("load_bounds")
        rays = rays_over(
            train.taxel_points, options.rays, options.spread, None if bounds is None else np.array(bounds)
        )
        dense = rays_over(train.taxel_points, 2, options.spread)
        touches = {}
        for label in train.objects:
            mine = train.labels == label
            touches[label] = Touches.at(train.readings[mine], train.poses[mine])
        touching, load = learn_touching(touches, train.taxel_points, rays, dense, options.cell, stroke)
        charts = {
            label: learn_surface(mine, dense, touching.stiffness, options.cell, stroke)
            for label, mine in touches.items()
        }
        return cls(charts, rays, touching, load)

    def reset(self) -> None:
        """Forget all touches."""
        self._readings = np.empty((0, len(self.touching.taxel)))
        self._sensors = np.empty((0, 7))

    @property
    def touches(self) -> int:
        """Count the readings so far; several pads that touch at once are as many."""
        return len(self._readings)

    def append(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Add touches: readings (m, taxels) kPa at poses (m, 7), in the robot's frame."""
        self._readings = np.concatenate([self._readings, readings])
        self._sensors = np.concatenate([self._sensors, sensors_in_robot])

    def log_p(
        self, label_index: int, object_in_robot: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(touch | object, pose) over touches first, ..., last - 1, by default all: (n,) nats.

        object_in_robot: (n, 7).
        """
        result = np.zeros(len(object_in_robot))
        last = self.touches if last is None else last
        add_log_p(
            self.maps[self.labels[label_index]], self.touching, self._corners, np.ascontiguousarray(object_in_robot),
            self._readings, self._sensors, first, last, result,
        )  # fmt: skip
        return result

    def climb(
        self, label_index: int, object_in_robot: FloatArray, steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move poses (n, 7) to where the touches agree better, in at most so many steps.

        Returns the poses, the information (n, 6, 6) there, see `climbing_kernels.climb`, and log p (n,).
        """
        moved, log_p = np.array(object_in_robot), np.empty(len(object_in_robot))
        information = np.empty((len(moved), 6, 6))
        climb(
            self.maps[self.labels[label_index]], self.touching, self._corners, moved, self._readings, self._sensors,
            steps, information, log_p,
        )  # fmt: skip
        return moved, information, log_p

    def surface(self, label_index: int) -> Surface:
        """Give points (p, 3) mm about evenly over an object's surface, their outward normals and their spacing mm."""
        return self._surfaces[label_index]

    def reach(self, label_index: int) -> float:
        """Give the radius mm about an object's origin that holds its surface."""
        return float(np.linalg.norm(self._surfaces[label_index].points, axis=1).max())

    def foresee(
        self, label_index: int, object_in_robot: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Foresee touches from `start` (n, 7) of objects at (n, 7): travel (n,) mm and readings (n, taxels) kPa.

        A touch that meets nothing travels the whole stroke and reads 0.
        """
        object_in_robot, start = np.broadcast_arrays(object_in_robot, start)
        travel, image = np.empty(len(start)), np.empty((len(start), len(self.touching.taxel)))
        foresee_touches(
            self.maps[self.labels[label_index]], self.touching, np.ascontiguousarray(object_in_robot),
            np.ascontiguousarray(start), self._load, self.rays.frame[2] ** 2, travel, image,
        )  # fmt: skip
        return travel, image


def surfaces_of(estimator: object) -> Mapping[str, Surface]:
    """Give the surfaces that an estimator has learned, by label; none if it has no field in space."""
    field = getattr(estimator, "field", None)
    if not isinstance(field, SpaceField):
        return {}
    return {label: field.surface(number) for number, label in enumerate(field.labels)}
