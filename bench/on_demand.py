"""Touches of a hidden object in the robot's frame, pressed on demand: what active touch chooses among.

The poses that are offered say nothing of the object: they are drawn before it is hidden, the same for every letter and
place. The test readings of a scan would not do. Their poses are laid out around the object, so their middle is its
middle, to 0.09 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactsim.bench.trials import ListedTouches
from tactsim.core import compose
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.models import Letter
from tactsim.press import ScanOptions
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import random_poses, stage_for
from tactsim.press.scanning import letters_of
from tactsim.press.sensor import gains, sense
from tactsim.press.touches import as_pressed


@dataclass(frozen=True)
class OnDemand:
    """Press the letters of a scan wherever a trial asks, with the errors and the noise of the scan's test presses."""

    options: ScanOptions

    def touches(self, truth: str, trial: int, seed: int) -> PressedTouches:
        """Offer the touches of one trial of `truth`, a letter of the scan."""
        names = tuple(name for name in self.options.letters if name == truth)  # the others need not be built
        (letter,) = (
            one for one in letters_of(self.options.model_copy(update={"letters": names})) if one.name == truth
        )
        return PressedTouches(letter, self.options, self._reach, trial, seed)

    @cached_property
    def _reach(self) -> float:
        """Give how far the touches that are offered reach, mm: one and the same for all letters."""
        return max(stage_for(self.options.pad, one).reach for one in letters_of(self.options))


class PressedTouches(ListedTouches):
    """The touches of one trial: as many poses as a scan has, x and y within `reach` mm of the robot's origin.

    They depend on the trial's number and the seed, and not on the letter. The error of a press depends on which touch
    it is, the noise on how many came before: no estimator that chooses its touches changes its own luck.
    """

    def __init__(self, letter: Letter, options: ScanOptions, reach: float, trial: int, seed: int) -> None:
        self._letter, self._options = letter, options
        self._purpose = f"trial {trial}"
        self._seed = seed
        self._offered = random_poses(stream(seed, "touches", self._purpose), reach=reach)
        super().__init__(len(self._offered))
        self._gain = gains(options)
        self._felt = np.zeros((len(self._offered), options.pad.taxels))
        self._count = 0

    def sensor_in_robot(self, robot_in_object: FloatArray) -> FloatArray:
        """Give the poses that are offered (n, 3); they do not depend on where the object is."""
        return self._offered

    def reading(self, index: int, robot_in_object: FloatArray) -> FloatArray | None:
        """Press at the pose of this index: (taxels,) kPa, or None if the press does not come to rest."""

        def draw(purpose: str) -> np.random.Generator:
            return stream(self._seed, self._letter.name, self._purpose, f"touch {index}", purpose)

        stated = compose(robot_in_object, self._offered[index])[None]
        pressed = press_at(as_pressed(self._letter, stated, "test", self._options, draw), self._options)
        if pressed.blanks:
            return None
        self._felt[self._count] = pressed.readings(self._options)[0]
        self._count += 1
        # All rows are sensed each time, those still to come as zeros: the n-th has the same noise whatever was felt,
        # and lag and drift know those before.
        noise = stream(self._seed, self._letter.name, self._purpose, "sense")
        rows = self._options.pad.rows
        return sense(self._felt, self._options.sensor, self._gain, noise, rows=rows)[self._count - 1]
