"""`Reading`: the pressures on a pad at one moment, whether the pad is simulated, recorded or real."""

from __future__ import annotations

from dataclasses import dataclass

from tactsim.core.errors import InputError
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray


@dataclass(frozen=True, eq=False)
class Reading:
    """The pressures on all taxels of a pad at one moment.

    pressures: (taxels,) kPa, in the pad's order of taxels. host_time: s on the clock of the computer that read it; only
    differences have a meaning. device_time: s on the device's own clock, with overflows undone, or None if it has none.
    index: the device's frame counter as sent, or None. after_loss: whether a link was lost, or the device began anew,
    since the reading before; the two must then not be taken for one press.

    Raises InputError if a pressure is not a finite number of a sensible size.
    """

    pressures: FloatArray
    host_time: float
    device_time: float | None = None
    index: int | None = None
    after_loss: bool = False

    def __post_init__(self) -> None:
        pressures = finite(self.pressures, "reading").copy()  # a driver may use its array again
        if pressures.ndim != 1:
            raise InputError(f"a reading has shape {pressures.shape}; it is one pressure a taxel")
        pressures.setflags(write=False)
        object.__setattr__(self, "pressures", pressures)
