"""The simulated pad: letters pressed in MuJoCo, the sensor model and the scan of 192 readings a letter.

Lives here: the physics of a press, what the sensor makes of it, and the cache of readings. Does not live
here: what is learned from readings (estimators), or how a real pad is read (hardware).

What needs pydantic, MuJoCo or a letter is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactsim.press.pressing import Press, press_letter
    from tactsim.press.scan_options import WORLDS, PressOptions, ScanOptions, SensorOptions
    from tactsim.press.scanning import scan_letters

_HOME = {
    "PressOptions": "scan_options",
    "ScanOptions": "scan_options",
    "SensorOptions": "scan_options",
    "WORLDS": "scan_options",
    "Press": "pressing",
    "press_letter": "pressing",
    "scan_letters": "scanning",
}

__all__ = ["WORLDS", "Press", "PressOptions", "ScanOptions", "SensorOptions", "press_letter", "scan_letters"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
