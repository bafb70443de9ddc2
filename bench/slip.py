"""How the hidden object moves between touches: a random walk, one jump, a slow drift.

The readings stay those of the scan: the pad is pressed on the object as before. What moves is the object in the
robot's frame, T_O^R, and with it the sensor's pose that goes with a reading.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tactsim.core import invert
from tactsim.core.poses import FloatArray


class Slip(BaseModel):
    """How far the object moves between two touches, about its own origin; by default it lies still."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    walk_mm: float = Field(
        0.0, ge=0, le=100, description="mm, standard deviation of a random step in x and in y"
    )
    walk_rad: float = Field(0.0, ge=0, le=3.2, description="rad, standard deviation of a random turn")
    jump_mm: float = Field(
        0.0, ge=0, le=1000, description="mm, one jump in a random direction before a random touch"
    )
    jump_rad: float = Field(
        0.0, ge=0, le=3.2, description="rad, by which the jump turns the object either way"
    )
    drift_mm: float = Field(
        0.0, ge=0, le=100, description="mm at each touch, in a direction that is random but stays"
    )
    drift_rad: float = Field(0.0, ge=0, le=3.2, description="rad at each touch, either way")

    @property
    def still(self) -> bool:
        """Tell whether the object does not move at all."""
        return not any(self.model_dump().values())

    @property
    def is_walk(self) -> bool:
        """Tell whether the object lies still or walks at random, and no more."""
        return not (self.jump_mm or self.jump_rad or self.drift_mm or self.drift_rad)

    def describe(self) -> str:
        """Say in a few words how the object moves."""
        parts = []
        for name in ("walk", "jump", "drift"):
            mm, rad = getattr(self, f"{name}_mm"), getattr(self, f"{name}_rad")
            sizes = [f"{size:g} {unit}" for size, unit in ((mm, "mm"), (rad, "rad")) if size]
            if sizes:
                parts.append(f"{name} {' '.join(sizes)}")
        return ", ".join(parts)

    def poses(self, first: FloatArray, readings: int, rng: np.random.Generator) -> FloatArray:
        """Draw robot_in_object at each of `readings` touches (readings, 3), from the first (3,) on.

        The object's place and angle in the robot's frame get independent steps, so a turn is about the object's
        origin. As many random numbers are drawn whatever moves: worlds with one seed differ in size alone.
        """
        steps = rng.standard_normal((readings, 3)) * [self.walk_mm, self.walk_mm, self.walk_rad]
        steps[0] = 0
        drift, jump = rng.uniform(-np.pi, np.pi, 2)
        turns = rng.choice([-1.0, 1.0], 2)
        steps[1:] += [self.drift_mm * np.cos(drift), self.drift_mm * np.sin(drift), self.drift_rad * turns[0]]
        touch = rng.integers(1, max(readings, 2))
        if readings > 1:
            steps[touch] += [
                self.jump_mm * np.cos(jump),
                self.jump_mm * np.sin(jump),
                self.jump_rad * turns[1],
            ]
        return invert(invert(first) + steps.cumsum(axis=0))


STILL = Slip()
# Worlds in which the object moves. Its readings are those of the default world.
SLIPS: dict[str, dict[str, Any]] = {"slip": {"slip": {"walk_mm": 0.5, "walk_rad": 0.03}}}
