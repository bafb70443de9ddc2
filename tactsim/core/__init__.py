"""What all rooms share: poses, readings, scans, pads, sources, files, plug-ins, seeds and `InputError`.

Lives here: data types and plumbing. Does not live here: anything that knows letters, physics or estimators.
Nothing here imports another room.

`Pad` needs pydantic and is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactsim.core.errors import InputError
from tactsim.core.poses import compose, invert, transform, wrap_angle
from tactsim.core.scan import Scan

if TYPE_CHECKING:
    from tactsim.core.pad import Pad

__all__ = ["InputError", "Pad", "Scan", "compose", "invert", "transform", "wrap_angle"]


def __getattr__(name: str) -> Any:
    if name != "Pad":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("tactsim.core.pad").Pad
