"""Press shapes with relief: domes, slopes, steps and any other mesh.

The pad sees a shape as a height field of flat facets. Pressure is stiffness times depth, never below 0 (Winkler),
so on each facet it is linear over the polygon where the facet is in contact, and the press is an integral of
polynomials: exact for the mesh, whatever its shape, without levels or samples. The force grows with the depth
without a kink, so a few steps of Newton's method in one unknown find the rest; three unknowns with a wrist, where it
is the lowest point of a convex energy. What is not felt follows from the depth alone.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.models.height_field import Relief
from tactsim.press.bed import Bed
from tactsim.press.facet_kernels import BURIED, NO_CONTACT, STATE, TIPPED, Cells, Field, Layer, press_all
from tactsim.press.scan_options import ScanOptions
from tactsim.press.spread import contact_map
from tactsim.press.touches import TIPPED as TIPS_OVER
from tactsim.press.touches import Pressed, Touches

_REASONS = {
    BURIED: "it sinks in by more than its height, so the pad would meet what it stands on",
    TIPPED: TIPS_OVER,
}


@dataclass(frozen=True, eq=False)
class CellLoads:
    """What the cells of the pad carry in many presses.

    moments: (6, presses, cells), N times 1, u, v, uu, uv, vv (`clip.MOMENTS`), mm from the cell's centre.
    """

    moments: FloatArray

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections."""
        press, cell = np.nonzero(self.moments[0])
        nowhere = np.zeros((len(cell), 2))
        # A bed whose parts carry a unit of pressure each and have the loads for moments.
        bed = Bed(
            level=np.zeros(len(cell), dtype=np.intp),
            cell=cell,
            centre=nowhere,
            centroid=nowhere,
            area=self.moments[0, press, cell],
            gap=np.zeros(len(cell)),
            moments=self.moments[:, press, cell],
            start=np.searchsorted(press, np.arange(self.moments.shape[1] + 1)),
        )
        cells_per_taxel, sigma = options.press.cells_per_taxel, options.sensor.psf_sigma
        return contact_map(bed, np.ones(len(cell)), None, options.pad, cells_per_taxel, sigma)


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a shape with relief, or any letter, until it rests.

    The layer's stiffness is that of `PressOptions`: where the level shape would press it by more than its thickness, it
    is just so stiff that it gives way by its thickness. A press that sinks in by more than the shape's height, or tips
    over, is a blank.
    Raises InputError if too many facets hide others.
    """
    count = len(touches)
    x_lines, y_lines = options.cell_lines
    states = np.zeros((count, STATE))
    loads = np.zeros((count, 6 * (len(x_lines) - 1) * (len(y_lines) - 1)))
    layer = options.press
    wrist = np.inf if layer.wrist_stiffness is None else layer.wrist_stiffness
    x, y, angle = touches.poses.T
    poses = np.column_stack([x, y, np.cos(angle), np.sin(angle)])
    tilts = np.ascontiguousarray(touches.tilts, dtype=float)
    relief = touches.letter.relief or Relief.of(touches.letter.solid)
    facets, front, height = relief.seen_from_above
    press_all(
        Field(facets, front), poses, tilts, touches.forces(layer.force), Cells(x_lines, y_lines),
        Layer(1e-3 * layer.stiffness, layer.thickness, float(wrist), height), states, loads,
    )  # fmt: skip
    ended = states[:, -1]
    blanks = {int(index): _REASONS[ended[index]] for index in np.flatnonzero(ended > NO_CONTACT)}
    touching = int(np.count_nonzero(ended != NO_CONTACT))
    moments = np.ascontiguousarray(loads.reshape(count, 6, -1).transpose(1, 0, 2))
    return Pressed(
        touches, CellLoads(moments), Counter(presses=touching, no_contact=count - touching), blanks
    )
