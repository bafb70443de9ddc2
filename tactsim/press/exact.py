"""The engine `exact`: a level flat face presses evenly, so its pressure is the force over the area.

On any bed of equal springs a rigid flat face that stays level is equally deep everywhere. Nothing has to be
solved then; `clip` gives the area, and each cell's part of it, exactly.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from tactsim.press.bed import lay_bed, levels
from tactsim.press.scan_options import ScanOptions
from tactsim.press.spread import Patches
from tactsim.press.touches import Pressed, Touches


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a flat letter that stays level: p = F / A."""
    face = levels(touches.letter, options.press)
    x_lines, y_lines = options.cell_lines
    bed = lay_bed(face, touches.poses, x_lines, y_lines)
    area = bed.area_of_presses
    pressure = touches.forces(options.press.force)[bed.press] / area[bed.press]
    touching = int(np.count_nonzero(area))
    cells = (len(x_lines) - 1) * (len(y_lines) - 1)
    work = Counter(
        presses=touching,
        no_contact=len(touches) - touching,
        solver=touching,
        cells=touching * cells - len(bed.area),
        parts=touching,
    )
    return Pressed(touches, Patches(bed, pressure), work)
