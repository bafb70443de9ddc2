"""What the filters in space share: options, what they learn, checks of what is given, and proposals."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import checked_poses
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators.estimator import Estimate, Estimator, PoseSamples, check_order, name_of
from tactsim.estimators.filters.states import Weights
from tactsim.estimators.space.se3_states import mean_around
from tactsim.estimators.space.space_field import SpaceField, SpaceMapOptions
from tactsim.estimators.space.space_information import STATES, information
from tactsim.estimators.space.touch_points import PointReader

_LEAST = 1e-9  # the share of the belief that an object keeps


class SpaceFilterOptions(SpaceMapOptions):
    """What every filter in space takes."""

    reach: float = Field(
        20.0,
        gt=0,
        le=1000,
        description="the object's origin is within this of the robot's along each axis, mm",
    )


class SpaceFilter(Estimator):
    """A filter over (object, object_in_robot), a pose in SE(3).

    Before the first touch all objects are as probable, the origin is even over a box about the robot's, the rotation
    even over all. Objects whose maps are equal are one hypothesis and share its probability.
    """

    in_space = True
    options_type = SpaceFilterOptions
    options: SpaceFilterOptions

    def __init__(self, options: SpaceFilterOptions) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self._started = False

    def fit(self, scan: SpaceScan) -> None:  # type: ignore[override]
        """Learn surfaces from the scan's training touches; its test touches are not looked at.

        Raises InputError if the scan is none of objects in space, or has no training touches.
        """
        if not isinstance(scan, SpaceScan):
            raise InputError(
                f"estimator {name_of(self)} works in space; give it a scan of objects "
                "in space, as `bench scan --task solids` makes"
            )
        self.fit_field(SpaceField.learn(scan, self.options), scan.taxel_points)

    def fit_field(self, field: SpaceField, taxel_points: FloatArray) -> None:
        """Take what was learned: a field over objects and poses, and the taxels (taxels, 3) mm."""
        self.field, self.labels = field, tuple(field.labels)
        self.taxel_points = np.asarray(taxel_points, dtype=float)
        feel = field.touching
        self.reader = PointReader(self.taxel_points, feel.stiffness, float(np.median(feel.noise)))
        self._alike = alike(field)
        self._started = False
        self._fitted()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        check_order(bool(self.labels), "fit", "reset")
        self.field.reset()
        self._planning = rng.spawn(1)[0]
        self._started = True
        self._reset(rng)

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in a touch: a reading (taxels,) kPa at a pose (7,), or one of several pads, (m, taxels) at (m, 7).

        Readings of several pads are independent given the object and its pose. Raises InputError, and leaves the belief
        as it was, for a wrong shape, a number that is not finite, or a rotation that is none.
        """
        check_order(bool(self.labels), "fit", "update")
        check_order(self._started, "reset", "update")
        readings, sensors = check_touch(reading, sensor_in_robot, len(self.taxel_points))
        self.field.append(readings, sensors)
        self._update(readings, sensors)

    def estimate(self) -> Estimate:
        """Say which object it is and where: the mean about the best pose of the most probable object."""
        check_order(bool(self.labels), "fit", "estimate")
        check_order(self._started, "reset", "estimate")
        label, poses, weights = self.belief()
        mass = np.bincount(label, weights.relative, minlength=len(self.labels))
        # An object that no state is left of is improbable, not impossible.
        mass = np.maximum(mass, _LEAST * mass.sum())[self._alike]
        chance = mass / mass.sum()
        best = int(chance.argmax())
        mine = np.flatnonzero(label == self._alike[best])
        poses, held = poses[mine], Weights(weights.log[mine])
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, chance.tolist(), strict=True)),
            robot_in_object=rigid.invert(mean_around(poses, held.normalised)),
            samples=PoseSamples(rigid.invert(poses), held.normalised),
        )

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the start (k, 7), sensor_in_robot, whose touch should say most about the state."""
        check_order(bool(self.labels), "fit", "propose")
        check_order(self._started, "reset", "propose")
        starts = checked_poses(candidates, "candidates")
        if starts.ndim != 2 or not len(starts):
            raise InputError(
                f"candidates have shape {starts.shape}; they are one or more [x, y, z, qw, qx, qy, qz]"
            )
        # Proposals have a random stream of their own: the estimates are the same whether they are asked for or not.
        label, poses, weights = self.belief()
        chosen = weights.systematic(STATES, self._planning)
        return int(information(self.field, label[chosen], poses[chosen], starts).argmax())

    @abstractmethod
    def belief(self) -> tuple[NDArray[np.int64], FloatArray, Weights]:
        """Give the states that stand for the belief: objects (n,), object_in_robot (n, 7) and n weights."""

    @abstractmethod
    def _fitted(self) -> None:
        """Prepare what does not depend on a sequence."""

    @abstractmethod
    def _reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence; draw from `rng` until the next reset."""

    @abstractmethod
    def _update(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Take in readings (m, taxels) kPa at poses (m, 7), which the field has got already."""


def alike(field: SpaceField) -> NDArray[np.int64]:
    """Give for each object the first one whose map is the same, to the bit: (labels,)."""
    first: dict[bytes, int] = {}
    charts = [b"".join(np.asarray(part).tobytes() for part in field.maps[label]) for label in field.labels]
    return np.array([first.setdefault(chart, number) for number, chart in enumerate(charts)])


def check_touch(reading: ArrayLike, sensor_in_robot: ArrayLike, taxels: int) -> tuple[FloatArray, FloatArray]:
    """Return readings (m, taxels) kPa and poses (m, 7) of a touch by one pad or by m.

    Raises InputError if a shape is wrong, a number is not finite or a rotation is none.
    """
    readings, sensors = np.array(reading, dtype=float), np.array(sensor_in_robot, dtype=float)
    if readings.ndim not in (1, 2) or not readings.size or readings.shape[-1] != taxels:
        raise InputError(f"a reading has shape {readings.shape}; the maps were learned from {taxels} taxels")
    if sensors.shape != (*readings.shape[:-1], 7):
        raise InputError(
            f"sensor_in_robot has shape {sensors.shape}; readings of shape {readings.shape} need one pose "
            "[x, y, z, qw, qx, qy, qz] each"
        )
    readings = finite(readings, "reading")
    sensors = checked_poses(sensors, "sensor_in_robot")
    return readings.reshape(-1, taxels), sensors.reshape(-1, 7)
