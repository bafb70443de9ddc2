"""A simulated object that lies hidden, and a hand that presses it where it is asked to: for trying without a pad."""

from __future__ import annotations

import time

import numpy as np

from tactsim.core import compose
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.core.source import HasPad
from tactsim.hardware.emulator.hand import Pressing
from tactsim.models import letter
from tactsim.press import ScanOptions
from tactsim.press.engine import press_at
from tactsim.press.scanning import as_pressed
from tactsim.press.simulated_source import SimulatedPad, on_pad_of, sensing

_PAUSE = 0.5  # s that the hand takes to its next place


class HiddenObject(SimulatedPad):
    """Readings of the pad of a device while a hand presses a letter in the default world. There is no zero to correct.

    label: the letter. robot_in_object: (3,) where it lies. poses: (n, 3) sensor_in_robot of the presses that may be
    asked for.
    """

    calibrated = True

    def __init__(
        self, label: str, robot_in_object: FloatArray, poses: FloatArray, device: HasPad, seed: int
    ) -> None:
        """Hide the letter. Raises InputError if there is no such letter."""
        self.label, self.robot_in_object = label, robot_in_object
        self._letter, self._poses, self._seed = letter(label), poses, seed
        self._options = on_pad_of(device, ScanOptions())
        noise = stream(seed, label, "sense")
        super().__init__(device, sensing(Pressing(device.pad.taxels, self._wanted), self._options, noise))
        self._row: FloatArray | None = None
        self._from = 0.0  # host time from which the hand presses
        self._pressing = False

    def prepare(self, number: int) -> bool:
        """Get ready to press at the pose of this number; False if the press does not come to rest there."""

        def draw(purpose: str) -> np.random.Generator:
            return stream(self._seed, self.label, f"touch {number}", purpose)

        stated = compose(self.robot_in_object, self._poses[number])[None]
        pressed = press_at(as_pressed(self._letter, stated, "test", self._options, draw), self._options)
        if pressed.blanks:
            return False
        self._row = pressed.readings(self._options)[0]
        self._from = time.monotonic() + _PAUSE
        return True

    def press(self, wanted: bool) -> None:
        """Press, or lift."""
        self._pressing = wanted

    def _wanted(self, now: float) -> FloatArray | None:
        return self._row if self._pressing and time.monotonic() >= self._from else None
