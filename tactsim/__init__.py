"""The simulated tactile pad, and the data types that simulated and real pads share.

Lives here: poses, the pad's geometry, the press in MuJoCo, the sensor model, the 192-reading scan
and `Scan`, the file that holds it. Does not live here: what is learned from readings (estimators),
how it is scored (bench), or how a real pad is read (hardware).

What needs pydantic, MuJoCo or a letter is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from models.errors import InputError
from tactsim.poses import compose, invert, transform, wrap_angle
from tactsim.scan import Scan

if TYPE_CHECKING:
    from tactsim.options import WORLDS, PressOptions, ScanOptions, SensorOptions
    from tactsim.pad import Pad
    from tactsim.pressing import Press, press_letter
    from tactsim.scanning import scan_letters

_LATER = {
    "Pad": "pad",
    "PressOptions": "options",
    "ScanOptions": "options",
    "SensorOptions": "options",
    "WORLDS": "options",
    "Press": "pressing",
    "press_letter": "pressing",
    "scan_letters": "scanning",
}

__all__ = [
    "WORLDS",
    "InputError",
    "Pad",
    "Press",
    "PressOptions",
    "Scan",
    "ScanOptions",
    "SensorOptions",
    "compose",
    "invert",
    "press_letter",
    "scan_letters",
    "transform",
    "wrap_angle",
]


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
