"""The simulated pad: letters pressed in MuJoCo, the sensor model and the scan of 192 readings a letter.

Lives here: the physics of a press, what the sensor makes of it, and the cache of readings. Does not live
here: what is learned from readings (estimators), or how a real pad is read (hardware).

`engine` chooses who presses: `exact`, `balance` (the engine bed, over `bed`, `clip`, `levels` and `scene`), `collide`
and `facets` (the engine relief); `dynamics` goes through time.
`spread` and `sensor` turn pressure into readings, and `scanning` takes all of them. A pad on a geom of anybody's MuJoCo
model is the room `tactsim.attach`, whose names are found here, too.

`press_model` predicts readings, and their derivatives, for estimators that press by themselves.

The package can be called: `tactsim.press("A", pose=(1, 0, 0.5))` presses one letter once.

What needs pydantic, MuJoCo or a letter is imported when it is first used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from tactsim.attach.attached_pad import AttachedPad, attach, bind
    from tactsim.attach.pad_reader import PadReader, PadReading
    from tactsim.models import Letter
    from tactsim.press.one_press import Press, press_letter
    from tactsim.press.press_model import PressModel, forward_model
    from tactsim.press.scan_options import WORLDS, PressOptions, ScanOptions
    from tactsim.press.scanning import scan_letters
    from tactsim.press.sensor import SensorOptions

_HOME = {
    "attach.attached_pad": ("AttachedPad", "attach", "bind"),
    "attach.pad_reader": ("PadReader", "PadReading"),
    "press.one_press": ("Press", "press_letter"),
    "press.press_model": ("PressModel", "forward_model"),
    "press.scan_options": ("PressOptions", "ScanOptions", "WORLDS"),
    "press.scanning": ("scan_letters",),
    "press.sensor": ("SensorOptions",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "WORLDS",
    "AttachedPad",
    "PadReader",
    "PadReading",
    "Press",
    "PressModel",
    "PressOptions",
    "ScanOptions",
    "SensorOptions",
    "attach",
    "bind",
    "forward_model",
    "press_letter",
    "scan_letters",
]


class CallablePackage(ModuleType):
    """The type of this package, so that it is a room and a function at once."""

    def __call__(
        self,
        letter: str | Letter,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        options: ScanOptions | None = None,
        rng: np.random.Generator | None = None,
        rotation: ArrayLike | None = None,
    ) -> Press:
        """Press a letter, given by its name or as a `Letter`, at one pose, and return what the pad reads.

        pose: sensor_in_object [x, y, theta], mm and rad. Of `options` only pad, press, sensor and, for the
        pad's gains, seed count. `rng` draws noise and random taxels; without it there are none.
        rotation: (3, 3) or a SciPy Rotation, to press from another side than above: its columns are the axes, in the
        object frame, in which the letter is then seen as if from above; the pose lies in the plane of the first two.
        Raises InputError for an unknown letter, or if the pose is not three finite numbers.
        """
        from tactsim import models
        from tactsim.press.one_press import press_letter

        return press_letter(
            models.letter(letter) if isinstance(letter, str) else letter, pose, options, rng, rotation
        )


sys.modules[__name__].__class__ = CallablePackage


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"tactsim.{_MODULE_OF[name]}"), name)
