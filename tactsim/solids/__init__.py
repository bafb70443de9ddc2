"""Objects in space: solids that a pad touches from any side, recognised at any pose in SE(3).

Lives here: all that differs from letters in the plane. What is pressed: `catalogue`, `body`, `symmetry`. How it is
touched: `press`, by one pad or a hand of several, over `touch_kernels`, into a `scan`. How it is recognised: maps of
surfaces on `voxels`, what a touch says of a pose (`field`), and `refined`. How it is run and scored: `kind`, which the
harness finds by name, `score`, `page`. The core imports none of it. Names are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactsim.solids.body import Solid, mirrored, read_solid_file, solid_of
    from tactsim.solids.catalogue import solid, solid_names
    from tactsim.solids.press import (
        Hand,
        HandPress,
        SpacePress,
        Touched,
        random_starts,
        scan_solids,
        solids_of,
        touch_grid,
    )
    from tactsim.solids.scan import SpaceOptions
    from tactsim.solids.symmetry import SpaceSymmetry

_HOME = {
    "body": ("Solid", "mirrored", "read_solid_file", "solid_of"),
    "catalogue": ("solid", "solid_names"),
    "press": (
        "Hand",
        "HandPress",
        "SpacePress",
        "Touched",
        "random_starts",
        "scan_solids",
        "solids_of",
        "touch_grid",
    ),
    "scan": ("SpaceOptions",),
    "symmetry": ("SpaceSymmetry",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Hand",
    "HandPress",
    "Solid",
    "SpaceOptions",
    "SpacePress",
    "SpaceSymmetry",
    "Touched",
    "mirrored",
    "random_starts",
    "read_solid_file",
    "scan_solids",
    "solid",
    "solid_names",
    "solid_of",
    "solids_of",
    "touch_grid",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
