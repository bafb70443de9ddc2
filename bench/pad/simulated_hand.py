"""A simulated pad under a simulated hand, which presses what a person would be led to press, to try without a pad."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tactsim.bench.trials import draw_true_pose
from tactsim.core import compose
from tactsim.core.errors import InputError
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.core.source import HasPad, Source
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import Device
from tactsim.hardware.emulator.hand import Pressing
from tactsim.hardware.session import Plan
from tactsim.hardware.sources import open_source
from tactsim.models import Letter, letter
from tactsim.press import ScanOptions
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import grid_poses, stage_for
from tactsim.press.simulated_source import SimulatedPad, on_pad_of, parse_pose, sensing
from tactsim.press.touches import as_pressed

PLACE = "simulated:hand"  # what is given instead of a port
_SIMULATED, _RECORDING = "simulated:", "recording:"
_PATIENCE = 1.0  # s after which a simulated hand's touch is taken as it is: a hole may lie over the pad
_PAUSE = 0.5  # s that a hand that is watched takes to its next place
_NOWHERE = np.zeros(3)


def touch_above(noise: float) -> float:
    """Give the pressure above which a taxel with noise of that sd is touched and not noisy, kPa."""
    return 5.0 * noise


class SimulatedHand(SimulatedPad):
    """Readings of the pad of a device while a hand presses an object in the default world. There is no zero to correct.

    label: the object's name. robot_in_object: (3,) where it lies. asked: gives the number of the press that should be
    on the pad now, None while the pad should be free, as `Leader.asked` does.
    """

    calibrated = True

    def __init__(
        self,
        pressed: Letter,
        poses: FloatArray,
        device: HasPad,
        seed: int,
        robot_in_object: FloatArray = _NOWHERE,
        pause: float = 0.0,
    ) -> None:
        """Take the object. poses: (n, 3) sensor_in_robot of the presses that may be asked for. pause: s before each."""
        self.label, self.robot_in_object = pressed.name, robot_in_object
        self.asked: Callable[[], int | None] = lambda: None
        self._letter, self._poses, self._seed, self._pause = pressed, poses, seed, pause
        self._options = on_pad_of(device, ScanOptions())
        noise = stream(seed, self.label, "sense")
        super().__init__(device, sensing(Pressing(device.pad.taxels, self._wanted), self._options, noise))
        self._row: FloatArray | None = None
        self._number = -1  # which press `_row` is
        self._from = 0.0  # host time from which the hand presses

    def prepare(self, number: int) -> bool:
        """Get ready for the press of this number; False if it does not come to rest there."""

        def draw(purpose: str) -> np.random.Generator:
            return stream(self._seed, self.label, f"touch {number}", purpose)

        stated = compose(self.robot_in_object, self._poses[number])[None]
        pressed = press_at(as_pressed(self._letter, stated, "test", self._options, draw), self._options)
        if pressed.blanks:
            return False
        self._row, self._number = pressed.readings(self._options)[0], number
        self._from = time.monotonic() + self._pause
        return True

    def _wanted(self, now: float) -> FloatArray | None:
        number = self.asked()
        if number is None:
            return None
        if number != self._number and not self.prepare(number):
            raise InputError(f"press {number + 1} does not come to rest; the simulated hand cannot go on")
        return self._row if time.monotonic() >= self._from else None


def settings() -> dict[str, float]:
    """Give what a session's plan says differently for a simulated hand."""
    return {"patience": _PATIENCE, "touch_kpa": touch_above(ScanOptions().sensor.noise)}


def open_pressed(
    ports: list[str],
    device: Device,
    calibration: Calibration | None,
    seed: int,
    shapes: Sequence[Letter] = (),
) -> tuple[Source, Plan]:
    """Open what `bench live` presses, simulated:LETTER[@x,y,theta] or the ports of a pad, with the poses to ask for.

    A simulated letter, or one of `shapes` by its name, lies at the pose robot_in_object, or at one drawn by the seed.
    Raises InputError if it cannot be opened.
    """
    place = ports[0]
    if place.startswith(_RECORDING):
        raise InputError(
            f"{place}: a recording was touched where it was touched, and cannot be asked for more; `bench watch` plays "
            "it, and `bench replay --scan` makes a scan of its presses, for `bench run`"
        )
    poses = grid_poses(stage_for(device.pad))
    touch = 0.0 if calibration is None else touch_above(max(calibration.noise))
    asks: dict[str, Any] = {"touch_kpa": touch} | (settings() if place.startswith(_SIMULATED) else {})
    asks["touch_kpa"] = max(device.touch_kpa, asks["touch_kpa"])
    plan = Plan(label="live", split="test", poses=tuple(map(tuple, poses.tolist())), **asks)
    if not place.startswith(_SIMULATED):
        return open_source(ports, device, calibration), plan
    if calibration is not None or len(ports) > 1:
        raise InputError(f"{place} is one source and needs no calibration")
    label, _, pose = place.removeprefix(_SIMULATED).partition("@")
    drawn = np.random.default_rng(seed)
    where = parse_pose(pose) if pose else draw_true_pose(drawn, offsets(device.pad.taxel_xy))
    own = {shape.name: shape for shape in shapes}
    found = own.get(label) or letter(label or "A")
    return SimulatedHand(found, poses, device, seed, where, _PAUSE), plan
