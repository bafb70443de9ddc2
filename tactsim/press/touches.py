"""`Touches`: where a letter is pressed, the question that every engine answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.models.letter import Letter


@dataclass(frozen=True, eq=False)
class Touches:
    """A letter and the ways in which it is pressed.

    poses: (n, 3) sensor_in_object [mm, mm, rad]. tilts: (n, 2) rad about the pad's x and y, between letter
    and pad before the wrist gives way; +tilt_x brings the side at +y closer, +tilt_y the side at -x.
    """

    letter: Letter
    poses: FloatArray
    tilts: FloatArray

    @classmethod
    def of(cls, letter: Letter, poses: FloatArray, tilt: tuple[float, float] = (0.0, 0.0)) -> Touches:
        """Press `letter` at `poses` with the same tilt (rad about x and y) every time."""
        return cls(letter, poses, np.tile(np.array(tilt, dtype=float), (len(poses), 1)))

    def some(self, which: slice) -> Touches:
        """Take some of the presses."""
        return Touches(self.letter, self.poses[which], self.tilts[which])

    def __len__(self) -> int:
        return len(self.poses)
