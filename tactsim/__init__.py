"""A harness for comparing ways to recognise an object by touch; what is imported is this package alone.

Rooms, each importing only those before it: `core`, `models`, `press`, `estimators` and `hardware`, `bench`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactsim.core import InputError, Pad, Scan, compose, invert, transform, wrap_angle
    from tactsim.estimators import create
    from tactsim.press import (
        WORLDS,
        Press,
        PressOptions,
        ScanOptions,
        SensorOptions,
        press_letter,
        scan_letters,
    )

_ROOMS = {
    "core": ("InputError", "Pad", "Scan", "compose", "invert", "transform", "wrap_angle"),
    "press": (
        "WORLDS",
        "Press",
        "PressOptions",
        "ScanOptions",
        "SensorOptions",
        "press_letter",
        "scan_letters",
    ),
    "estimators": ("create",),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

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
    "create",
    "invert",
    "press_letter",
    "scan_letters",
    "transform",
    "wrap_angle",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
