"""Objects in space: solids that a pad touches from any side, recognised at any pose in SE(3).

Lives here: all that differs from letters in the plane. What is pressed: `catalogue`, `body`, `symmetry`.
How it is touched: `press`, by one pad or a hand of several, over `touch_kernels`, into a `scan`.
How it is recognised: maps of surfaces on `voxels`, what a touch says of a pose (`field`), and `refined`.
How it is run and scored: `kind`, which the harness finds by name, `score`, `page`. The core imports none of it. Names
are imported when they are first used.
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
    "Hand": "press",
    "HandPress": "press",
    "Solid": "body",
    "SpaceOptions": "scan",
    "SpacePress": "press",
    "SpaceSymmetry": "symmetry",
    "Touched": "press",
    "mirrored": "body",
    "random_starts": "press",
    "read_solid_file": "body",
    "scan_solids": "press",
    "solid": "catalogue",
    "solid_names": "catalogue",
    "solid_of": "body",
    "solids_of": "press",
    "touch_grid": "press",
}

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
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
