"""The touches that a trial offers: test readings that were recorded, or what is pressed on demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tactsim.core import Scan, compose, invert
from tactsim.core.poses import FloatArray


class Touches(Protocol):
    """The touches that a trial offers, numbered from 0."""

    def __len__(self) -> int: ...

    def sensor_in_robot(self, robot_in_object: FloatArray) -> FloatArray:
        """Give their poses (n, 3), the object being where it is."""

    def reading(self, index: int, robot_in_object: FloatArray) -> FloatArray | None:
        """Take one: (taxels,) kPa, or its images (frames, taxels), or None if it gives no reading."""


class Press(Protocol):
    """What presses an object on demand; see `touching.OnDemand`."""

    def touches(self, truth: str, trial: int, seed: int) -> Touches:
        """Offer the touches of one trial."""


@dataclass(frozen=True, eq=False)
class RecordedTouches:
    """The test readings of a scan, around the object; with `sequences` the images of each, (frames, taxels)."""

    test: Scan
    sequences: bool = False

    def __len__(self) -> int:
        return len(self.test)

    def sensor_in_robot(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses (n, 3) at which the readings were taken, moved with the object."""
        return compose(invert(robot_in_object), self.test.poses)

    def reading(self, index: int, robot_in_object: FloatArray) -> FloatArray | None:
        """Give the reading of this index, wherever the object is."""
        if self.sequences:
            assert self.test.sequence is not None
            return self.test.sequence[index].astype(float)
        return self.test.readings[index]
