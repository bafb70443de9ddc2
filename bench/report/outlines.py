"""The shapes that a report draws: what was pressed, and the taxels that felt it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tactsim import models
from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.occupancy import OccupancyMap


def drawing(label: str, scan: Scan, shape_files: Sequence[Path] = ()) -> list[FloatArray] | None:
    """Give the contours that an object was drawn with, (k, 2) mm each, in its own frame; None if nobody knows them.

    A letter of a simulated scan has the catalogue's outline, a shape of `shape_files` that of its file.
    """
    if "options" in scan.meta and label in models.names():
        return [np.asarray(contour) for contour in models.letter(label).contours]
    for path in shape_files:
        if path.stem == label:
            return [np.asarray(contour) for contour in models.shape(path).contours]
    return None


def map_outline(label: str, maps: Mapping[str, OccupancyMap]) -> list[FloatArray]:
    """Find where a map says that occupied and empty are equally likely: contours (k, 2) mm, none without a map."""
    if label not in maps:
        return []
    from contourpy import contour_generator

    chart = maps[label]
    rows, columns = chart.log_odds.shape
    lines = contour_generator(
        chart.origin[0] + chart.cell * np.arange(columns),
        chart.origin[1] + chart.cell * np.arange(rows),
        chart.log_odds,
    ).lines(0.0)
    return [np.asarray(line) for line in lines if len(line) > 8]


def taxel_size(scan: Scan) -> list[float]:
    """Guess a taxel's width and height, mm, from the usual spacing of the taxels' centres."""
    gaps = [np.diff(np.unique(np.round(scan.taxel_xy[:, axis], 3))) for axis in (0, 1)]
    return [round(0.94 * float(np.median(gap)), 3) if len(gap) else 1.0 for gap in gaps]
