"""The picture of `bench validate`: presses as they were recorded and as the fitted simulation has them."""

from __future__ import annotations

import textwrap

import numpy as np

from tactsim.bench.pad.validation import Validation
from tactsim.bench.runs.figures import BLUE, GREY, Picture
from tactsim.core.poses import FloatArray
from tactsim.hardware.cutting import taxel_grid

_MOST = 6  # labels of which a press is drawn


def presses_figure(result: Validation) -> Picture:
    """Draw a press of each label, neither the best nor the worst fitted, above what a fit without its group says of it.

    Beside them: all taxels of all presses, recorded against fitted, and how far each taxel is off.
    """
    scan, fitted = result.presses, result.fit.held_out_placed
    off = np.sqrt(np.mean((scan.readings - fitted) ** 2, axis=1))  # NaN where a press tips over
    rested = np.flatnonzero(np.isfinite(off))
    each = [rested[scan.labels[rested] == label] for label in scan.letters]
    shown = [rows[np.argsort(off[rows])[len(rows) // 2]] for rows in each if len(rows)][:_MOST]
    figure = Picture(figsize=(1.5 * len(shown) + 3.6, 3.9), layout="constrained")
    grid = figure.subplots(2, len(shown) + 1, width_ratios=[*(1 for _ in shown), 1.5], squeeze=False)
    most = float(np.nanmax([scan.readings[shown], fitted[shown]]))
    for (above, below), press in zip(grid.T, shown, strict=False):
        title = f"{textwrap.fill(scan.labels[press], 16)}\nrms {off[press]:.3g}"
        above.set_title(title, fontsize=9, parse_math=False)
        for axes, values in ((above, scan.readings), (below, fitted)):
            image = axes.imshow(
                _on_pad(scan.taxel_xy, values[press]), "magma", origin="lower", vmin=0, vmax=most
            )
            axes.set(xticks=[], yticks=[])
    grid[0, 0].set_ylabel("recorded")
    grid[1, 0].set_ylabel("fitted, held out")
    figure.colorbar(image, ax=grid[:, :-1], label=result.unit, location="bottom", aspect=50)
    against, where = grid[:, -1]
    against.plot(fitted, scan.readings, ".", color=BLUE, ms=2, alpha=0.3)
    against.axline((0, 0), slope=1, color=GREY, lw=0.8)
    against.set_xlabel(f"fitted, held out, {result.unit}", fontsize=8)
    against.set_ylabel(f"recorded, {result.unit}", fontsize=8)
    of_taxel = np.sqrt(np.nanmean((scan.readings - fitted) ** 2, axis=0))
    image = where.imshow(_on_pad(scan.taxel_xy, of_taxel), "viridis", origin="lower", vmin=0)
    where.set(xticks=[], yticks=[])
    figure.colorbar(image, ax=where).set_label(f"rms of a taxel, {result.unit}", fontsize=8)
    return figure


def _on_pad(taxel_xy: FloatArray, values: FloatArray) -> FloatArray:
    """Lay taxels (n,) out as they lie on the pad, the first row below: (rows, columns), NaN where none is."""
    numbers = taxel_grid(taxel_xy)
    return np.where(numbers < 0, np.nan, values[numbers])
