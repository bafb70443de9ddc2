"""Touches of objects in space: a pad comes from any side, rests where it carries the force, and is read.

Lives here: the press of any mesh from any pose (`space_press`, over `pad_lattice` and `touch_kernels`), the touches
that teach an estimator an object and the scan of them (`solid_scanning`), and hands of several pads (`hand`). Does not
live here: the solids themselves (models.solids), and the press of letters on a plane (the package above).
"""

from tactsim.press.space.pads_on_hand import Hand, HandPress
from tactsim.press.space.solid_scanning import random_starts, scan_solids, solids_of, touch_grid
from tactsim.press.space.space_options import SpaceOptions
from tactsim.press.space.space_press import SpacePress, Touched

__all__ = [
    "Hand",
    "HandPress",
    "SpaceOptions",
    "SpacePress",
    "Touched",
    "random_starts",
    "scan_solids",
    "solids_of",
    "touch_grid",
]
