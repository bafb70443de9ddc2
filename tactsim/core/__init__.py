"""What all rooms share: poses, readings, scans, pads, sources, files, plug-ins, seeds and `InputError`.

Lives here: data types and plumbing. Does not live here: anything that knows letters, physics or estimators.
Nothing here imports another room.

Everything but `InputError` is imported when it is first used: most needs NumPy, and `Pad` pydantic.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.core.pad import Pad
    from tactsim.core.poses import compose, invert, transform, wrap_angle
    from tactsim.core.scan import Scan

_HOME = {
    "Pad": "pad",
    "Scan": "scan",
    "compose": "poses",
    "invert": "poses",
    "transform": "poses",
    "wrap_angle": "poses",
}

__all__ = ["InputError", "Pad", "Scan", "compose", "invert", "transform", "wrap_angle"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
