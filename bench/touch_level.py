"""When a taxel is touched, and how long a simulated hand waits: the same wherever touches are led through."""

from __future__ import annotations

HAND_PATIENCE = 1.0  # s after which a simulated hand's touch is taken as it is: a hole may lie over the pad
_DEVIATIONS = 5.0


def touch_above(noise: float) -> float:
    """Give the pressure above which a taxel with noise of that sd is touched and not noisy, kPa."""
    return _DEVIATIONS * noise
