"""A simulated pad under a simulated hand, which presses what a guided session asks for: for trying without a pad."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.hardware.device import Device
from tactsim.hardware.emulator.hand import Pressing
from tactsim.hardware.session import Phase, Session
from tactsim.press import ScanOptions
from tactsim.press.simulated_source import SimulatedPad, on_pad_of, press_table, sensing

PLACE = "simulated:hand"  # what is given instead of a port
HAND_PATIENCE = 1.0  # s after which a simulated hand's touch is taken as it is: a hole may lie over the pad


def touch_above(noise: float) -> float:
    """Give the pressure above which a taxel with noise of that sd is touched and not noisy, kPa."""
    return 5.0 * noise


class SimulatedHand(SimulatedPad):
    """Readings of the pad while the hand presses, in the default world, what `session` asks for."""

    def __init__(self, session: Session, device: Device, seed: int) -> None:
        self._session, self._seed = session, seed
        self._options = on_pad_of(device, ScanOptions())
        rng = np.random.default_rng(seed)
        super().__init__(device, sensing(Pressing(device.pad.taxels, self._wanted), self._options, rng))
        self._row: FloatArray | None = None
        self._pressed = -1  # which press `_row` is

    def _wanted(self, now: float) -> FloatArray | None:
        """Give what is to be pressed, (taxels,) kPa; None while the session waits for a free pad."""
        session = self._session
        if session.phase in (Phase.LIFT, Phase.DONE):
            return None
        if session.current != self._pressed:
            plan, self._pressed = session.plan, session.current
            rng = stream(self._seed, plan.label, plan.split, f"press {self._pressed}")
            pose = np.array(plan.poses[self._pressed])[None]
            self._row = press_table(plan.label, pose, self._options, rng)[0]
        return self._row


def settings() -> dict[str, float]:
    """Give what a session's plan says differently for this hand."""
    return {"patience": HAND_PATIENCE, "touch_kpa": touch_above(ScanOptions().sensor.noise)}
