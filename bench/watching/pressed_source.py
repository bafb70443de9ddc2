"""What is pressed in `bench live`: a pad on its ports, or an object hidden in the simulation."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from tactsim.bench.pad.simulated_hand import HAND_PATIENCE, touch_above
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

_PAUSE = 0.5  # s that the hand takes to its next place


class HiddenObject(SimulatedPad):
    """Readings of the pad of a device while a hand presses a letter in the default world. There is no zero to correct.

    label: its name. robot_in_object: (3,) where it lies. poses: (n, 3) sensor_in_robot of the presses that may be
    asked for.
    """

    calibrated = True

    def __init__(
        self, hidden: Letter, robot_in_object: FloatArray, poses: FloatArray, device: HasPad, seed: int
    ) -> None:
        """Hide the letter or shape."""
        self.label, self.robot_in_object = hidden.name, robot_in_object
        self._letter, self._poses, self._seed = hidden, poses, seed
        self._options = on_pad_of(device, ScanOptions())
        noise = stream(seed, self.label, "sense")
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


_SIMULATED, _RECORDING = "simulated:", "recording:"


def open_pressed(
    ports: list[str],
    device: Device,
    calibration: Calibration | None,
    seed: int,
    shapes: Sequence[Letter] = (),
) -> tuple[Source, Plan]:
    """Open what is pressed, simulated:LETTER[@x,y,theta] or the ports of a pad, with the poses that may be asked for.

    A simulated letter, or one of `shapes` by its name, lies at the pose robot_in_object, or at one drawn by the seed.
    Raises InputError if it cannot be opened.
    """
    place = ports[0]
    if place.startswith(_RECORDING):
        raise InputError(
            f"{place}: a recording was touched where it was touched, and cannot be asked for more; `bench watch` plays "
            "it, and `bench replay --scan` makes a scan of its presses, for `bench run`"
        )
    touch, patience = 0.0 if calibration is None else touch_above(max(calibration.noise)), None
    if place.startswith(_SIMULATED):
        touch, patience = touch_above(ScanOptions().sensor.noise), HAND_PATIENCE
    poses = grid_poses(stage_for(device.pad)).tolist()
    plan = Plan(
        label="live", split="test", poses=tuple(map(tuple, poses)), patience=patience,
        touch_kpa=max(device.touch_kpa, touch),
    )  # fmt: skip
    if not place.startswith(_SIMULATED):
        return open_source(ports, device, calibration), plan
    if calibration is not None or len(ports) > 1:
        raise InputError(f"{place} is one source and needs no calibration")
    label, _, pose = place.removeprefix(_SIMULATED).partition("@")
    where = (
        parse_pose(pose)
        if pose
        else draw_true_pose(np.random.default_rng(seed), offsets(device.pad.taxel_xy))
    )
    own = {shape.name: shape for shape in shapes}
    found = own.get(label) or letter(label or "A")
    return HiddenObject(found, where, np.array(plan.poses), device, seed), plan
